"""Depth of field as a real lens would have taken it, from a picture and its depth."""

from dofsim._dofsim import (
    Aperture,
    Device,
    DeviceError,
    Lens,
    Scene,
    __version__,
    coc,
    devices,
    render,
    sensors,
)
from dofsim._focus import focus_pull

SENSORS: dict[str, tuple[float, float]] = {name: (width, height) for name, width, height in sensors()}
"""Sensors by name: their widths and heights in millimetres."""

__all__ = [
    "SENSORS",
    "Aperture",
    "Device",
    "DeviceError",
    "Lens",
    "Scene",
    "__version__",
    "coc",
    "devices",
    "focus_pull",
    "render",
]
