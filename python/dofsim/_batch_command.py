"""``dofsim batch``: the frames that the command line describes, and how they are getting on."""

from __future__ import annotations

import logging
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from random import Random
from typing import TYPE_CHECKING, Annotated, Any

import typer

from . import _command_options as options
from . import _console, _options
from ._batch_run import FAILURES, look_at, run
from ._names import printable

if TYPE_CHECKING:
    from .batch import Frame, Row

log = logging.getLogger("dofsim")

_FRAMES = "Frames"
_OUTPUTS = "Outputs"
_RANDOM = "Random lenses"


@options.with_groups
def batch_command(
    *,
    output: options.OutputFolder,
    color: Annotated[
        str | None,
        typer.Argument(
            metavar="COLOR",
            help="The pictures: a folder, a file, or a pattern in quotes, such as 'shot.beauty.####.exr', "
            "'%04d.png' or '*/rgb/*.png'.",
        ),
    ] = None,
    depth: Annotated[
        str | None,
        typer.Argument(
            metavar="DEPTH",
            help="The depth maps, likewise. Without it they are in the files of the pictures.",
        ),
    ] = None,
    holdout: Annotated[
        str | None,
        typer.Option(
            metavar="HOLDOUT",
            help="What blocks the light of what is behind it and is not seen itself: a file for all frames, "
            "or a folder or a pattern of one for each, with names as for DEPTH. They are pictures with depth "
            "and alpha (OpenEXR, flat or deep, or NPZ).",
            rich_help_panel=_FRAMES,
        ),
    ] = None,
    manifest: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="CSV or JSON lines in place of COLOR and DEPTH: color, depth, holdout, output, focus_at and "
            "the words of the lens; paths are relative to it, and its words win.",
            rich_help_panel=_FRAMES,
        ),
    ] = None,
    resume: Annotated[
        bool,
        typer.Option(
            help="Skip frames that are there, made with the same options from inputs of the same size and "
            "time of change.",
            rich_help_panel=_FRAMES,
        ),
    ] = True,
    cameras: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="Where the camera of each frame stands: transforms.json, COLMAP's folder, or JSON as "
            "dofsim.cameras describes it; for --neighbours.",
            rich_help_panel=_FRAMES,
        ),
    ] = None,
    neighbours: Annotated[
        int,
        typer.Option(
            min=0,
            metavar="N",
            help="Give each frame what the N frames beside it saw of what it hides.",
            rich_help_panel=_FRAMES,
        ),
    ] = 0,
    workers: Annotated[
        int,
        typer.Option(
            min=1, metavar="N", help="Processes to work in; they share the threads.", rich_help_panel=_FRAMES
        ),
    ] = 1,
    limit: Annotated[
        int | None,
        typer.Option(
            min=1,
            metavar="N",
            help="Take the first N frames only, to try the options.",
            rich_help_panel=_FRAMES,
        ),
    ] = None,
    dry_run: Annotated[
        bool,
        typer.Option(
            "--dry-run",
            help="List the frames, check the options, read the first frame and write nothing.",
            rich_help_panel=_FRAMES,
        ),
    ] = False,
    dask: Annotated[
        str | None,
        typer.Option(
            metavar="ADDRESS|local",
            help="Work on the cluster of a Dask scheduler, or on one of --workers processes made for this "
            "run. Every worker must see the files under the same paths.",
            rich_help_panel=_FRAMES,
        ),
    ] = None,
    outputs: Annotated[
        str,
        typer.Option(
            metavar="NAMES",
            help="What to write, with commas between: picture, coc (signed radius in pixels, EXR), mask "
            "(what is within the depth of field, PNG), stack. The parameters are always written, as JSON.",
            rich_help_panel=_OUTPUTS,
        ),
    ] = "picture",
    suffix: Annotated[
        str,
        typer.Option(
            "--format",
            metavar="SUFFIX",
            help="Format of the pictures: exr, png, tiff, pfm, npy or npz.",
            rich_help_panel=_OUTPUTS,
        ),
    ] = "exr",
    dtype: options.SampleType = None,
    slices: Annotated[
        int,
        typer.Option(
            metavar="N",
            help="Pictures of the focal stack, evenly spaced in 1/distance from the nearest depth to the "
            "farthest that is finite.",
            rich_help_panel=_OUTPUTS,
        ),
    ] = 0,
    sharp_radius_px: Annotated[
        float,
        typer.Option(
            metavar="PIXELS",
            help="Largest radius of the circle of confusion, in pixels, within the depth of field.",
            rich_help_panel=_OUTPUTS,
        ),
    ] = 0.5,
    lens_options: options.LensOptions,
    random_aperture_radius: Annotated[
        str | None,
        typer.Option(
            metavar="LOW,HIGH",
            help="Draw the radius of the aperture, in metres, for each frame.",
            rich_help_panel=_RANDOM,
        ),
    ] = None,
    random_f_number: Annotated[
        str | None,
        typer.Option(metavar="LOW,HIGH", help="Draw the f-number for each frame.", rich_help_panel=_RANDOM),
    ] = None,
    random_focus: Annotated[
        bool,
        typer.Option(
            "--random-focus",
            help="Focus each frame on a random pixel with finite depth.",
            rich_help_panel=_RANDOM,
        ),
    ] = False,
    seed: Annotated[
        int,
        typer.Option(
            metavar="N",
            help="Another seed draws other lenses. What is drawn depends on it and the frame's name alone.",
            rich_help_panel=_RANDOM,
        ),
    ] = 0,
    aperture_options: options.ApertureOptions,
    depth_options: options.DepthOptions,
    render_options: options.RenderOptions,
    quiet: options.Quiet = False,
    verbose: options.Verbose = False,
) -> int:
    """Render many frames, and go on where an earlier run was stopped.

    A picture and a depth map are a frame if their names are equal: their paths from COLOR and DEPTH (from the
    first wildcard of a pattern), without suffix and without a first or last word such as rgb or depth; or if
    their names have the same number and differ in one word, as shot.beauty.0001.exr and shot.depth.0001.exr.
    Files without a partner are listed first.

    Each result has a JSON file beside it with all parameters, its depth and its blur. FOLDER/summary.json has
    their distribution over all frames. Frames that fail are listed in FOLDER/failures.jsonl, and the exit
    status is then 1.
    """
    from . import io
    from .batch import Frame

    _console.set_level(quiet=quiet, verbose=verbose)
    if dask not in (None, "local"):
        if workers != 1:
            raise ValueError("--workers is for this machine; the cluster of --dask has its own")
        output = output.absolute()
    if (cameras is None) != (neighbours == 0):
        raise ValueError("--cameras and --neighbours need each other")
    rows = list(_rows(color, depth, manifest, output))
    if holdout is not None:
        rows = _with_holdouts(rows, color, holdout, output)
    # The first frames have neighbours beyond the limit.
    rows = rows if neighbours else rows[:limit]
    if dask not in (None, "local"):
        # Workers elsewhere stand in other folders.
        rows = [
            replace(
                row,
                color=row.color.absolute(),
                depth=row.depth and row.depth.absolute(),
                holdout=row.holdout and row.holdout.absolute(),
            )
            for row in rows
        ]
    lens_file, focus_at = lens_options.lens_file, lens_options.focus_at
    words, opening = _options.read_settings(lens_file, lens_options.words, vars(aperture_options))
    ranges = {
        name: _options.read_numbers(
            f"--random-{name.replace('_', '-')}", text, float, "two numbers, LOW,HIGH"
        )
        for name, text in (("aperture_radius", random_aperture_radius), ("f_number", random_f_number))
        if text is not None
    }
    if random_focus and focus_at is not None:
        raise ValueError("--random-focus and --focus-at exclude each other")
    pixel = _options.read_pixel(focus_at) if focus_at is not None else None
    suffix = "." + suffix.lower().removeprefix(".")
    _options.one_of("--format", suffix, io.SUFFIXES)
    kind, depth_words = depth_options.read()
    reading = {
        "layer": render_options.layer,
        **depth_words,
        "transfer": _options.one_of("--transfer", render_options.transfer, io.TRANSFERS),
        "alpha": _options.one_of("--alpha", render_options.alpha, io.ALPHAS),
        **({} if (window := render_options.framing()["window"]) is None else {"window": window}),
        "same_size": not render_options.refine_depth,
    }
    rendering = {
        "method": render_options.method,
        "device": render_options.device,
        **kind,
        "invalid": depth_options.invalid,
        "invalid_color": render_options.invalid_color,
        "overscan": render_options.overscan,
        "supersample": render_options.supersample,
        "refine": render_options.refine_depth,
        **render_options.method_words(opening),
    }
    frames = []
    for row in rows:
        # Text seeds a generator by all of its letters, the same way everywhere.
        random = Random(f"{seed} {row.name}")
        drawn = {name: random.uniform(low, high) for name, (low, high) in ranges.items()}
        focus = row.focus_at or (None if _has_focus(row.lens) else "random" if random_focus else pixel)
        frame = Frame(
            color=row.color,
            depth=row.depth,
            holdout=row.holdout,
            output=output / f"{row.name}{row.suffix or suffix}",
            lens=_options.merged(words | drawn, row.lens),
            focus_at=focus,
            seed=random.getrandbits(63) if focus == "random" else 0,
            reading=reading,
            options=rendering,
            dtype=_options.one_of("--dtype", dtype, io.SAMPLE_TYPES),
            outputs=tuple(outputs.split(",")),
            slices=slices,
            sharp_radius_px=sharp_radius_px,
        )
        try:
            _options.make_lens(frame.lens if focus is None else _options.without_focus(frame.lens))
        except ValueError as error:
            raise ValueError(f"{row.color}: {error}" if row.lens else str(error)) from error
        frames.append(frame)
    if cameras is not None:
        from .batch import with_neighbours
        from .cameras import read_cameras

        frames = with_neighbours(frames, read_cameras(cameras), neighbours)[:limit]
    lists = [
        path for path in (manifest, lens_file, cameras, opening.get("image")) if isinstance(path, (str, Path))
    ]
    searched = [one for one in (color, depth, holdout) if one]
    _check_paths(frames, output, [Path(path) for path in lists], searched)
    _console.wake(render_options.device, verbose=verbose)
    _check_options(frames[0])
    if kind["depth_kind"] == "relative" and depth_options.depth_range is None and not dry_run:
        frames = _with_one_scale(frames)
    if dry_run:
        for frame in frames:
            read = (frame.color, frame.depth, frame.holdout)
            inputs = " + ".join(printable(str(path)) for path in read if path)
            print(f"{inputs} -> {printable(str(frame.output))}")
        look_at(frames[0])
        log.info("%d frames; nothing was written (--dry-run)", len(frames))
        return 0
    return run(frames, output, workers=workers, dask=dask, resume=resume)


