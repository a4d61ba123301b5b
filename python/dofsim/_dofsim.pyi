from collections.abc import Sequence
from os import PathLike
from typing import Any, Literal, TypeAlias, TypedDict, TypeVar, final, overload, type_check_only

import numpy as np
from numpy.typing import ArrayLike, NDArray
from typing_extensions import Unpack

__all__ = [
    "HIGHLIGHT_RATIO",
    "Aperture",
    "AxialBlur",
    "Beside",
    "Device",
    "DeviceError",
    "ExrPart",
    "Lens",
    "LensMap",
    "Scene",
    "_Gradients",
    "__version__",
    "chosen_device",
    "coc",
    "decode_by_curves",
    "decode_codes",
    "deep_exr_part",
    "device_bytes",
    "device_submissions",
    "device_traffic",
    "devices",
    "encode_by_curves",
    "encode_codes",
    "encode_png",
    "exr_parts",
    "file_kind",
    "focusable_pixels",
    "lacking_for_gpu",
    "layers_from_matte",
    "layers_from_views",
    "layers_of_samples",
    "methods_available",
    "parse_profile",
    "read_deep_exr",
    "read_exr",
    "read_raster",
    "refine_depth",
    "release_devices",
    "render",
    "restore_highlights",
    "restrict_devices",
    "sensors",
    "simd_available",
    "write_bytes",
    "write_exr",
    "write_pfm",
    "write_png",
    "write_tiff",
]

_Sample = TypeVar("_Sample", bound=np.float16 | np.float32 | np.float64 | np.uint8 | np.uint16)

_Alpha: TypeAlias = Literal["premultiplied", "straight", "none"]
_DepthKind: TypeAlias = Literal[
    "z", "distance", "inverse_z", "disparity", "relative", "zbuffer", "opengl_ndc", "distance_from_near"
]
# "auto", "cpu", "gpu", or an adapter by its id or its name.
_Device: TypeAlias = str
_FovAxis: TypeAlias = Literal["x", "y", "diagonal", "smaller", "larger"]
_Invalid: TypeAlias = Literal["raise", "far"]
_ChannelKind: TypeAlias = Literal["light", "matte", "data", "normal"]
_ChannelKinds: TypeAlias = _ChannelKind | Sequence[_ChannelKind]
_InvalidColor: TypeAlias = Literal["raise", "fill"]
_Picture: TypeAlias = NDArray[np.floating[Any]] | NDArray[np.integer[Any]]
_Pictures: TypeAlias = _Picture | Sequence[_Picture]
_Depth: TypeAlias = NDArray[np.floating[Any]] | NDArray[np.integer[Any]]
_Holdout: TypeAlias = tuple[NDArray[np.floating[Any]], NDArray[np.floating[Any]]]
_Pair: TypeAlias = tuple[float, float]
_Path: TypeAlias = str | PathLike[str]
_Transfer: TypeAlias = Literal["linear", "srgb"]
_Triple: TypeAlias = tuple[float, float, float]
_Window: TypeAlias = tuple[int, int, int, int]
_Vignetting: TypeAlias = Literal["none", "optical", "natural", "full"]

# The options of each method; None stands for one that is not given.

@type_check_only
class _LensOptions(TypedDict, total=False):
    views: int | None
    resolution: Literal["adaptive", "full"] | None

@type_check_only
class _PoissonOptions(TypedDict, total=False):
    taps: int | NDArray[np.floating[Any]] | Sequence[Sequence[float]] | None
    bokeh: Literal["uniform", "ring", "gaussian", "inverse"] | None
    leak_test: Literal["on", "off"] | None

@type_check_only
class _GaussianOptions(TypedDict, total=False):
    focal_range: float | None

@type_check_only
class _TapsOptions(TypedDict, total=False):
    variant: Literal["thirteen", "seven", "six", "four", "four_rings"] | None
    hyperfocal_factor: float | None

@type_check_only
class _HexagonalOptions(TypedDict, total=False): ...

@type_check_only
class _LevelsOptions(TypedDict, total=False):
    c0_px: float | None

@type_check_only
class _SpritesOptions(TypedDict, total=False):
    # Numbers in rows: an array, or nested sequences.
    sprite: NDArray[Any] | Sequence[Sequence[float]] | None
    coc_threshold_px: float | None

HIGHLIGHT_RATIO: float
__version__: str

class DeviceError(RuntimeError): ...

@final
class AxialBlur:
    def __new__(cls, lens: Lens, width: int, height: int) -> AxialBlur: ...
    @property
    def focus_disparity(self, /) -> float: ...
    @property
    def slope_px(self, /) -> float: ...
    def hyperfocal(self, /, radius_px: float) -> float: ...
    def limits(self, /, radius_px: float) -> tuple[float, float]: ...
    def radii_px(self, /, distances: Sequence[float]) -> list[float]: ...
