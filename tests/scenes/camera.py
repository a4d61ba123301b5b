"""The camera and lens of a scene, in Mitsuba's own words."""

from dataclasses import asdict, dataclass
from math import radians, tan


@dataclass(frozen=True)
class Camera:
    """A thin lens at the origin that looks along +z; lengths in metres, `fov` in degrees along `fov_axis`."""

    aperture_radius: float = 0.08
    focus_distance: float = 4.0
    fov: float = 42.0
    fov_axis: str = "x"

    def settings(self) -> dict[str, float | str]:
        """Give the fields by name, as `dofsim.Lens` takes them."""
        return asdict(self)

    def coc_radius_px(self, depth, width: int):
        """Radius in pixels of the circle of confusion, positive behind the focus plane; `fov` along x."""
        focal_px = 0.5 * width / tan(radians(0.5 * self.fov))
        return self.aperture_radius * focal_px * (1.0 / self.focus_distance - 1.0 / depth)
