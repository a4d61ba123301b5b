"""The ``dofsim`` command.

Every error is one line on the standard error stream. The exit status is 2 if the arguments or the files given
are at fault, 1 for everything else.
"""

from __future__ import annotations

import errno
import logging
import sys
import time
import warnings
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, TextIO

import typer

import dofsim

from . import _command_options as options
from . import _console, _options
from ._batch_command import batch_command
from ._help import Command, Group
from ._names import listed, printable
from ._photo_command import photo_command

if TYPE_CHECKING:
    from ._frame import Framed
    from ._passes import Passes
    from ._report import Report

log = logging.getLogger("dofsim")

app = typer.Typer(
    cls=Group,
    help="Turn a pinhole picture and its depth into the picture that a real lens would have taken.\n\n"
    "`dofsim help COMMAND` or `dofsim COMMAND -h` lists the options of a command.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)

Output = Annotated[
    Path,
    typer.Option("--output", "-o", metavar="FILE", help="File to write; its suffix names the format."),
]
Picture = Annotated[
    Path,
    typer.Argument(help="The picture, with its depth if it is an OpenEXR or NPZ file.", metavar="PICTURE"),
]

# What Typer makes of Ctrl-C; none of the commands returns it.
_INTERRUPTED = 130
# What `dofsim photo` alone writes.
_PHOTO_SUFFIXES = (".jpg", ".jpeg", ".heic")
# What these refusals of the system are about is always a path that was given.
_PATH_ERRORS = (FileNotFoundError, IsADirectoryError, NotADirectoryError, PermissionError)


def main() -> None:
    """Run the command line; the entry point of the ``dofsim`` script."""
    sys.exit(run(sys.argv[1:]))


def run(arguments: list[str]) -> int:
    """Run the command line and return its exit status.

    Parameters
    ----------
    arguments : list of str
        What follows the name of the command.

    Returns
    -------
    int
        0, or 2 if the arguments or the files given are at fault, 1 for everything else.

    Examples
    --------
    >>> from dofsim.cli import run
    >>> run(["render", "missing.exr", "-o", "out.exr"])
    2
    """
    try:
        with warnings.catch_warnings(), _console.to_stderr():
            warnings.filterwarnings("always", message="color has ", category=UserWarning)
            warnings.showwarning = _say_warning
            status: object = app(arguments, prog_name="dofsim", standalone_mode=False)
        if status == _INTERRUPTED:
            return _fail("interrupted", 1)
        return status if isinstance(status, int) else 0
    except (KeyboardInterrupt, typer.Abort):
        return _fail("interrupted", 1)
    except _PATH_ERRORS as error:
        return _fail(f"{error.filename}: {error.strerror}", 2)
    except OSError as error:
        return _fail(f"{error.filename}: {error.strerror}" if error.filename else str(error), 1)
    except (ValueError, TypeError) as error:
        return _fail(options.in_options(str(error)), 2)
    except RecursionError:
        return _fail("what was given is nested too deeply", 2)
    except (dofsim.DeviceError, ImportError, MemoryError) as error:
        return _fail(options.in_options(str(error)) or "not enough memory", 1)
    except Exception as error:
        # Typer brings a copy of Click or uses the installed one, depending on its version, so its usage
        # errors are known by what they offer and not by their class.
        if type(error).__name__ == "NoArgsIsHelpError":
            print(str(error), file=sys.stderr)
            return 2
        if format_message := getattr(error, "format_message", None):
            return _fail(format_message(), 2)
        return _fail(f"internal error: {type(error).__name__}: {error}", 1)


def _fail(message: str, status: int) -> int:
    print(f"dofsim: {printable(message)}", file=sys.stderr)
    return status


def _say_warning(
    message: Warning | str,
    category: type[Warning],
    filename: str,
    lineno: int,
    file: TextIO | None = None,
    line: str | None = None,
) -> None:
    """Show a warning as a line like those of errors."""
    print(f"dofsim: {printable(str(message))}", file=sys.stderr)


def _print_version(wanted: bool) -> None:
    if wanted:
        print(f"dofsim {dofsim.__version__}")
        raise typer.Exit


@app.callback()
def _common(
    version: Annotated[
        bool,
        typer.Option("--version", help="Print the version.", callback=_print_version, is_eager=True),
    ] = False,
) -> None:
    """Options of all commands."""


@app.command("render", cls=Command, no_args_is_help=True)
@options.with_groups
def render_command(
    image: Picture,
    *,
    output: Output,
    depth: Annotated[
        Path | None, typer.Argument(help="The depth, if it is in another file.", metavar="DEPTH")
    ] = None,
    lens_options: options.LensOptions,
    aperture_options: options.ApertureOptions,
    depth_options: options.DepthOptions,
    render_options: options.RenderOptions,
    holdout: options.Holdout = None,
    channels: options.Channels = None,
    kind: options.Kinds = None,
    dtype: options.SampleType = None,
    profile: Annotated[
        bool,
        typer.Option(
            "--profile", help="Print the time of each pass on the GPU, and what goes there and back."
        ),
    ] = False,
    quiet: options.Quiet = False,
    verbose: options.Verbose = False,
) -> None:
    """Render a picture through a lens."""
    import numpy as np

    from . import io
    from ._frame import read_framed, read_holdout, squeezed
    from ._report import Report

    _console.set_level(quiet=quiet, verbose=verbose)
    _check_output(output, [image, depth, holdout, lens_options.lens_file])
    of_depth, reading = depth_options.read()
    chosen_passes = None
    if channels or kind:
        if profile:
            raise ValueError("--profile is for a picture without --channels")
        chosen_passes = _passes_of(image, channels or ["*"], kind or [], output, dtype)
    framed = read_framed(
        image,
        depth,
        **render_options.framing(),
        layer=render_options.layer,
        **reading,
        transfer=_options.one_of("--transfer", render_options.transfer, io.TRANSFERS),
        same_size=not render_options.refine_depth,
    )
    picture = framed.rgbd.image
    if chosen := _options.one_of("--alpha", render_options.alpha, io.ALPHAS):
        picture = replace(picture, alpha=chosen)
    color = picture.to_linear()
    has_alpha = picture.alpha != "none"
    finer = render_options.supersample
    grid = {"overscan": framed.overscan, "supersample": finer}
    scene_words: dict[str, Any] = {
        **of_depth,
        **grid,
        "device": render_options.device,
        "invalid": depth_options.invalid,
        "invalid_color": render_options.invalid_color,
        "alpha": "premultiplied" if has_alpha else "none",
        "transfer": "linear",
    }
    if holdout is not None:
        scene_words["holdout"] = read_holdout(holdout, framed, **render_options.framing(), **reading)
    scene: dofsim.Scene | None = None
    if render_options.refine_depth:
        with _console.patience(f"refining the depth of {image}"):
            scene = dofsim.Scene(color, framed.rgbd.depth, refine=True, **scene_words)
        framed = replace(framed, rgbd=replace(framed.rgbd, depth=scene.depth))
    rgbd = framed.rgbd
    _say_what_was_read(image, depth or image, framed)
    words, opening = lens_options.read(
        framed.seen_depth(render_options.supersample), aperture_options, **of_depth
    )
    _check_input(output, opening.get("image"))
    sample_type = _options.one_of("--dtype", dtype, io.SAMPLE_TYPES)
    if sample_type is None and rgbd.color.dtype == "uint16" and io.holds(output, "uint16"):
        sample_type = "uint16"

    method_words = render_options.method_words(opening)
    lens, aperture = squeezed(
        _options.make_lens(words), method_words.get("aperture"), framed.pixel_aspect, of_depth["depth_kind"]
    )
    if aperture is not None:
        method_words["aperture"] = aperture
    log.debug("%s: %r", image, rgbd)
    log.debug("%r", lens)
    log.debug(
        "method %s, device %s, %s",
        render_options.method,
        render_options.device,
        aperture or "a round aperture",
    )
    _console.wake(render_options.device, verbose=verbose)
    start = time.perf_counter()
    height, width = (side // finer for side in framed.seen_depth(finer).shape[-2:])
    rendering = f"rendering {width} x {height}"
    if chosen_passes is not None:
        with _console.patience(rendering):
            planes = chosen_passes.render(color, rgbd.depth, lens, **scene_words, **method_words)
        planes = {name: framed.cut(plane) for name, plane in planes.items()}
        chosen_passes.write(output, planes, framed.corner)
        height, width = next(iter(planes.values())).shape
        report = Report.of(rgbd.depth, lens, **of_depth, **grid, max_coc_px=render_options.max_coc_px)
        _say_what_was_made(output, (width, height), report, time.perf_counter() - start)
        return
    # What is not rendered yet is NaN.
    out = np.full((height, width, *color.shape[rgbd.depth.ndim :]), np.nan, np.float32)
    faster = _console.FASTER if render_options.method == "lens" else ()
    with _console.patience(rendering, out=out, faster=faster):
        if scene is None:
            result = dofsim.render(color, rgbd.depth, lens, **scene_words, **method_words, out=out)
        else:
            result = scene.render(lens, **method_words, out=out)
    seconds = time.perf_counter() - start

    result = framed.cut(result)
    io.write_image(
        output,
        result,
        alpha="premultiplied" if has_alpha else "none",
        dtype=sample_type,
        attributes_of=framed.source,
        corner=framed.corner,
        profile=picture.profile,
    )
    report = Report.of(rgbd.depth, lens, **of_depth, **grid, max_coc_px=render_options.max_coc_px)
    _say_what_was_made(output, (result.shape[1], result.shape[0]), report, seconds)
    if profile:
        _print_profile(dofsim.Scene(color, rgbd.depth, **scene_words), lens, method_words)


def _print_profile(scene: dofsim.Scene, lens: dofsim.Lens, method_words: dict[str, Any]) -> None:
    """Print the time of each pass for a new scene, and what went to the device and back."""
    from ._dofsim import device_traffic

    before = device_traffic()
    passes = scene.profile(lens, **method_words)
    went = {name: count - before[name] for name, count in device_traffic().items()}
    for name, milliseconds in [*passes, ("all passes", sum(own for _, own in passes))]:
        print(f"{name:<20} {milliseconds:10.3f} ms")
    for name, way in (("to the device", "uploaded"), ("back", "downloaded")):
        print(f"{name:<20} {went[f'{way}_bytes'] / 2**20:10.3f} MiB")
    for name in ("submissions", "readbacks"):
        print(f"{name:<20} {went[name]:10d}")


@app.command("coc", cls=Command, no_args_is_help=True)
@options.with_groups
def coc_command(
    depth: Annotated[
        Path,
        typer.Argument(help="A depth map, or a picture with depth (OpenEXR or NPZ).", metavar="DEPTH"),
    ],
    *,
    output: Output,
    lens_options: options.LensOptions,
    depth_options: options.DepthOptions,
    max_coc_px: options.MaxCoc = None,
    limit: Annotated[
        float | None,
        typer.Option(metavar="PIXELS", help="Radius in pixels at which the colours of a PNG end."),
    ] = None,
    quiet: options.Quiet = False,
    verbose: options.Verbose = False,
) -> None:
    """Show the circle of confusion: as colours (PNG) or as its signed radius in pixels (other formats)."""
    from . import _dofsim, io
    from ._report import Report

    _console.set_level(quiet=quiet, verbose=verbose)
    _check_output(output, [depth, lens_options.lens_file])
    kind, reading = depth_options.read()
    words = {name.removeprefix("depth_"): value for name, value in reading.items()}
    plane, channel = io.read_named_depth(depth, **words)
    _say_channels(depth, depth, (), channel)
    words, _ = lens_options.read(plane, **kind)
    lens = _options.make_lens(words)
    radius = dofsim.coc(plane, lens, **kind, invalid=depth_options.invalid, max_coc_px=max_coc_px)
    if output.suffix.lower() == ".png":
        from .falsecolor import draw_coc

        _dofsim.write_bytes(output, draw_coc(radius, limit=limit))
    elif output.suffix.lower() == ".exr":
        io.write_exr(output, {"coc": radius})
    else:
        io.write_image(output, radius)
    report = Report.of(plane, lens, **kind, max_coc_px=max_coc_px)
    log.info(
        "%s: %d x %d, %s; signed radius %+.2f to %+.2f px, negative in front of the focus",
        output,
        radius.shape[1],
        radius.shape[0],
        report,
        radius.min(),
        radius.max(),
    )
    for suspicion in report.suspicions().values():
        log.warning("%s: %s", output, options.in_options(suspicion))


app.command("batch", cls=Command, no_args_is_help=True)(batch_command)
app.command("photo", cls=Command, no_args_is_help=True)(photo_command)


@app.command("compare", cls=Command, no_args_is_help=True)
def compare_command(
    a: Annotated[Path, typer.Argument(help="A picture.", metavar="A")],
    b: Annotated[Path, typer.Argument(help="Another picture, such as a reference.", metavar="B")],
    output: Annotated[
        Path | None,
        typer.Option("--output", "-o", metavar="FILE", help="PNG file of both and their difference."),
    ] = None,
    border: Annotated[
        int, typer.Option(metavar="PIXELS", help="Pixels along each edge that are left out of the numbers.")
    ] = 0,
    quiet: options.Quiet = False,
) -> None:
    """Measure how far two pictures are apart, in sRGB: PSNR, SSIM and FLIP."""
    from . import _compare, _dofsim, _panel, io

    _console.set_level(quiet=quiet)
    if output is not None:
        _check_output(output, [a, b], (".png",))
    first, second = (_compare.opaque(io.read_color(path)) for path in (a, b))
    with _console.patience("comparing"):
        distance = _compare.measure(first, second, border=border)
    if output is not None:
        tiles = [
            _panel.Tile(a.name, _compare.shown(first)),
            _panel.Tile(b.name, _compare.shown(second)),
            _compare.difference_tile(first, second, f"Difference: {distance}"),
        ]
        _dofsim.write_bytes(output, _panel.draw(tiles))
        log.info("%s: %s, %s and their difference", output, a.name, b.name)
    print(distance)


@app.command("devices", cls=Command)
def devices_command(
    check: Annotated[
        bool,
        typer.Option(
            "--check",
            help="Render a small frame by every method on each of them and compare it with the CPU. "
            "If one differs, the exit status is 1.",
        ),
    ] = False,
    verbose: Annotated[
        bool, typer.Option("--verbose", "-v", help="Show also what the drivers print.")
    ] = False,
) -> None:
    """List the GPUs that can be computed on, besides the CPU."""
    from . import _devices, _dofsim

    with _console.without_noise(verbose):
        found = dofsim.devices()
        lacking = _dofsim.lacking_for_gpu()
    all_agree = True
    for device in found:
        _devices.describe(device)
        all_agree &= not check or _devices.check(device, verbose=verbose)
    if all(device.kind == "software" for device in found):
        print("There is no GPU.")
    for sentence in [*lacking, _devices.automatic()]:
        print(_devices.wrapped(sentence))
    if not all_agree:
        raise typer.Exit(1)


@app.command("help", cls=Command)
def help_command(
    context: typer.Context,
    command: Annotated[
        str | None, typer.Argument(help="A command; without one, they are listed.", metavar="COMMAND")
    ] = None,
) -> None:
    """Show the help of a command."""
    app([command, "--help"] if command else ["--help"], prog_name="dofsim", standalone_mode=False)


@app.command("demo", cls=Command)
def demo_command(
    output: options.OutputFolder = Path("dofsim-demo"),
    device: options.Device = "auto",
) -> None:
    """Render the picture that comes with dofsim and compare it with a ray tracer's."""
    from .demo import run_demo

    demo = run_demo(output, device=device)
    print(f"{demo.size[0]} x {demo.size[1]}, rendered in {demo.seconds:.2f} s")
    print(f"against the ray traced reference: {demo.distance}")
    print(f"{demo.panel}: before, after, reference and difference")
    print(f"{demo.result}: the result in linear light")


def _say_what_was_read(image: Path, depth: Path, framed: Framed) -> None:
    """Say which channels and windows were chosen, where there was a choice."""
    _say_channels(image, depth, framed.rgbd.color_channels, framed.rgbd.depth_channel)
    if framed.unused:
        log.info(
            "%s: %d pixels beyond the display window are not used; --window data does", image, framed.unused
        )
    if framed.too_few:
        log.info(
            "%s: stores %d pixels beyond the display window, fewer than --overscan %d: the margin is cut "
            "from the display window, and the output is smaller",
            image,
            framed.too_few,
            framed.overscan,
        )
    if framed.pixel_aspect != 1.0:
        log.info(
            "%s: its pixels are %g times as wide as high; the blur radius is along the longer axis of a disc",
            image,
            framed.pixel_aspect,
        )


def _say_what_was_made(output: Path, size: tuple[int, int], report: Report, seconds: float) -> None:
    """Say what was rendered, and what is suspicious about it."""
    log.info("%s: %d x %d, %s, %s", output, *size, report, _console.taken(seconds))
    for suspicion in report.suspicions().values():
        log.warning("%s: %s", output, options.in_options(suspicion))


def _passes_of(image: Path, channels: list[str], kinds: list[str], output: Path, dtype: str | None) -> Passes:
    """Choose the channels of a file, and say what they are taken for."""
    from ._channel_sources import source_of
    from ._passes import Passes

    source = source_of(image)
    if source is None or output.suffix.lower() != ".exr":
        raise ValueError(
            f"--channels takes an OpenEXR or NPZ file and writes an OpenEXR file; got {image} and {output}"
        )
    if dtype is not None:
        raise ValueError("--dtype: --channels gives every channel the type that it has")
    passes = Passes.choose(source, channels, kinds)
    log.info("%s: %s", image, passes.describe())
    return passes


def _say_channels(image: Path, depth: Path, color: tuple[str, ...], plane: str | None) -> None:
    """Say which channels of OpenEXR files were chosen, where they have other names than the format's own."""
    if not set(color) <= set("RGBAY"):
        log.info("%s: the picture is %s", image, listed(color))
    if plane not in (None, "Z"):
        log.info("%s: the depth is %s", depth, plane)


def _check_output(output: Path, inputs: list[Path | None], suffixes: tuple[str, ...] | None = None) -> None:
    """Refuse an output that cannot be written or must not be, before any work is done."""
    from . import io

    accepted = suffixes or io.SUFFIXES
    if output.suffix.lower() not in accepted:
        photograph = suffixes is None and output.suffix.lower() in _PHOTO_SUFFIXES
        elsewhere = "; `dofsim photo` writes JPEG and HEIC" if photograph else ""
        raise ValueError(
            f"{output}: the suffix {output.suffix!r} is not one of {', '.join(accepted)}{elsewhere}"
        )
    if not output.parent.is_dir():
        raise FileNotFoundError(errno.ENOENT, "there is no such folder", str(output.parent))
    for path in inputs:
        _check_input(output, path)


def _check_input(output: Path, path: Any) -> None:
    """Refuse an output that is one of the inputs."""
    if isinstance(path, (str, Path)) and output.exists() and Path(path).exists() and output.samefile(path):
        raise ValueError(f"{output}: is one of the inputs, which are not overwritten")
