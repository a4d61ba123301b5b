"""The ``dofsim`` command.

Every error is one line on the standard error stream. The exit status is 2 if the arguments or the files given
are at fault, 1 for everything else.
"""

from __future__ import annotations

import errno
import sys
import time
import warnings
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any, TextIO

import typer

import dofsim

from . import _command_options as options
from . import _options
from ._batch_command import batch_command
from ._names import listed, printable

app = typer.Typer(
    help="Turn a pinhole picture and its depth into the picture that a real lens would have taken.",
    add_completion=False,
    no_args_is_help=True,
    pretty_exceptions_enable=False,
)

Output = Annotated[Path, typer.Option("--output", "-o", help="File to write; its suffix names the format.")]

# What Typer makes of Ctrl-C; none of the commands returns it.
_INTERRUPTED = 130
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
        with warnings.catch_warnings():
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
        return _fail(str(error) or "not enough memory", 1)
    except Exception as error:
        # Typer brings a copy of Click or uses the installed one, depending on its version, so its usage
        # errors are known by what they offer and not by their class.
        if format_message := getattr(error, "format_message", None):
            return _fail(format_message(), 2)
        return _fail(f"internal error: {type(error).__name__}: {error}", 1)


def _fail(message: str, status: int) -> int:
    # Without arguments the help has been printed, and nothing is left to say.
    if message:
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


@app.command("render", no_args_is_help=True)
@options.with_groups
def render_command(
    image: Annotated[Path, typer.Argument(help="The picture, with its depth if it is EXR or NPZ.")],
    *,
    output: Output,
    depth: Annotated[Path | None, typer.Argument(help="The depth, if it is in another file.")] = None,
    lens_options: options.LensOptions,
    aperture_options: options.ApertureOptions,
    depth_options: options.DepthOptions,
    render_options: options.RenderOptions,
    dtype: options.SampleType = None,
    profile: Annotated[
        bool, typer.Option("--profile", help="Print what each pass takes on the GPU.")
    ] = False,
) -> None:
    """Render a picture through a lens."""
    from . import io

    _check_output(output, [image, depth, lens_options.lens_file])
    kind, reading = depth_options.read()
    rgbd = io.read_rgbd(
        image,
        depth,
        layer=render_options.layer,
        **reading,
        transfer=_options.one_of("--transfer", render_options.transfer, io.TRANSFERS),
    )
    words, opening = lens_options.read(rgbd.depth, aperture_options, **kind)
    _check_input(output, opening.get("image"))
    picture = io.Image(rgbd.color, rgbd.transfer, rgbd.alpha)
    if chosen := _options.one_of("--alpha", render_options.alpha, io.ALPHAS):
        picture = replace(picture, alpha=chosen)
    color = picture.to_linear()
    has_alpha = picture.alpha != "none"

    lens = _options.make_lens(words)
    scene_words: dict[str, Any] = {
        **kind,
        "device": render_options.device,
        "invalid": depth_options.invalid,
        "invalid_color": render_options.invalid_color,
        "alpha": "premultiplied" if has_alpha else "none",
        "transfer": "linear",
        "overscan": render_options.overscan,
        "supersample": render_options.supersample,
    }
    method_words = render_options.method_words(opening)
    start = time.perf_counter()
    result = dofsim.render(color, rgbd.depth, lens, **scene_words, **method_words)
    seconds = time.perf_counter() - start

    sample_type = _options.one_of("--dtype", dtype, io.SAMPLE_TYPES)
    if sample_type is None and rgbd.color.dtype == "uint16" and io.holds(output, "uint16"):
        sample_type = "uint16"
    io.write_image(output, result, alpha="premultiplied" if has_alpha else "none", dtype=sample_type)
    print(f"{output}: {result.shape[1]} x {result.shape[0]}, rendered in {seconds:.2f} s")
    _say_channels(image, depth or image, rgbd.color_channels, rgbd.depth_channel)
    if profile:
        passes = dofsim.Scene(color, rgbd.depth, **scene_words).profile(lens, **method_words)
        for name, milliseconds in [*passes, ("all passes", sum(time for _, time in passes))]:
            print(f"{name:<20} {milliseconds:10.3f} ms")


