"""The options of the command line, each declared once, and the groups that commands share."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass, fields, is_dataclass
from inspect import Parameter, Signature, signature
from pathlib import Path
from typing import Annotated, Any, TypeVar, get_type_hints

import typer

import dofsim

from . import _options
from ._options import INTEGER_DEPTH, UNITS

T = TypeVar("T")

# The subjects that help lists options by.
_LENS, _APERTURE, _DEPTH, _PICTURE, _RENDERING = "Lens", "Aperture", "Depth", "Picture", "Rendering"

OutputFolder = Annotated[
    Path,
    typer.Option("--output", "-o", metavar="FOLDER", help="Folder to write into; made if it is not there."),
]
ApertureRadius = Annotated[
    float | None,
    typer.Option(metavar="METRES", help="Radius of the aperture in metres.", rich_help_panel=_LENS),
]
FocusDistance = Annotated[
    float | None,
    typer.Option(metavar="METRES", help="Distance of the plane in focus, in metres.", rich_help_panel=_LENS),
]
FocusAt = Annotated[
    str | None,
    typer.Option(
        metavar="X,Y",
        help="Focus on the surface at this pixel: column and row of the depth map, without its margin.",
        rich_help_panel=_LENS,
    ),
]
InFocus = Annotated[
    str | None,
    typer.Option(
        metavar="NEAR,FAR",
        help="Keep a range in focus in place of a plane: its ends in metres, of which the farther may be "
        "inf. With --strength-px or --strength-percent, the ends are disparities.",
        rich_help_panel=_LENS,
    ),
]
Fov = Annotated[
    float | None,
    typer.Option(metavar="DEGREES", help="Field of view of the camera, in degrees.", rich_help_panel=_LENS),
]
FovAxis = Annotated[
    str | None,
    typer.Option(
        metavar="AXIS",
        help="What --fov spans: x (default), y, diagonal, smaller or larger.",
        rich_help_panel=_LENS,
    ),
]
FocalLength = Annotated[
    float | None,
    typer.Option(metavar="MM", help="Focal length in millimetres.", rich_help_panel=_LENS),
]
FNumber = Annotated[
    float | None,
    typer.Option(
        metavar="N", help="f-number: focal length over diameter of the aperture.", rich_help_panel=_LENS
    ),
]
SensorWidth = Annotated[
    float | None,
    typer.Option(
        metavar="MM", help="Width of the sensor in millimetres (default 36).", rich_help_panel=_LENS
    ),
]
StrengthPx = Annotated[
    float | None,
    typer.Option(
        metavar="PIXELS",
        help="For relative depth: the blur's radius, in pixels, of a surface one unit of disparity from the "
        "focus. With --depth-kind relative the whole scene spans one unit.",
        rich_help_panel=_LENS,
    ),
]
StrengthPercent = Annotated[
    float | None,
    typer.Option(
        metavar="PERCENT",
        help="The same radius in percent of the picture's width; 2 to 5 are usual.",
        rich_help_panel=_LENS,
    ),
]
Focus = Annotated[
    float | None,
    typer.Option(
        metavar="DISPARITY",
        help="For relative depth: the disparity in focus. With --depth-kind relative, 0 is the farthest "
        "surface and 1 the nearest.",
        rich_help_panel=_LENS,
    ),
]
LensFile = Annotated[
    Path | None,
    typer.Option(
        "--lens",
        metavar="FILE",
        help="TOML file with the options above, spelt with underscores, and all others of dofsim.Lens. Those "
        "of dofsim.Aperture are in its table [aperture]. Or a Blender camera (.json) or a Mitsuba scene "
        "(.xml). Options given beside it win.",
        rich_help_panel=_LENS,
    ),
]
Blades = Annotated[
    int | None,
    typer.Option(metavar="N", help="Blades of the aperture; 0 is round.", rich_help_panel=_APERTURE),
]
Rotation = Annotated[
    float | None,
    typer.Option(metavar="DEGREES", help="Rotation of the blades in degrees.", rich_help_panel=_APERTURE),
]
Preset = Annotated[
    str | None,
    typer.Option(
        metavar="NAME",
        help="Read depth as it is written by: hypersim, kitti, nyu, tum, scannet, middlebury, sintel, "
        "mitsuba, blender. The options below win.",
        rich_help_panel=_DEPTH,
    ),
]
DepthKind = Annotated[
    str | None,
    typer.Option(
        metavar="KIND",
        help="What depth measures: z (default: metres along the optical axis), distance (metres along the "
        "ray), inverse_z (1/metres), disparity, relative (disparity of any scale, as networks estimate it), "
        "zbuffer, opengl_ndc or distance_from_near.",
        rich_help_panel=_DEPTH,
    ),
]
Near = Annotated[
    float | None,
    typer.Option(
        metavar="METRES",
        help="Near plane in metres, of z-buffers; the far plane of a reversed one. May be inf.",
        rich_help_panel=_DEPTH,
    ),
]
Far = Annotated[
    float | None,
    typer.Option(
        metavar="METRES",
        help="Far plane in metres, of z-buffers; the near plane of a reversed one. May be inf.",
        rich_help_panel=_DEPTH,
    ),
]
DepthScale = Annotated[
    float | None,
    typer.Option(
        metavar="FACTOR",
        help="Depth is multiplied by this: 0.001 for millimetres, -1 for depth along -z.",
        rich_help_panel=_DEPTH,
    ),
]
DepthMissing = Annotated[
    float | None,
    typer.Option(
        metavar="VALUE",
        help="The value in the file that means there is no reading; see --invalid.",
        rich_help_panel=_DEPTH,
    ),
]
DepthChannel = Annotated[
    str | None,
    typer.Option(
        metavar="NAME", help="Channel of an OpenEXR file, or array of an NPZ file.", rich_help_panel=_DEPTH
    ),
]
EACH = "each"
"""What ``--depth-range`` says for a scale of each picture's own."""
DepthRange = Annotated[
    str | None,
    typer.Option(
        metavar="FAR,NEAR|each",
        help="Of relative depth, the values that are far and near, or those of each picture by itself. "
        "`batch` takes those of all its frames by default.",
        rich_help_panel=_DEPTH,
    ),
]
Invalid = Annotated[
    str,
    typer.Option(
        metavar="WHAT",
        help="What to do with invalid depth (NaN, negative or zero): raise (an error, default) or far (take "
        "it for the background).",
        rich_help_panel=_DEPTH,
    ),
]
Holdout = Annotated[
    Path | None,
    typer.Option(
        metavar="FILE",
        help="A picture with depth and alpha (OpenEXR, flat or deep, or NPZ) that blocks the light of what "
        "is behind it and is not seen itself. Its colour plays no part.",
        rich_help_panel=_PICTURE,
    ),
]
Layer = Annotated[
    str | None,
    typer.Option(
        metavar="NAME", help="Layer of an OpenEXR file that is the picture.", rich_help_panel=_PICTURE
    ),
]
Transfer = Annotated[
    str | None,
    typer.Option(
        metavar="CURVE",
        help="What an integer picture holds: srgb (default) or linear.",
        rich_help_panel=_PICTURE,
    ),
]
Alpha = Annotated[
    str | None,
    typer.Option(
        metavar="KIND",
        help="What a second or fourth channel is: straight, premultiplied or none.",
        rich_help_panel=_PICTURE,
    ),
]
InvalidColor = Annotated[
    str,
    typer.Option(
        metavar="WHAT",
        help="What to do with pixels whose colour is NaN or infinite: raise (an error, default) or fill "
        "(with the mean of those around them).",
        rich_help_panel=_PICTURE,
    ),
]
WindowOption = Annotated[
    str | None,
    typer.Option(
        metavar="WINDOW",
        help="Which pixels of an OpenEXR file to use: display (default), or data. With data, the pixels "
        "stored beyond the display window are overscan.",
        rich_help_panel=_PICTURE,
    ),
]
Overscan = Annotated[
    int,
    typer.Option(
        metavar="PIXELS",
        help="Margin on every side that the lens sees and the output lacks, in pixels of the output. In an "
        "OpenEXR file, what is stored beyond the display window is used if that is enough; else, and in any "
        "other file, the margin is cut from the picture.",
        rich_help_panel=_PICTURE,
    ),
]
Supersample = Annotated[
    int,
    typer.Option(
        metavar="N",
        help="The picture has this many times the pixels of the output along each axis.",
        rich_help_panel=_PICTURE,
    ),
]
MaxCoc = Annotated[
    float | None,
    typer.Option(
        "--max-coc-px",
        metavar="PIXELS",
        help="Bound on the blur: no radius of a circle of confusion is larger, in pixels.",
        rich_help_panel=_RENDERING,
    ),
]
RefineDepth = Annotated[
    bool,
    typer.Option(
        "--refine-depth",
        help="Sharpen soft, coarse or noisy depth first; it may then be of any size.",
        rich_help_panel=_DEPTH,
    ),
]
Method = Annotated[
    str,
    typer.Option(
        metavar="NAME",
        help="How to compute: lens (default), sprites, hexagonal, poisson, gaussian, levels or taps.",
        rich_help_panel=_RENDERING,
    ),
]
MethodOptions = Annotated[
    list[str] | None,
    typer.Option(
        "--set",
        metavar="NAME=VALUE",
        help="An option of the method, such as views=512; may be repeated.",
        rich_help_panel=_RENDERING,
    ),
]
Device = Annotated[
    str,
    typer.Option(
        metavar="NAME",
        help="Where to compute: auto, cpu, gpu, or an adapter that `dofsim devices` lists.",
        rich_help_panel=_RENDERING,
    ),
]
Threads = Annotated[
    int | None,
    typer.Option(metavar="N", help="Threads to use; all processors by default.", rich_help_panel=_RENDERING),
]
SampleType = Annotated[
    str | None,
    typer.Option(
        "--dtype",
        metavar="TYPE",
        help="Samples of the output: half or float (OpenEXR), uint8 or uint16 (PNG, TIFF).",
    ),
]
Channels = Annotated[
    list[str] | None,
    typer.Option(
        "--channels",
        metavar="PATTERN",
        help='Render these channels or layers of an OpenEXR or NPZ file, "*" for all, by the picture: each '
        "comes back in its part, under its name and in its type. May be repeated.",
        rich_help_panel=_PICTURE,
    ),
]
Kinds = Annotated[
    list[str] | None,
    typer.Option(
        "--kind",
        metavar="NAME=KIND",
        help="What channels or layers hold, where their names do not tell it: light, matte, data, normal, "
        "id, or none (left out). May be repeated.",
        rich_help_panel=_PICTURE,
    ),
]
Quiet = Annotated[bool, typer.Option("--quiet", "-q", help="Print errors and warnings only.")]
Verbose = Annotated[
    bool, typer.Option("--verbose", "-v", help="Print also the lens, the method and what was read.")
]