@final
class Device:
    @property
    def id(self, /) -> str: ...
    @property
    def name(self, /) -> str: ...
    @property
    def kind(self, /) -> Literal["discrete", "integrated", "virtual", "software", "other"]: ...
    @property
    def backend(self, /) -> str: ...
    @property
    def driver(self, /) -> str: ...
    @property
    def pci_bus_id(self, /) -> str: ...
    @property
    def visible(self, /) -> bool: ...
    @property
    def memory_bytes(self, /) -> int | None: ...
    @property
    def measures_time(self, /) -> bool: ...
    @property
    def max_buffer_bytes(self, /) -> int: ...
    @property
    def max_binding_bytes(self, /) -> int: ...

@final
class Aperture:
    def __new__(
        cls,
        *,
        blades: int = 0,
        rotation: float = 0.0,
        roundness: float = 0.0,
        ratio: float = 1.0,
        obstruction: float = 0.0,
        apodization: float | None = None,
        spherical: float = 0.0,
        image: NDArray[Any] | _Path | None = None,
    ) -> Aperture: ...
    @staticmethod
    def from_blender(camera: dict[str, Any] | _Path) -> Aperture: ...
    @property
    def blades(self, /) -> int: ...
    @property
    def rotation(self, /) -> float: ...
    @property
    def roundness(self, /) -> float: ...
    @property
    def ratio(self, /) -> float: ...
    @property
    def obstruction(self, /) -> float: ...
    @property
    def apodization(self, /) -> float | None: ...
    @property
    def spherical(self, /) -> float: ...
    @property
    def image(self, /) -> NDArray[np.float64] | None: ...
    def __eq__(self, other: object, /) -> bool: ...
    def __ne__(self, other: object, /) -> bool: ...
    def __hash__(self, /) -> int: ...
    def __getnewargs_ex__(self, /) -> tuple[tuple[()], dict[str, Any]]: ...
    def _repr_html_(self, /) -> str: ...
    def _repr_png_(self, /) -> bytes: ...

@final
class LensMap:
    def __new__(
        cls,
        field: ArrayLike,
        behind: ArrayLike,
        *,
        in_front: ArrayLike | None = None,
        focused: ArrayLike | None = None,
    ) -> LensMap: ...
    @staticmethod
    def from_pictures(
        field: ArrayLike,
        behind: ArrayLike,
        *,
        in_front: ArrayLike | None = None,
        focused: ArrayLike | None = None,
        focused_size: float | None = None,
        points: int = 65,
    ) -> LensMap: ...
    @staticmethod
    def load(path: _Path) -> LensMap: ...
    def save(self, /, path: _Path) -> None: ...
    @property
    def field(self, /) -> NDArray[np.float64] | tuple[NDArray[np.float64], NDArray[np.float64]]: ...
    @property
    def behind(self, /) -> NDArray[np.float64]: ...
    @property
    def in_front(self, /) -> NDArray[np.float64]: ...
    @property
    def focused(self, /) -> NDArray[np.float64]: ...
    def __eq__(self, other: object, /) -> bool: ...
    def __ne__(self, other: object, /) -> bool: ...
    def __hash__(self, /) -> int: ...
    def __getnewargs_ex__(
        self, /
    ) -> tuple[tuple[NDArray[np.float64], NDArray[np.float64]], dict[str, Any]]: ...

@type_check_only
class _LensWords(TypedDict, total=False):
    aperture_radius: float
    focus_distance: float | None
    in_focus: _Pair | None
    fov: float
    fov_axis: _FovAxis
    tilt: _Pair
    field_curvature: float
    axial_color: _Triple
    lateral_color: _Triple
    cat_eye: float
    coma: float
    astigmatism: float
    barn_doors: _Triple | None
    psf: LensMap | None
    vignetting: _Vignetting
    principal_point: _Pair
    sensor_mm: float | None
    breathing_focal_length_mm: float | None
    strength_px: float
    strength_percent: float
    focus: float | None