@app.command("coc", no_args_is_help=True)
@options.with_groups
def coc_command(
    depth: Annotated[Path, typer.Argument(help="A depth map, or a picture with depth (EXR or NPZ).")],
    *,
    output: Output,
    lens_options: options.LensOptions,
    depth_options: options.DepthOptions,
    max_coc_px: options.MaxCoc = None,
    limit: Annotated[
        float | None, typer.Option(help="Radius in pixels at which the colours of a PNG end.")
    ] = None,
) -> None:
    """Show the circle of confusion: as colours (PNG) or as its signed radius in pixels (EXR and others)."""
    from . import _dofsim, io

    _check_output(output, [depth, lens_options.lens_file])
    kind, reading = depth_options.read()
    words = {name.removeprefix("depth_"): value for name, value in reading.items()}
    plane, channel = io.read_named_depth(depth, **words)
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
    print(f"{output}: radius from {radius.min():+.2f} px (near) to {radius.max():+.2f} px (far)")
    _say_channels(depth, depth, (), channel)


app.command("batch", no_args_is_help=True)(batch_command)


@app.command("compare", no_args_is_help=True)
def compare_command(
    a: Annotated[Path, typer.Argument(help="A picture.")],
    b: Annotated[Path, typer.Argument(help="Another picture, such as a reference.")],
    output: Annotated[
        Path | None, typer.Option("--output", "-o", help="PNG file of both and their difference.")
    ] = None,
    border: Annotated[int, typer.Option(help="Pixels left out of the numbers along each edge.")] = 0,
) -> None:
    """Say how far two pictures are apart: PSNR, SSIM and FLIP."""
    from . import _compare, _dofsim, _panel, io

    if output is not None:
        _check_output(output, [a, b], (".png",))
    first, second = (_compare.opaque(io.read_color(path)) for path in (a, b))
    distance = _compare.measure(first, second, border=border)
    if output is not None:
        tiles = [
            _panel.Tile(a.name, _compare.shown(first)),
            _panel.Tile(b.name, _compare.shown(second)),
            _compare.difference_tile(first, second, f"Difference: {distance}"),
        ]
        _dofsim.write_bytes(output, _panel.draw(tiles))
        print(output)
    print(distance)


@app.command("devices")
def devices_command() -> None:
    """List the adapters that can be computed on, besides the CPU."""
    found = dofsim.devices()
    for device in found:
        mebibytes = device.max_binding_bytes // 2**20
        print(f"{device.id}  {device.name}")
        print(f"       {device.kind}, {device.backend}, {device.driver}; up to {mebibytes} MiB a frame")
    if not found:
        print("There is no adapter: no driver for Vulkan, Metal or Direct3D 12 is installed.")


@app.command("demo")
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


def _say_channels(image: Path, depth: Path, color: tuple[str, ...], plane: str | None) -> None:
    """Say which channels of OpenEXR files were chosen, where they have other names than the format's own."""
    if not set(color) <= set("RGBAY"):
        print(f"dofsim: {printable(str(image))}: the picture is {listed(color)}", file=sys.stderr)
    if plane not in (None, "Z"):
        print(f"dofsim: {printable(str(depth))}: the depth is {printable(plane)}", file=sys.stderr)


def _check_output(output: Path, inputs: list[Path | None], suffixes: tuple[str, ...] | None = None) -> None:
    """Refuse an output that cannot be written or must not be, before any work is done."""
    from . import io

    accepted = suffixes or io.SUFFIXES
    if output.suffix.lower() not in accepted:
        raise ValueError(f"{output}: the suffix {output.suffix!r} is not one of {', '.join(accepted)}")
    if not output.parent.is_dir():
        raise FileNotFoundError(errno.ENOENT, "there is no such folder", str(output.parent))
    for path in inputs:
        _check_input(output, path)


def _check_input(output: Path, path: Any) -> None:
    """Refuse an output that is one of the inputs."""
    if isinstance(path, (str, Path)) and output.exists() and Path(path).exists() and output.samefile(path):
        raise ValueError(f"{output}: is one of the inputs, which are not overwritten")