@dataclass(frozen=True, kw_only=True)
class LensOptions:
    """The options that describe a lens and its focus."""

    aperture_radius: ApertureRadius = None
    focus_distance: FocusDistance = None
    focus_at: FocusAt = None
    in_focus: InFocus = None
    fov: Fov = None
    fov_axis: FovAxis = None
    focal_length_mm: FocalLength = None
    f_number: FNumber = None
    sensor_width_mm: SensorWidth = None
    strength_px: StrengthPx = None
    strength_percent: StrengthPercent = None
    focus: Focus = None
    lens_file: LensFile = None

    @property
    def words(self) -> dict[str, Any]:
        """The words of the lens, None where they are not given."""
        words = {name: value for name, value in vars(self).items() if name not in ("focus_at", "lens_file")}
        return {**words, "in_focus": None if self.in_focus is None else _options.read_range(self.in_focus)}

    def read(self, depth: Any, aperture: ApertureOptions | None = None, **kind: Any) -> tuple[Any, Any]:
        """Read the words of the lens, focused on a pixel of the depth if one is named, and of the aperture.

        Parameters
        ----------
        depth : ndarray
            The depth map, shape (H, W).
        aperture : ApertureOptions, optional
            The options of the aperture.
        **kind
            ``depth_kind``, ``near`` and ``far`` of `dofsim.Lens.focused_at`.

        Returns
        -------
        tuple of dict
            The words of the lens and those of the aperture.
        """
        words, opening = _options.read_settings(
            self.lens_file, self.words, vars(aperture) if aperture else {}
        )
        if self.focus_at is not None:
            words = _options.focused_words(words, _options.read_pixel(self.focus_at), depth, **kind)
        return words, opening