@final
class Lens:
    def __new__(
        cls,
        *,
        aperture_radius: float,
        focus_distance: float | None = None,
        fov: float,
        fov_axis: _FovAxis = "x",
        in_focus: _Pair | None = None,
        tilt: _Pair = ...,
        field_curvature: float = 0.0,
        axial_color: _Triple = ...,
        lateral_color: _Triple = ...,
        cat_eye: float = 0.0,
        coma: float = 0.0,
        astigmatism: float = 0.0,
        barn_doors: _Triple | None = None,
        psf: LensMap | None = None,
        vignetting: _Vignetting = "none",
        principal_point: _Pair = ...,
        sensor_mm: float | None = None,
        breathing_focal_length_mm: float | None = None,
    ) -> Lens: ...
    @staticmethod
    def from_camera(
        *,
        focal_length_mm: float,
        f_number: float,
        focus_distance: float,
        sensor_width_mm: float | None = None,
        sensor: str | None = None,
        breathing: bool = False,
    ) -> Lens: ...
    @staticmethod
    def from_colmap(
        *,
        fx: float,
        width: int,
        aperture_radius: float,
        focus_distance: float,
        cx: float | None = None,
        cy: float | None = None,
        height: int | None = None,
    ) -> Lens: ...
    # An optiland.optic.Optic, which need not be installed.
    @staticmethod
    def from_optiland(
        optic: Any,
        *,
        focus_distance: float,
        half_diagonal_mm: float,
        field: ArrayLike | None = None,
        points: int = 65,
    ) -> Lens: ...
    # A mitsuba.Sensor, a dict or a path; Mitsuba need not be installed.
    @staticmethod
    def from_mitsuba(sensor: Any) -> Lens: ...
    @staticmethod
    def from_blender(camera: dict[str, Any] | _Path) -> Lens: ...
    @staticmethod
    def from_disparity(
        *,
        strength_px: float | None = None,
        strength_percent: float | None = None,
        focus: float | None = None,
        in_focus: _Pair | None = None,
        axial_color: _Triple = ...,
        lateral_color: _Triple = ...,
        cat_eye: float = 0.0,
        coma: float = 0.0,
        astigmatism: float = 0.0,
        barn_doors: _Triple | None = None,
        psf: LensMap | None = None,
        vignetting: _Vignetting = "none",
        principal_point: _Pair = ...,
    ) -> Lens: ...
    @property
    def aperture_radius(self, /) -> float | None: ...
    @property
    def focus_distance(self, /) -> float | None: ...
    @property
    def fov(self, /) -> float | None: ...
    @property
    def fov_axis(self, /) -> _FovAxis | None: ...
    @property
    def strength_px(self, /) -> float | None: ...
    @property
    def strength_percent(self, /) -> float | None: ...
    @property
    def focus(self, /) -> float | None: ...
    @property
    def in_focus(self, /) -> _Pair | None: ...
    @property
    def tilt(self, /) -> _Pair: ...
    @property
    def field_curvature(self, /) -> float: ...
    @property
    def axial_color(self, /) -> _Triple: ...
    @property
    def lateral_color(self, /) -> _Triple: ...
    @property
    def cat_eye(self, /) -> float: ...
    @property
    def coma(self, /) -> float: ...
    @property
    def astigmatism(self, /) -> float: ...
    @property
    def barn_doors(self, /) -> _Triple | None: ...
    @property
    def psf(self, /) -> LensMap | None: ...
    @property
    def vignetting(self, /) -> _Vignetting: ...
    @property
    def principal_point(self, /) -> _Pair: ...
    @property
    def sensor_mm(self, /) -> float | None: ...
    @property
    def breathing_focal_length_mm(self, /) -> float | None: ...
    @property
    def focal_length_mm(self, /) -> float | None: ...
    @property
    def f_number(self, /) -> float | None: ...
    def replace(self, /, **changes: Unpack[_LensWords]) -> Lens: ...
    def coc_diameter_mm(self, /, z: float) -> float: ...
    def hyperfocal_distance(self, /, coc_limit_mm: float) -> float: ...
    def depth_of_field(self, /, coc_limit_mm: float) -> tuple[float, float]: ...
    def focused_at(
        self,
        /,
        depth: _Depth,
        x: int,
        y: int,
        *,
        radius_px: int = 0,
        depth_kind: _DepthKind = "z",
        near: float | None = None,
        far: float | None = None,
        depth_range: _Pair | None = None,
    ) -> Lens: ...
    def focused_on(
        self,
        /,
        depth: _Depth,
        target: Literal["nearest", "farthest", "centre", "center"] | NDArray[np.bool_],
        *,
        depth_kind: _DepthKind = "z",
        near: float | None = None,
        far: float | None = None,
        depth_range: _Pair | None = None,
    ) -> Lens: ...
    def focused_on_plane(
        self,
        /,
        depth: _Depth,
        pixels: Sequence[tuple[int, int]],
        *,
        depth_kind: _DepthKind = "z",
        near: float | None = None,
        far: float | None = None,
        depth_range: _Pair | None = None,
    ) -> Lens: ...
    def _repr_html_(self, /) -> str: ...
    def __eq__(self, other: object, /) -> bool: ...
    def __ne__(self, other: object, /) -> bool: ...
    def __hash__(self, /) -> int: ...