def _rows(color: str | None, depth: str | None, manifest: Path | None, output: Path) -> Iterator[Row]:
    """Find the frames, and say which files are none."""
    from .batch import Row, pair_files, read_manifest

    if (color is None) == (manifest is None):
        raise ValueError("give either COLOR (and DEPTH) or --manifest")
    if manifest is not None:
        yield from read_manifest(manifest)
    elif color is not None:
        found = pair_files(color, depth, exclude=output)
        for path in found.unmatched:
            log.warning("%s: has no partner and is left out", path)
        for name, (picture, plane) in found.pairs.items():
            yield Row(name=name, color=picture, depth=plane)


def _with_holdouts(rows: list[Row], color: str | None, holdout: str, output: Path) -> list[Row]:
    """Give frames their holdout: a file to all that have none, or to each the one of its name."""
    from .batch import pair_files

    if Path(holdout).is_file():
        return [row if row.holdout else replace(row, holdout=Path(holdout)) for row in rows]
    if color is None:
        raise ValueError("--holdout is a file for all frames of a --manifest, which names those of each")
    found = dict(pair_files(color, holdout, exclude=output).pairs.values())
    if missing := [row.color for row in rows if row.color not in found]:
        raise ValueError(
            f"{missing[0]}: has no holdout in {holdout}, as {len(missing)} of {len(rows)} frames; give each "
            "one, or name the frames in a --manifest"
        )
    return [replace(row, holdout=found[row.color]) for row in rows]