@dataclass(frozen=True, kw_only=True)
class ApertureOptions:
    """The options that describe an aperture."""

    blades: Blades = None
    rotation: Rotation = None


@dataclass(frozen=True, kw_only=True)
class DepthOptions:
    """The options that say what depth measures, and how a file holds it."""

    preset: Preset = None
    depth_kind: DepthKind = None
    near: Near = None
    far: Far = None
    depth_scale: DepthScale = None
    depth_missing: DepthMissing = None
    depth_channel: DepthChannel = None
    depth_range: DepthRange = None
    invalid: Invalid = "raise"

    def read(self) -> tuple[dict[str, Any], dict[str, Any]]:
        """Give the words of depth that `dofsim.render` takes, and those that `dofsim.io.read_rgbd` takes."""
        kind, reading = _options.read_preset(
            self.preset, self.depth_kind, self.depth_scale, self.depth_missing
        )
        kind_words: dict[str, Any] = {"depth_kind": kind, "near": self.near, "far": self.far}
        if self.depth_range not in (None, EACH):
            what = f"two disparities, FAR,NEAR, or {EACH}"
            kind_words["depth_range"] = _options.read_numbers("--depth-range", self.depth_range, float, what)
        return kind_words, {"depth_channel": self.depth_channel, **reading}