@final
class Scene:
    def __new__(
        cls,
        color: NDArray[np.floating[Any]] | NDArray[np.integer[Any]],
        depth: _Depth,
        *,
        holdout: _Holdout | None = None,
        guide: _Picture | None = None,
        kinds: _ChannelKinds | None = None,
        device: _Device = "auto",
        depth_kind: _DepthKind = "z",
        near: float | None = None,
        far: float | None = None,
        depth_range: _Pair | None = None,
        invalid: _Invalid = "raise",
        invalid_color: _InvalidColor = "raise",
        alpha: _Alpha | None = None,
        transfer: _Transfer | None = None,
        overscan: int = 0,
        supersample: int = 1,
        refine: bool = False,
    ) -> Scene: ...
    @property
    def depth(self) -> NDArray[np.float32]: ...
    @property
    def filled_pixels(self, /) -> int: ...
    @overload
    def render(
        self,
        /,
        lens: Lens,
        *,
        method: Literal["lens"] = "lens",
        aperture: Aperture | None = None,
        in_focus: _Pair | None = None,
        max_coc_px: float | None = None,
        threads: int | None = None,
        out: NDArray[Any] | None = None,
        **options: Unpack[_LensOptions],
    ) -> NDArray[Any]: ...
    @overload
    def render(
        self,
        /,
        lens: Lens,
        *,
        method: Literal["poisson"],
        aperture: Aperture | None = None,
        in_focus: _Pair | None = None,
        max_coc_px: float | None = None,
        threads: int | None = None,
        out: NDArray[Any] | None = None,
        **options: Unpack[_PoissonOptions],
    ) -> NDArray[Any]: ...
    @overload
    def render(
        self,
        /,
        lens: Lens,
        *,
        method: Literal["gaussian"],
        aperture: Aperture | None = None,
        in_focus: _Pair | None = None,
        max_coc_px: float | None = None,
        threads: int | None = None,
        out: NDArray[Any] | None = None,
        **options: Unpack[_GaussianOptions],
    ) -> NDArray[Any]: ...
    @overload
    def render(
        self,
        /,
        lens: Lens,
        *,
        method: Literal["taps"],
        aperture: Aperture | None = None,
        in_focus: _Pair | None = None,
        max_coc_px: float | None = None,
        threads: int | None = None,
        out: NDArray[Any] | None = None,
        **options: Unpack[_TapsOptions],
    ) -> NDArray[Any]: ...
    @overload
    def render(
        self,
        /,
        lens: Lens,
        *,
        method: Literal["hexagonal"],
        aperture: Aperture | None = None,
        in_focus: _Pair | None = None,
        max_coc_px: float | None = None,
        threads: int | None = None,
        out: NDArray[Any] | None = None,
        **options: Unpack[_HexagonalOptions],
    ) -> NDArray[Any]: ...
    @overload
    def render(
        self,
        /,
        lens: Lens,
        *,
        method: Literal["levels"],
        aperture: Aperture | None = None,
        in_focus: _Pair | None = None,
        max_coc_px: float | None = None,
        threads: int | None = None,
        out: NDArray[Any] | None = None,
        **options: Unpack[_LevelsOptions],
    ) -> NDArray[Any]: ...
    @overload
    def render(
        self,
        /,
        lens: Lens,
        *,
        method: Literal["sprites"],
        aperture: Aperture | None = None,
        in_focus: _Pair | None = None,
        max_coc_px: float | None = None,
        threads: int | None = None,
        out: NDArray[Any] | None = None,
        **options: Unpack[_SpritesOptions],
    ) -> NDArray[Any]: ...
    @overload
    def focal_stack(
        self,
        /,
        lens: Lens,
        distances: Sequence[float | _Pair] | NDArray[np.floating[Any]],
        *,
        method: Literal["lens"] = "lens",
        aperture: Aperture | None = None,
        max_coc_px: float | None = None,
        threads: int | None = None,
        out: NDArray[Any] | None = None,
        **options: Unpack[_LensOptions],
    ) -> NDArray[Any]: ...
    @overload
    def focal_stack(
        self,
        /,
        lens: Lens,
        distances: Sequence[float | _Pair] | NDArray[np.floating[Any]],
        *,
        method: Literal["poisson"],
        aperture: Aperture | None = None,
        max_coc_px: float | None = None,
        threads: int | None = None,
        out: NDArray[Any] | None = None,
        **options: Unpack[_PoissonOptions],
    ) -> NDArray[Any]: ...
    @overload
    def focal_stack(
        self,
        /,
        lens: Lens,
        distances: Sequence[float | _Pair] | NDArray[np.floating[Any]],
        *,
        method: Literal["gaussian"],
        aperture: Aperture | None = None,
        max_coc_px: float | None = None,
        threads: int | None = None,
        out: NDArray[Any] | None = None,
        **options: Unpack[_GaussianOptions],
    ) -> NDArray[Any]: ...
    @overload
    def focal_stack(
        self,
        /,
        lens: Lens,
        distances: Sequence[float | _Pair] | NDArray[np.floating[Any]],
        *,
        method: Literal["taps"],
        aperture: Aperture | None = None,
        max_coc_px: float | None = None,
        threads: int | None = None,
        out: NDArray[Any] | None = None,
        **options: Unpack[_TapsOptions],
    ) -> NDArray[Any]: ...
    @overload
    def focal_stack(
        self,
        /,
        lens: Lens,
        distances: Sequence[float | _Pair] | NDArray[np.floating[Any]],
        *,
        method: Literal["hexagonal"],
        aperture: Aperture | None = None,
        max_coc_px: float | None = None,
        threads: int | None = None,
        out: NDArray[Any] | None = None,
        **options: Unpack[_HexagonalOptions],
    ) -> NDArray[Any]: ...
    @overload
    def focal_stack(
        self,
        /,
        lens: Lens,
        distances: Sequence[float | _Pair] | NDArray[np.floating[Any]],
        *,
        method: Literal["levels"],
        aperture: Aperture | None = None,
        max_coc_px: float | None = None,
        threads: int | None = None,
        out: NDArray[Any] | None = None,
        **options: Unpack[_LevelsOptions],
    ) -> NDArray[Any]: ...
    @overload
    def focal_stack(
        self,
        /,
        lens: Lens,
        distances: Sequence[float | _Pair] | NDArray[np.floating[Any]],
        *,
        method: Literal["sprites"],
        aperture: Aperture | None = None,
        max_coc_px: float | None = None,
        threads: int | None = None,
        out: NDArray[Any] | None = None,
        **options: Unpack[_SpritesOptions],
    ) -> NDArray[Any]: ...
    @overload
    def profile(
        self,
        /,
        lens: Lens,
        *,
        method: Literal["lens"] = "lens",
        aperture: Aperture | None = None,
        in_focus: _Pair | None = None,
        max_coc_px: float | None = None,
        threads: int | None = None,
        **options: Unpack[_LensOptions],
    ) -> list[tuple[str, float]]: ...
    @overload
    def profile(
        self,
        /,
        lens: Lens,
        *,
        method: Literal["poisson"],
        aperture: Aperture | None = None,
        in_focus: _Pair | None = None,
        max_coc_px: float | None = None,
        threads: int | None = None,
        **options: Unpack[_PoissonOptions],
    ) -> list[tuple[str, float]]: ...
    @overload
    def profile(
        self,
        /,
        lens: Lens,
        *,
        method: Literal["gaussian"],
        aperture: Aperture | None = None,
        in_focus: _Pair | None = None,
        max_coc_px: float | None = None,
        threads: int | None = None,
        **options: Unpack[_GaussianOptions],
    ) -> list[tuple[str, float]]: ...
    @overload
    def profile(
        self,
        /,
        lens: Lens,
        *,
        method: Literal["taps"],
        aperture: Aperture | None = None,
        in_focus: _Pair | None = None,
        max_coc_px: float | None = None,
        threads: int | None = None,
        **options: Unpack[_TapsOptions],
    ) -> list[tuple[str, float]]: ...
    @overload
    def profile(
        self,
        /,
        lens: Lens,
        *,
        method: Literal["hexagonal"],
        aperture: Aperture | None = None,
        in_focus: _Pair | None = None,
        max_coc_px: float | None = None,
        threads: int | None = None,
        **options: Unpack[_HexagonalOptions],
    ) -> list[tuple[str, float]]: ...
    @overload
    def profile(
        self,
        /,
        lens: Lens,
        *,
        method: Literal["levels"],
        aperture: Aperture | None = None,
        in_focus: _Pair | None = None,
        max_coc_px: float | None = None,
        threads: int | None = None,
        **options: Unpack[_LevelsOptions],
    ) -> list[tuple[str, float]]: ...
    @overload
    def profile(
        self,
        /,
        lens: Lens,
        *,
        method: Literal["sprites"],
        aperture: Aperture | None = None,
        in_focus: _Pair | None = None,
        max_coc_px: float | None = None,
        threads: int | None = None,
        **options: Unpack[_SpritesOptions],
    ) -> list[tuple[str, float]]: ...