def _has_focus(words: dict[str, Any]) -> bool:
    return not set(_options.FOCUS_WORDS).isdisjoint(words)


def _check_paths(frames: list[Frame], output: Path, lists: list[Path], searched: list[str]) -> None:
    """Refuse frames that would write over each other, over what is read, or through a link to elsewhere.

    Refuse also what a later run would take for pictures, among those that are ``searched``.
    """
    from .batch.pairs import would_find
    from .batch.pipeline import distinct
    from .batch.records import SUMMARY

    folder = output.resolve()
    read = [path for frame in frames for path in frame.inputs]
    inputs = {path.resolve() for path in (*read, *lists)}
    written = [output / FAILURES, output / SUMMARY]
    for frame in distinct(frames):
        written += [frame.record, *frame.files.values()]
    for path in written:
        if (resolved := path.resolve()) in inputs:
            raise ValueError(f"{path}: is one of the inputs, which are not overwritten")
        if not resolved.is_relative_to(folder):
            raise ValueError(f"{path}: a symbolic link leads it out of {output}")
        for where in searched:
            if would_find(where, path, exclude=output):
                raise ValueError(
                    f"{path}: would be among the files of {where}, and the next run would take it for "
                    f"one; name another folder, such as -o {output / 'out'}, or list the frames in a "
                    "--manifest"
                )


def _check_options(frame: Frame) -> None:
    """Refuse what no picture could be rendered or written with, by rendering a small one."""
    import numpy as np

    from . import io
    from .batch import work

    if frame.dtype is not None and not io.holds(frame.output, frame.dtype):
        raise ValueError(f"--dtype {frame.dtype}: {frame.output.suffix} files have no such samples")
    # What is left of it has 16 pixels a side, and its depth is one in all units, or on its scale.
    side = frame.options["supersample"] * (2 * frame.options["overscan"] + 16)
    image = io.Image(np.ones((side, side, 3), np.float32), "linear", "none")
    middle = np.mean(frame.options.get("depth_range") or 0.5)
    depth = np.full((side, side), middle, np.float32)
    some_focus = replace(frame, focus_at="random" if frame.focus_at is not None else None)
    holdout = None if frame.holdout is None else (np.zeros_like(depth), depth)
    work.render(work.Loaded(frame=some_focus, fingerprint="", image=image, depth=depth, holdout=holdout))


def _with_one_scale(frames: list[Frame]) -> list[Frame]:
    """Give frames of relative depth the scale of all, so that what has not moved keeps its blur."""
    from .batch import depth_range

    if len(frames) < 2 or (found := depth_range(frames)) is None:
        return frames
    log.info(
        "relative depth from %.4g (far) to %.4g (near) in all %d frames; of unrelated pictures, "
        "--depth-range each takes each one's own",
        *found,
        len(frames),
    )
    return [replace(frame, options={**frame.options, "depth_range": found}) for frame in frames]