@dataclass(frozen=True, kw_only=True)
class RenderOptions:
    """The options that say what the picture is, and how and where it is rendered."""

    layer: Layer = None
    transfer: Transfer = None
    alpha: Alpha = None
    invalid_color: InvalidColor = "raise"
    max_coc_px: MaxCoc = None
    refine_depth: RefineDepth = False
    method: Method = "lens"
    method_options: MethodOptions = None
    device: Device = "auto"
    window: WindowOption = None
    overscan: Overscan = 0
    supersample: Supersample = 1
    threads: Threads = None

    def framing(self) -> dict[str, Any]:
        """Give the words of `dofsim._frame.read_framed`."""
        window = _options.one_of("--window", self.window, ("display", "data"))
        return {"window": window, "overscan": self.overscan, "supersample": self.supersample}

    def method_words(self, opening: dict[str, Any]) -> dict[str, Any]:
        """Give the method and its options, with the aperture of these words."""
        chosen = _options.read_method_options(self.method_options or [])
        if own := [name for name in chosen if name in _OPTIONS and name != "max_coc_px"]:
            raise ValueError(f"--set {own[0]}: it is an option of its own, {_OPTIONS[own[0]]}")
        if self.max_coc_px is not None:
            if "max_coc_px" in chosen:
                raise ValueError("--max-coc-px is given twice: as an option and as --set max_coc_px")
            chosen["max_coc_px"] = self.max_coc_px
        return {
            "method": self.method,
            "threads": self.threads,
            **chosen,
            **({"aperture": dofsim.Aperture(**opening)} if opening else {}),
        }


def in_options(message: str) -> str:
    """Put what the library says of its arguments into the words of the command line.

    Parameters
    ----------
    message : str
        What is wrong, as an exception has it.

    Returns
    -------
    str
        The same with the names of options.

    Examples
    --------
    >>> from dofsim._command_options import in_options
    >>> in_options("aperture_radius must be a radius in metres; got -1")
    '--aperture-radius must be a radius in metres; got -1'
    """
    if _OF_FILES.search(message):
        return message
    for words, option in _SAID.items():
        message = message.replace(words, option)
    message = _GIVEN.sub(lambda found: f"{_OPTIONS[found[1]]} {found[2] or found[3]}", message)
    message = _NAMED.sub(lambda found: _OPTIONS[found[0]], message)
    for after in (" must ", ": "):
        name, found, rest = message.partition(after)
        if name in _OPTIONS:
            return f"{_OPTIONS[name]}{found}{rest}"
    return message