@final
class _Gradients:
    def __new__(
        cls,
        scene: Scene,
        lens: Lens,
        cotangent: NDArray[np.float32],
        *,
        aperture: Aperture | None = None,
        max_coc_px: float | None = None,
        threads: int | None = None,
        **options: Unpack[_LensOptions],
    ) -> _Gradients: ...
    def find(
        self, /, by_color: bool, by_depth: bool
    ) -> tuple[NDArray[np.float32] | None, tuple[NDArray[np.float32], float, float] | None]: ...

@final
class Beside:
    @property
    def profile(self, /) -> bytes | None: ...
    @property
    def exif(self, /) -> bytes | None: ...
    @property
    def orientation(self, /) -> int: ...

@final
class ExrPart:
    @property
    def name(self, /) -> str | None: ...
    @property
    def channels(self, /) -> list[str]: ...
    @property
    def sample_types(self, /) -> list[Literal["half", "float", "uint"]]: ...
    @property
    def data_window(self, /) -> tuple[int, int, int, int]: ...
    @property
    def display_window(self, /) -> tuple[int, int, int, int]: ...
    @property
    def pixel_aspect(self, /) -> float: ...

def chosen_device(name: str) -> str: ...
def device_bytes() -> int: ...
def device_submissions() -> tuple[int, float]: ...
def device_traffic() -> dict[str, int]: ...
def devices() -> list[Device]: ...
def lacking_for_gpu() -> list[str]: ...
def coc(
    depth: _Depth,
    lens: Lens,
    *,
    depth_kind: _DepthKind = "z",
    near: float | None = None,
    far: float | None = None,
    depth_range: _Pair | None = None,
    invalid: _Invalid = "raise",
    in_focus: _Pair | None = None,
    max_coc_px: float | None = None,
) -> NDArray[np.float32]: ...
def layers_from_matte(
    color: NDArray[np.floating[Any]] | NDArray[np.integer[Any]],
    matte: NDArray[np.floating[Any]],
    depth: NDArray[np.floating[Any]],
    *,
    transfer: _Transfer | None = None,
    threads: int | None = None,
) -> tuple[NDArray[np.float32], NDArray[np.float32]]: ...
def layers_from_views(
    colors: _Pictures,
    depths: NDArray[np.floating[Any]] | Sequence[NDArray[np.floating[Any]]],
    poses: ArrayLike,
    intrinsics: ArrayLike,
    *,
    reference: int = 0,
    layers: int = 4,
    lens: Lens | None = None,
    depth_kind: _DepthKind = "z",
    near: float | None = None,
    far: float | None = None,
    invalid: _Invalid = "raise",
    invalid_color: _InvalidColor = "raise",
    alpha: _Alpha | None = None,
    transfer: _Transfer | None = None,
    overscan: int = 0,
    supersample: int = 1,
    threads: int | None = None,
    flow: NDArray[np.floating[Any]] | Sequence[NDArray[np.floating[Any]] | None] | None = None,
) -> tuple[NDArray[np.float32], NDArray[np.float32]]: ...
def restore_highlights(
    color: NDArray[np.floating[Any]] | NDArray[np.integer[Any]],
    *,
    gains: NDArray[np.floating[Any]] | None = None,
    max_gain: float = 16.0,
    alpha: _Alpha | None = None,
    transfer: _Transfer | None = None,
    threads: int | None = None,
) -> NDArray[np.float32]: ...
@overload
def refine_depth(
    color: NDArray[np.floating[Any]] | NDArray[np.integer[Any]],
    depth: _Depth,
    *,
    depth_kind: _DepthKind = "z",
    near: float | None = None,
    far: float | None = None,
    invalid: _Invalid = "raise",
    invalid_color: _InvalidColor = "raise",
    alpha: _Alpha | None = None,
    transfer: _Transfer | None = None,
    threads: int | None = None,
    return_coverage: Literal[False] = False,
) -> NDArray[np.float32]: ...
@overload
def refine_depth(
    color: NDArray[np.floating[Any]] | NDArray[np.integer[Any]],
    depth: _Depth,
    *,
    depth_kind: _DepthKind = "z",
    near: float | None = None,
    far: float | None = None,
    invalid: _Invalid = "raise",
    invalid_color: _InvalidColor = "raise",
    alpha: _Alpha | None = None,
    transfer: _Transfer | None = None,
    threads: int | None = None,
    return_coverage: Literal[True],
) -> tuple[NDArray[np.float32], NDArray[np.float32]]: ...
@overload
def render(
    color: NDArray[_Sample],
    depth: _Depth,
    lens: Lens,
    *,
    holdout: _Holdout | None = None,
    guide: _Picture | None = None,
    kinds: _ChannelKinds | None = None,
    method: Literal["lens"] = "lens",
    device: _Device = "auto",
    aperture: Aperture | None = None,
    depth_kind: _DepthKind = "z",
    near: float | None = None,
    far: float | None = None,
    depth_range: _Pair | None = None,
    invalid: _Invalid = "raise",
    invalid_color: _InvalidColor = "raise",
    alpha: _Alpha | None = None,
    transfer: _Transfer | None = None,
    overscan: int = 0,
    supersample: int = 1,
    in_focus: _Pair | None = None,
    max_coc_px: float | None = None,
    refine: bool = False,
    threads: int | None = None,
    out: NDArray[Any] | None = None,
    **options: Unpack[_LensOptions],
) -> NDArray[_Sample]: ...
@overload
def render(
    color: NDArray[_Sample],
    depth: _Depth,
    lens: Lens,
    *,
    method: Literal["poisson"],
    device: _Device = "auto",
    aperture: Aperture | None = None,
    depth_kind: _DepthKind = "z",
    near: float | None = None,
    far: float | None = None,
    depth_range: _Pair | None = None,
    invalid: _Invalid = "raise",
    invalid_color: _InvalidColor = "raise",
    alpha: _Alpha | None = None,
    transfer: _Transfer | None = None,
    overscan: int = 0,
    supersample: int = 1,
    in_focus: _Pair | None = None,
    max_coc_px: float | None = None,
    refine: bool = False,
    threads: int | None = None,
    out: NDArray[Any] | None = None,
    **options: Unpack[_PoissonOptions],
) -> NDArray[_Sample]: ...
@overload
def render(
    color: NDArray[_Sample],
    depth: _Depth,
    lens: Lens,
    *,
    method: Literal["gaussian"],
    device: _Device = "auto",
    aperture: Aperture | None = None,
    depth_kind: _DepthKind = "z",
    near: float | None = None,
    far: float | None = None,
    depth_range: _Pair | None = None,
    invalid: _Invalid = "raise",
    invalid_color: _InvalidColor = "raise",
    alpha: _Alpha | None = None,
    transfer: _Transfer | None = None,
    overscan: int = 0,
    supersample: int = 1,
    in_focus: _Pair | None = None,
    max_coc_px: float | None = None,
    refine: bool = False,
    threads: int | None = None,
    out: NDArray[Any] | None = None,
    **options: Unpack[_GaussianOptions],
) -> NDArray[_Sample]: ...
@overload
def render(
    color: NDArray[_Sample],
    depth: _Depth,
    lens: Lens,
    *,
    method: Literal["taps"],
    device: _Device = "auto",
    aperture: Aperture | None = None,
    depth_kind: _DepthKind = "z",
    near: float | None = None,
    far: float | None = None,
    depth_range: _Pair | None = None,
    invalid: _Invalid = "raise",
    invalid_color: _InvalidColor = "raise",
    alpha: _Alpha | None = None,
    transfer: _Transfer | None = None,
    overscan: int = 0,
    supersample: int = 1,
    in_focus: _Pair | None = None,
    max_coc_px: float | None = None,
    refine: bool = False,
    threads: int | None = None,
    out: NDArray[Any] | None = None,
    **options: Unpack[_TapsOptions],
) -> NDArray[_Sample]: ...
@overload
def render(
    color: NDArray[_Sample],
    depth: _Depth,
    lens: Lens,
    *,
    method: Literal["hexagonal"],
    device: _Device = "auto",
    aperture: Aperture | None = None,
    depth_kind: _DepthKind = "z",
    near: float | None = None,
    far: float | None = None,
    depth_range: _Pair | None = None,
    invalid: _Invalid = "raise",
    invalid_color: _InvalidColor = "raise",
    alpha: _Alpha | None = None,
    transfer: _Transfer | None = None,
    overscan: int = 0,
    supersample: int = 1,
    in_focus: _Pair | None = None,
    max_coc_px: float | None = None,
    refine: bool = False,
    threads: int | None = None,
    out: NDArray[Any] | None = None,
    **options: Unpack[_HexagonalOptions],
) -> NDArray[_Sample]: ...
@overload
def render(
    color: NDArray[_Sample],
    depth: _Depth,
    lens: Lens,
    *,
    method: Literal["levels"],
    device: _Device = "auto",
    aperture: Aperture | None = None,
    depth_kind: _DepthKind = "z",
    near: float | None = None,
    far: float | None = None,
    depth_range: _Pair | None = None,
    invalid: _Invalid = "raise",
    invalid_color: _InvalidColor = "raise",
    alpha: _Alpha | None = None,
    transfer: _Transfer | None = None,
    overscan: int = 0,
    supersample: int = 1,
    in_focus: _Pair | None = None,
    max_coc_px: float | None = None,
    refine: bool = False,
    threads: int | None = None,
    out: NDArray[Any] | None = None,
    **options: Unpack[_LevelsOptions],
) -> NDArray[_Sample]: ...
@overload
def render(
    color: NDArray[_Sample],
    depth: _Depth,
    lens: Lens,
    *,
    method: Literal["sprites"],
    device: _Device = "auto",
    aperture: Aperture | None = None,
    depth_kind: _DepthKind = "z",
    near: float | None = None,
    far: float | None = None,
    depth_range: _Pair | None = None,
    invalid: _Invalid = "raise",
    invalid_color: _InvalidColor = "raise",
    alpha: _Alpha | None = None,
    transfer: _Transfer | None = None,
    overscan: int = 0,
    supersample: int = 1,
    in_focus: _Pair | None = None,
    max_coc_px: float | None = None,
    refine: bool = False,
    threads: int | None = None,
    out: NDArray[Any] | None = None,
    **options: Unpack[_SpritesOptions],
) -> NDArray[_Sample]: ...
def focusable_pixels(
    lens: Lens,
    depth: _Depth,
    *,
    depth_kind: _DepthKind = "z",
    near: float | None = None,
    far: float | None = None,
    depth_range: _Pair | None = None,
) -> NDArray[np.int64]: ...
def methods_available() -> list[str]: ...
def release_devices() -> None: ...
def restrict_devices(
    *,
    max_binding_bytes: int | None = None,
    memory_bytes: int | None = None,
    room_bytes: int | None = None,
    submission_s: float | None = None,
    quotient: float | None = None,
) -> None: ...
def sensors() -> list[tuple[str, float, float]]: ...
def simd_available() -> list[Literal["portable", "avx2", "avx512"]]: ...

