"""`dofsim photo`: one command for a photograph with depth."""

from __future__ import annotations

import logging
import time
from pathlib import Path
from typing import Annotated, Any

import typer

import dofsim

from . import _command_options as options
from . import _console, _options

log = logging.getLogger("dofsim")

# The subjects that help lists options by, beside those of all commands.
_LENS, _DEPTH, _PICTURE = "Lens", "Depth", "Picture"

FNumber = Annotated[
    float,
    typer.Option(
        metavar="N",
        help="f-number of a lens on a full-frame camera: the smaller, the more blur.",
        rich_help_panel=_LENS,
    ),
]
Nearest = Annotated[
    float,
    typer.Option(
        "--nearest-m",
        metavar="METRES",
        help="How far away the nearest thing in the picture is, in metres.",
        rich_help_panel=_LENS,
    ),
]
FocusAt = Annotated[
    str | None,
    typer.Option(
        metavar="X,Y",
        help="Focus on what this pixel shows; the middle of the picture by default.",
        rich_help_panel=_LENS,
    ),
]
FarIsWhite = Annotated[
    bool,
    typer.Option(
        "--depth-far-is-white",
        help="Larger values of the depth map are farther.",
        rich_help_panel=_DEPTH,
    ),
]
AsItIs = Annotated[
    bool,
    typer.Option(
        "--keep-depth",
        help="Use the depth as it is; it must be of the picture's size.",
        rich_help_panel=_DEPTH,
    ),
]
SaveDepth = Annotated[
    Path | None,
    typer.Option(
        metavar="FILE",
        help="Also write the depth that was used, as a PNG of 16 bits in which near is white.",
        rich_help_panel=_DEPTH,
    ),
]
Matte = Annotated[
    Path | None,
    typer.Option(
        metavar="FILE",
        help="A grey picture of the photograph's size, white where the subject is: for hair.",
        rich_help_panel=_PICTURE,
    ),
]
SaveMatte = Annotated[
    Path | None,
    typer.Option(
        metavar="FILE",
        help="Also write a matte of what is in focus or nearer, as a PNG to be painted over for --matte.",
        rich_help_panel=_PICTURE,
    ),
]
RestoreHighlights = Annotated[
    bool,
    typer.Option(
        "--restore-highlights", help="Give clipped lamps their light back.", rich_help_panel=_PICTURE
    ),
]
KeepGrain = Annotated[
    bool,
    typer.Option(
        "--keep-grain", help="Give blurred places the photograph's grain back.", rich_help_panel=_PICTURE
    ),
]
Quality = Annotated[
    int, typer.Option(metavar="N", help="Quality of JPEG and HEIC, 1 to 100.", rich_help_panel=_PICTURE)
]


