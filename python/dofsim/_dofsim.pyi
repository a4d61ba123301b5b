from os import PathLike
from typing import Any, Literal, final

from numpy.typing import NDArray

__version__: str

class DeviceError(RuntimeError): ...

@final
class Aperture:
    def __new__(
        cls, *, blades: int = 0, rotation: float = 0.0, apodization: float | None = None
    ) -> Aperture: ...

@final
class Lens:
    def __new__(
        cls, *, aperture_radius: float, focus_distance: float, fov: float, fov_axis: str = "x"
    ) -> Lens: ...
    @staticmethod
    def from_camera(
        *, focal_length_mm: float, f_number: float, focus_distance: float, sensor_width_mm: float = 36.0
    ) -> Lens: ...
    @staticmethod
    def from_disparity(*, strength_px: float, focus: float) -> Lens: ...
    @property
    def focus_distance(self, /) -> float | None: ...
    @property
    def focus(self, /) -> float | None: ...
    def replace(self, /, **changes: float | str) -> Lens: ...
    def focused_at(
        self,
        /,
        depth: NDArray[Any],
        x: int,
        y: int,
        *,
        depth_kind: str = "z",
        near: float | None = None,
        far: float | None = None,
    ) -> Lens: ...

@final
class Scene: ...

@final
class ExrPart:
    @property
    def name(self, /) -> str | None: ...
    @property
    def channels(self, /) -> list[str]: ...
    @property
    def data_window(self, /) -> tuple[int, int, int, int]: ...
    @property
    def display_window(self, /) -> tuple[int, int, int, int]: ...

def coc(
    depth: NDArray[Any],
    lens: Lens,
    *,
    depth_kind: str = "z",
    near: float | None = None,
    far: float | None = None,
    invalid: str = "raise",
) -> NDArray[Any]: ...
def decode_codes(codes: NDArray[Any], *, srgb: bool, alpha: bool) -> NDArray[Any]: ...
def encode_codes(values: NDArray[Any], *, sixteen: bool, alpha: bool) -> NDArray[Any]: ...
def exr_parts(path: str | PathLike[str]) -> list[ExrPart]: ...
def file_kind(path: str | PathLike[str]) -> str: ...
def read_exr(
    path: str | PathLike[str], part: int, channels: list[str], *, data: bool, fill: float
) -> NDArray[Any]: ...
def read_raster(
    path: str | PathLike[str],
) -> tuple[NDArray[Any], Literal["none", "straight", "premultiplied"]]: ...
def render(
    color: NDArray[Any],
    depth: NDArray[Any],
    lens: Lens,
    *,
    method: str = "lens",
    device: str = "auto",
    aperture: Aperture | None = None,
    depth_kind: str = "z",
    near: float | None = None,
    far: float | None = None,
    invalid: str = "raise",
    alpha: str | None = None,
    transfer: str | None = None,
    overscan: int = 0,
    supersample: int = 1,
    threads: int | None = None,
    views: int | None = None,
) -> NDArray[Any]: ...
def write_bytes(path: str | PathLike[str], bytes: bytes) -> None: ...
def write_exr(
    path: str | PathLike[str],
    parts: list[tuple[str | None, list[tuple[str, NDArray[Any]]]]],
    *,
    compression: str,
) -> None: ...
def write_pfm(path: str | PathLike[str], pixels: NDArray[Any]) -> None: ...
def write_png(path: str | PathLike[str], pixels: NDArray[Any]) -> None: ...
def write_tiff(path: str | PathLike[str], pixels: NDArray[Any], premultiplied: bool) -> None: ...
