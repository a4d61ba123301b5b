"""Depth as data sets and renderers write it.

================ ================== ==================== =================================
Preset           ``depth_kind``     In the file          Without depth
================ ================== ==================== =================================
``"hypersim"``   distance           metres, HDF5         NaN
``"kitti"``      z                  1/256 m, 16-bit PNG  0 is no reading
``"nyu"``        z                  1/1000 m, 16-bit PNG 0 is no reading
``"tum"``        z                  1/5000 m, 16-bit PNG 0 is no reading
``"scannet"``    z                  1/1000 m, 16-bit PNG 0 is no reading
``"middlebury"`` disparity          pixels, PFM          infinity is no reading
``"sintel"``     z                  metres, ``.dpt``     nothing
``"mitsuba"``    distance_from_near metres, OpenEXR      0 is the background
``"blender"``    z                  metres, OpenEXR      1e10 and above are the background
================ ================== ==================== =================================

No reading becomes NaN, which ``invalid`` of `dofsim.render` refuses or takes for far. Disparity is relative
and goes with `Lens.from_disparity`. Mitsuba's depth needs ``near``, the distance of the near plane.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any, Literal

__all__ = ["PRESETS", "DepthPreset"]


def __dir__() -> list[str]:
    """List the public names."""
    return sorted(__all__)


@dataclass(frozen=True, kw_only=True)
class DepthPreset:
    """What the depth in a kind of file means.

    Attributes
    ----------
    depth_kind : str
        As for `dofsim.render`.
    depth_scale : float
        What one unit of the file stands for.
    depth_missing : float, optional
        The value in the file that means no reading.
    depth_background : float, optional
        The value in the file that means the background, as do larger ones.

    Examples
    --------
    >>> import numpy as np
    >>> from dofsim.io import read_rgbd, write_depth, write_image
    >>> from dofsim.presets import PRESETS
    >>> write_image("color.png", np.ones((1, 2, 3)))
    >>> write_depth("depth.png", np.array([[0, 2500]]))
    >>> tum = PRESETS["tum"]
    >>> color, depth = read_rgbd("color.png", "depth.png", **tum.reading)
    >>> depth, tum.depth_kind
    (array([[nan, 0.5]], dtype=float32), 'z')
    """

    depth_kind: Literal["z", "distance", "disparity", "distance_from_near"] = "z"
    depth_scale: float = 1.0
    depth_missing: float | None = None
    depth_background: float | None = None

    @property
    def reading(self) -> dict[str, Any]:
        """The arguments of `dofsim.io.read_rgbd`."""
        return {
            "depth_scale": self.depth_scale,
            "depth_missing": self.depth_missing,
            "depth_background": self.depth_background,
        }


PRESETS: Mapping[str, DepthPreset] = MappingProxyType(
    {
        "hypersim": DepthPreset(depth_kind="distance"),
        "kitti": DepthPreset(depth_scale=1 / 256, depth_missing=0.0),
        "nyu": DepthPreset(depth_scale=1 / 1000, depth_missing=0.0),
        "tum": DepthPreset(depth_scale=1 / 5000, depth_missing=0.0),
        "scannet": DepthPreset(depth_scale=1 / 1000, depth_missing=0.0),
        "middlebury": DepthPreset(depth_kind="disparity", depth_missing=math.inf),
        "sintel": DepthPreset(),
        "mitsuba": DepthPreset(depth_kind="distance_from_near"),
        "blender": DepthPreset(depth_background=1e10),
    }
)