# Files; `dofsim.io` is the public face of these.

def decode_by_curves(codes: NDArray[Any], curves: NDArray[np.float32]) -> NDArray[np.float32]: ...
def encode_by_curves(
    values: NDArray[np.float32], curves: NDArray[np.float32], *, sixteen: bool
) -> NDArray[Any]: ...
def parse_profile(icc: bytes, lights: int) -> tuple[str, NDArray[np.float32], list[list[float]]]: ...
def decode_codes(codes: NDArray[Any], *, srgb: bool, alpha: bool) -> NDArray[np.float32]: ...
def encode_codes(values: NDArray[np.float32], *, sixteen: bool, alpha: bool) -> NDArray[Any]: ...
def encode_png(pixels: NDArray[Any]) -> bytes: ...
def exr_parts(path: _Path) -> list[ExrPart]: ...
def file_kind(path: _Path) -> Literal[
    "exr", "png", "jpeg", "webp", "bmp", "hdr", "tiff", "pfm", "npy", "npz"
]: ...
def layers_of_samples(
    counts: NDArray[np.uint32],
    channels: dict[str, NDArray[np.float32]],
    max_layers: int,
    *,
    window: _Window,
    means: Sequence[tuple[str, Literal["light", "data"]]] = ...,
    ids: Sequence[Sequence[str]] = ...,
) -> tuple[
    NDArray[np.float32], NDArray[np.float32], NDArray[np.float32], list[NDArray[np.float32]]
]: ...
def deep_exr_part(path: _Path) -> tuple[int, ExrPart] | None: ...
def read_deep_exr(
    path: _Path, channels: list[str]
) -> tuple[NDArray[np.uint32], dict[str, NDArray[np.float32]], _Window, _Window] | None: ...
def read_exr(
    path: _Path, part: int, channels: list[str], *, data: bool, fill: float
) -> NDArray[np.float32]: ...
def read_raster(path: _Path, *, turned: bool = False) -> tuple[NDArray[Any], _Alpha, Beside]: ...
def write_bytes(path: _Path, bytes: bytes) -> None: ...
def write_exr(
    path: _Path,
    parts: list[tuple[str | None, list[tuple[str, NDArray[Any]]]]],
    *,
    compression: str,
    attributes_of: _Path | None = None,
    corner: tuple[int, int] | None = None,
    like: list[int] | None = None,
) -> None: ...
def write_pfm(path: _Path, pixels: NDArray[Any]) -> None: ...
def write_png(path: _Path, pixels: NDArray[Any], profile: bytes | None = None) -> None: ...
def write_tiff(
    path: _Path, pixels: NDArray[Any], premultiplied: bool, profile: bytes | None = None
) -> None: ...
