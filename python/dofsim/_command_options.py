"""The options of the command line, each declared once, and the groups that commands share."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields, is_dataclass
from inspect import Parameter, Signature, signature
from pathlib import Path
from typing import Annotated, Any, TypeVar, get_type_hints

import typer

import dofsim

from . import _options

T = TypeVar("T")

OutputFolder = Annotated[
    Path, typer.Option("--output", "-o", help="Folder to write into; made if it is not there.")
]
ApertureRadius = Annotated[
    float | None, typer.Option(help="Radius of the opening in metres.", rich_help_panel="Lens")
]
FocusDistance = Annotated[
    float | None, typer.Option(help="Distance of the plane in focus in metres.", rich_help_panel="Lens")
]
FocusAt = Annotated[
    str | None,
    typer.Option(
        metavar="X,Y", help="Focus on what this pixel of the depth map sees.", rich_help_panel="Lens"
    ),
]
InFocus = Annotated[
    str | None,
    typer.Option(
        metavar="NEAR,FAR",
        help="Keep a range in focus in place of a plane: its ends in metres, the farther may be inf; "
        "disparities of a relative lens.",
        rich_help_panel="Lens",
    ),
]
Fov = Annotated[float | None, typer.Option(help="Field of view in degrees.", rich_help_panel="Lens")]
FovAxis = Annotated[
    str | None,
    typer.Option(
        help="What the field of view spans: x (default), y, diagonal, smaller, larger.",
        rich_help_panel="Lens",
    ),
]
FocalLength = Annotated[
    float | None, typer.Option(help="Focal length in millimetres.", rich_help_panel="Lens")
]
FNumber = Annotated[
    float | None, typer.Option(help="Focal length over diameter of the opening.", rich_help_panel="Lens")
]
SensorWidth = Annotated[
    float | None,
    typer.Option(help="Width of the sensor in millimetres (default 36).", rich_help_panel="Lens"),
]
LensFile = Annotated[
    Path | None,
    typer.Option(
        "--lens",
        help="TOML file with the words above, spelt with underscores, and all others of dofsim.Lens; those "
        "of dofsim.Aperture in a table [aperture]. Options beside it win.",
        rich_help_panel="Lens",
    ),
]
Blades = Annotated[
    int | None, typer.Option(help="Blades of the aperture; 0 is round.", rich_help_panel="Aperture")
]
Rotation = Annotated[
    float | None, typer.Option(help="Rotation of the blades in degrees.", rich_help_panel="Aperture")
]
Preset = Annotated[
    str | None,
    typer.Option(
        help="Read depth as written by: hypersim, kitti, nyu, tum, scannet, middlebury, sintel, mitsuba, "
        "blender. The options below win.",
        rich_help_panel="Depth",
    ),
]
DepthKind = Annotated[
    str | None,
    typer.Option(
        help="What depth measures: z (default), distance, inverse_z, disparity, relative, zbuffer, "
        "opengl_ndc, distance_from_near.",
        rich_help_panel="Depth",
    ),
]
Near = Annotated[
    float | None,
    typer.Option(
        help="Near plane in metres, of z-buffers; the far plane of a reversed one. May be inf.",
        rich_help_panel="Depth",
    ),
]
Far = Annotated[
    float | None,
    typer.Option(
        help="Far plane in metres, of z-buffers; the near plane of a reversed one. May be inf.",
        rich_help_panel="Depth",
    ),
]
DepthScale = Annotated[
    float | None,
    typer.Option(help="Depth is multiplied by it; -1 for depth along -z.", rich_help_panel="Depth"),
]
DepthMissing = Annotated[
    float | None,
    typer.Option(
        help="The value in the file that means no reading, which --invalid is about.", rich_help_panel="Depth"
    ),
]
DepthChannel = Annotated[
    str | None,
    typer.Option(help="Channel of an EXR file, or array of an NPZ file.", rich_help_panel="Depth"),
]
Invalid = Annotated[
    str, typer.Option(help="What to do with depth that is none: raise or far.", rich_help_panel="Depth")
]
Layer = Annotated[str | None, typer.Option(help="Layer of an EXR file that is the picture.")]
Transfer = Annotated[
    str | None, typer.Option(help="What an integer picture holds: srgb (default) or linear.")
]
Alpha = Annotated[
    str | None, typer.Option(help="What a second or fourth channel is: straight, premultiplied or none.")
]
InvalidColor = Annotated[
    str,
    typer.Option(
        help="What to do with pixels whose colour is NaN or infinite: raise or fill (with the mean of those "
        "around them)."
    ),
]
MaxCoc = Annotated[
    float | None, typer.Option("--max-coc-px", help="Largest radius of the circle of confusion in pixels.")
]
Method = Annotated[str, typer.Option(help="How to compute.")]
Device = Annotated[
    str, typer.Option(help="Where to compute: auto, cpu, gpu, or an adapter that `dofsim devices` lists.")
]
Overscan = Annotated[int, typer.Option(help="Margin of the picture beyond the output, in output pixels.")]
Supersample = Annotated[int, typer.Option(help="Pixels of the picture to one of the output.")]
Threads = Annotated[int | None, typer.Option(help="Threads to use; all by default.")]
SampleType = Annotated[
    str | None,
    typer.Option("--dtype", help="Samples of the output: half or float (EXR), uint8 or uint16 (PNG, TIFF)."),
]

MethodOptions = Annotated[
    list[str] | None,
    typer.Option(
        "--set",
        metavar="NAME=VALUE",
        help="An option of the method; may be repeated. The value is TOML or a word.",
    ),
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
    invalid: Invalid = "raise"

    def read(self) -> tuple[dict[str, Any], dict[str, Any]]:
        """Give the words of depth that `dofsim.render` takes, and those that `dofsim.io.read_rgbd` takes."""
        kind, reading = _options.read_preset(
            self.preset, self.depth_kind, self.depth_scale, self.depth_missing
        )
        kind_words = {"depth_kind": kind, "near": self.near, "far": self.far}
        return kind_words, {"depth_channel": self.depth_channel, **reading}


@dataclass(frozen=True, kw_only=True)
class RenderOptions:
    """The options that say what the picture is, and how and where it is rendered."""

    layer: Layer = None
    transfer: Transfer = None
    alpha: Alpha = None
    invalid_color: InvalidColor = "raise"
    max_coc_px: MaxCoc = None
    method: Method = "lens"
    method_options: MethodOptions = None
    device: Device = "auto"
    overscan: Overscan = 0
    supersample: Supersample = 1
    threads: Threads = None

    def method_words(self, opening: dict[str, Any]) -> dict[str, Any]:
        """Give the method and its options, with the aperture of these words."""
        chosen = _options.read_method_options(self.method_options or [])
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
    for words, option in _SAID.items():
        message = message.replace(words, option)
    name, must, rest = message.partition(" must ")
    return f"{_OPTIONS[name]}{must}{rest}" if name in _OPTIONS else message


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
    for name in ("border", "limit", "outputs", "sharp_radius_px", "slices")
}
_OPTIONS["scale"] = "--depth-scale"
_SAID = {
    'Pass invalid_color="fill"': "Pass --invalid-color fill",
    "Pass max_coc_px": "Pass --max-coc-px",
    "negate them": "negate them (--depth-scale -1)",
    'pass invalid="far"': "pass --invalid far",
    "near and far are for depth_kind": "--near and --far are for depth_kind",
    "(depth_channel)": "(--depth-channel)",
    "(layer)": "(--layer)",
}