def with_groups(command: Callable[..., T]) -> Callable[..., T]:
    """Show Typer the options of a command's groups as options of the command itself.

    Parameters
    ----------
    command : callable
        A command. A parameter whose type is one of the data classes above stands for all of their fields.

    Returns
    -------
    callable
        The command with these fields as parameters, in the place of the group.
    """
    hints = get_type_hints(command, include_extras=True)
    groups: dict[str, Any] = {name: hint for name, hint in hints.items() if is_dataclass(hint)}
    parameters: list[Parameter] = []
    for name, parameter in signature(command).parameters.items():
        if name in groups:
            own = get_type_hints(groups[name], include_extras=True)
            parameters += [
                Parameter(
                    field.name, Parameter.KEYWORD_ONLY, default=field.default, annotation=own[field.name]
                )
                for field in fields(groups[name])
            ]
        else:
            parameters.append(parameter.replace(kind=Parameter.KEYWORD_ONLY, annotation=hints[name]))

    def flat(**values: Any) -> T:
        for name, group in groups.items():
            values[name] = group(**{field.name: values.pop(field.name) for field in fields(group)})
        return command(**values)

    flat.__signature__ = Signature(parameters)  # type: ignore[attr-defined]
    flat.__annotations__ = {parameter.name: parameter.annotation for parameter in parameters}
    flat.__name__, flat.__doc__ = command.__name__, command.__doc__
    return flat


# The arguments of the library that are options of the same names, and what else it says of arguments.
_OPTIONS = {
    field.name: f"--{field.name.replace('_', '-')}"
    for group in (LensOptions, ApertureOptions, DepthOptions, RenderOptions)
    for field in fields(group)
} | {
    name: f"--{name.replace('_', '-')}"
    for name in (
        "border",
        "holdout",
        "limit",
        "nearest_m",
        "outputs",
        "profile",
        "quality",
        "sharp_radius_px",
        "slices",
    )
}
_OPTIONS["scale"] = "--depth-scale"
_OPTIONS["lens_file"] = "--lens"
_OPTIONS["method_options"] = "--set"
# The longest first, of which others are parts.
_LONGEST_FIRST = sorted(_OPTIONS, key=len, reverse=True)
_NOT_IN_A_PATH = r"(?<![\w/.-])"
# Arguments with their values, and names of arguments that are no words of the language.
_GIVEN = re.compile(rf"{_NOT_IN_A_PATH}({'|'.join(_LONGEST_FIRST)})=(?:[\"']([^\"']*)[\"']|([\w.+-]+))")
_NAMED = re.compile(
    rf"{_NOT_IN_A_PATH}(?:{'|'.join(name for name in _LONGEST_FIRST if '_' in name)})(?![\w/.-])"
)
# Errors about the words of a file are in the words of files.
_OF_FILES = re.compile(r'\[aperture\] has no "|a lens has no "|\.(?:csv|jsonl), line \d+: ', re.IGNORECASE)
_SAID = {
    INTEGER_DEPTH: "which have no unit of their own. Say --depth-kind relative for a network's disparity, "
    "--depth-scale 0.001 for millimetres, or --preset NAME for a data set (hypersim, kitti, nyu, tum, "
    "scannet, middlebury, sintel)",
    UNITS: "Is it millimetres (--depth-scale 0.001) or disparity (--depth-kind relative)?",
    "Pass max_coc_px to bound": "Pass --max-coc-px to bound",
    "negate them": "negate them (--depth-scale -1)",
    "near and far are for depth_kind=": "--near and --far are for --depth-kind ",
    "from_disparity() takes one of strength_px and": "--strength-px excludes",
    "needs a lens made by Lens.from_disparity": "needs a lens of --strength-percent or --strength-px and "
    "--focus",
    "the lens was made by Lens.from_disparity": "the lens is given by --strength-percent or --strength-px",
    'depth_kind="disparity" or "relative"': "--depth-kind disparity or relative",
    "(depth_channel)": "(--depth-channel)",
    "(refine_depth)": "(--refine-depth)",
    "(layer)": "(--layer)",
    "(transfer)": "(--transfer)",
    "refine is for a picture": "--refine-depth is for a picture",
    "dofsim.photo reads": "`dofsim photo` reads",
    "dofsim.photo turns": "`dofsim photo` turns",
    "dofsim.render takes": "`dofsim render` takes",
    "dofsim.devices()": "`dofsim devices`",
    "guide and kinds are for method=": "--channels is for --method ",
    "and channels with guide or kinds have no colour": "and --channels have no colour",
}