def photo_command(
    photo: Annotated[Path, typer.Argument(help="HEIC, AVIF, JPEG or any other picture.", metavar="PHOTO")],
    *,
    output: Annotated[
        Path,
        typer.Option(
            "--output",
            "-o",
            metavar="FILE",
            help="JPEG, PNG, HEIC or TIFF to write, in the photograph's colours.",
        ),
    ],
    depth: Annotated[
        Path | None,
        typer.Argument(
            help="A depth map of any size, if the photograph has none in it. Larger values are nearer, as "
            "networks have it; see --depth-far-is-white.",
            metavar="DEPTH",
        ),
    ] = None,
    focus_at: FocusAt = None,
    f_number: FNumber = 1.4,
    nearest_m: Nearest = 1.0,
    blades: options.Blades = None,
    depth_far_is_white: FarIsWhite = False,
    keep_depth: AsItIs = False,
    save_depth: SaveDepth = None,
    matte: Matte = None,
    save_matte: SaveMatte = None,
    restore_highlights: RestoreHighlights = False,
    keep_grain: KeepGrain = False,
    quality: Quality = 95,
    device: options.Device = "auto",
    quiet: options.Quiet = False,
    verbose: options.Verbose = False,
) -> None:
    """Give a photograph the depth of field of a wide lens."""
    import numpy as np

    from . import io
    from . import photo as photos
    from ._report import Report, pixels
    from .cli import _check_output
    from .photo._write import check_writing

    _console.set_level(quiet=quiet, verbose=verbose)
    outputs = {output: photos.SUFFIXES} | {path: (".png",) for path in (save_depth, save_matte) if path}
    for path, suffixes in outputs.items():
        _check_output(path, [photo, depth, matte], suffixes)
    check_writing(output, quality)
    written = [path.absolute() for path in (output, save_depth, save_matte) if path is not None]
    if len(set(written)) < len(written):
        raise ValueError(f"{written[-1]}: cannot hold two of the picture, its depth and its matte")
    start = time.perf_counter()
    shot = photos.read(photo, depth, depth_far_is_white=depth_far_is_white)
    if shot.depth is None:
        raise ValueError(
            f"{photo}: has no depth in it; give a depth map beside it, such as a network makes: "
            f"dofsim photo {photo.name} depth.png -o {output.name}"
        )
    given = shot.depth.shape
    height, width = shot.image.pixels.shape[:2]
    plane, coverage = shot.depth, None
    if not keep_depth:
        with _console.patience(f"refining the depth of {width} x {height}"):
            plane, coverage = photos.refined_with_coverage(shot)
    if plane.shape != (height, width):
        raise ValueError(
            f"{depth or photo}: the depth is {given[1]} x {given[0]} and the picture {width} x {height} "
            "pixels; without --keep-depth it is enlarged"
        )
    x, y = (width // 2, height // 2) if focus_at is None else _options.read_pixel(focus_at)
    lens = photos.lens_for(shot, f_number=f_number, nearest_m=nearest_m)
    try:
        lens = lens.focused_at(plane, x, y, radius_px=max(height, width) // 200, depth_kind="relative")
    except IndexError as error:
        raise ValueError(f"--focus-at: {error}") from error
    cover = None if matte is None else photos.read_matte(matte)
    if cover is not None and cover.shape != (height, width):
        raise ValueError(
            f"{matte}: must have the size of the photograph, {width} x {height}; got "
            f"{cover.shape[1]} x {cover.shape[0]}"
        )
    words: dict[str, Any] = {} if blades is None else {"aperture": dofsim.Aperture(blades=blades)}
    log.debug("%r", lens)
    _console.wake(device, verbose=verbose)
    # What is not rendered yet is NaN. With a matte, layers are rendered, which have alpha.
    shape = shot.image.pixels[..., :-1].shape if shot.image.alpha != "none" else shot.image.pixels.shape
    if cover is None:
        words["out"] = np.full(shape, np.nan, np.float32)
    with _console.patience(f"rendering {width} x {height}", out=words.get("out")):
        result = photos.render(
            shot,
            plane,
            lens,
            matte=cover,
            restore_highlights=restore_highlights,
            keep_grain=keep_grain,
            device=device,
            **words,
        )
    photos.write(output, result, shot, quality=quality)
    if save_depth is not None:
        low, high = float(plane.min()), float(plane.max())
        shares = (plane - low) / max(high - low, 1e-30)
        io.write_image(save_depth, np.rint(65535 * shares).astype(np.uint16))
    if save_matte is not None:
        subject = photos.subject(plane, lens, coverage=coverage)
        io.write_image(save_matte, np.rint(65535 * subject).astype(np.uint16))
    seconds = time.perf_counter() - start
    report = Report.of(plane, lens, depth_kind="relative")
    named = shot.image.profile.name if shot.image.profile else "sRGB"
    larger = f" (larger is {'farther' if depth_far_is_white else 'nearer'})"
    origin, larger = ("its own depth", "") if depth is None else ("depth map", larger)
    how = "as it is" if keep_depth else "refined"
    if restore_highlights:
        how += ", lamps by its gain map" if shot.gains is not None else ", lamps guessed"
    log.info(
        "%s: %d x %d, %s of %d x %d%s %s, focus at pixel %d,%d, blur radius %s to %s px, %s, %s",
        output,
        width,
        height,
        origin,
        *given[::-1],
        larger,
        how,
        x,
        y,
        *(pixels(report.radius_px[end]) for end in (0, -1)),
        named,
        _console.taken(seconds),
    )
    for suspicion in report.suspicions().values():
        log.warning("%s: %s", output, options.in_options(suspicion))
