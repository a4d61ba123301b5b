"""The camera and lens of a scene, in Mitsuba's own words."""

from dataclasses import asdict, dataclass


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
