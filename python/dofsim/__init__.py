"""Depth of field as a real lens would have taken it, from a picture and its depth."""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from dofsim._dofsim import (
    Aperture,
    Device,
    DeviceError,
    Lens,
    LensMap,
    Scene,
    __version__,
    coc,
    devices,
    layers_from_matte,
    layers_from_views,
    refine_depth,
    release_devices,
    render,
    restore_highlights,
    sensors,
)
from dofsim._focus import focus_pull

if TYPE_CHECKING:
    from dofsim import batch as batch
    from dofsim import cameras as cameras
    from dofsim import io as io
    from dofsim import metrics as metrics
    from dofsim import photo as photo
    from dofsim import plot as plot
    from dofsim import presets as presets
    from dofsim._gradients import jvp, vjp
    from dofsim._ids import render_ids
    from dofsim.cameras import Camera
    from dofsim.picker import FocusPicker as FocusPicker

SENSORS: dict[str, tuple[float, float]] = {name: (width, height) for name, width, height in sensors()}
"""Sensors by name: their widths and heights in millimetres."""

__all__ = [
    "SENSORS",
    "Aperture",
    "Camera",
    "Device",
    "DeviceError",
    "Lens",
    "LensMap",
    "Scene",
    "__version__",
    "coc",
    "devices",
    "focus_pull",
    "jvp",
    "layers_from_matte",
    "layers_from_views",
    "refine_depth",
    "release_devices",
    "render",
    "render_ids",
    "restore_highlights",
    "vjp",
]

_MODULES = ("batch", "cameras", "io", "metrics", "photo", "presets")
# These need optional packages, and completion does not show them.
_OPTIONAL_MODULES = ("mitsuba", "plot", "torch")


def __getattr__(name: str) -> Any:
    """Import what is slow to load when it is asked for: some need NumPy, the widget optional packages."""
    if name == "Camera":
        from dofsim.cameras import Camera

        return Camera
    if name == "render_ids":
        from dofsim._ids import render_ids

        return render_ids
    if name in ("jvp", "vjp"):
        return getattr(import_module("dofsim._gradients"), name)
    if name == "FocusPicker":
        from dofsim.picker import FocusPicker

        return FocusPicker
    if name in (*_MODULES, *_OPTIONAL_MODULES):
        return import_module(f"dofsim.{name}")
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    """List the public names, the widget's and those of modules among them."""
    return sorted({*__all__, "FocusPicker", *_MODULES})
