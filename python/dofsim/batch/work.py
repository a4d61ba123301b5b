"""One frame in three steps that can overlap with those of other frames: read, compute, write."""

from __future__ import annotations

import errno
import random
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

import dofsim
from dofsim import _options, io
from dofsim._dofsim import focusable_pixels
from dofsim._focus import focused
from dofsim._frame import Framed, read_framed, read_holdout, squeezed
from dofsim._report import Report
from dofsim._save import Alpha, SampleType

from .frames import Frame, Neighbour, Result
from .neighbours import Pictures, layered
from .records import fingerprint, is_done, write_record

T = TypeVar("T")

_DEPTH_WORDS = ("depth_kind", "near", "far", "depth_range")
_REFINING_WORDS = ("depth_kind", "near", "far", "invalid", "invalid_color", "threads")
# What is said of the picture alone, in reading.
_OF_PICTURES = {"layer", "transfer", "same_size"}
_SCENE_WORDS = ("device", *_DEPTH_WORDS, "invalid", "invalid_color", "overscan", "supersample")
_PICTURES = Pictures()
# No frame after it can be written either, so this ends the run.
_DISK_FULL = {errno.ENOSPC, errno.EDQUOT}


@dataclass(frozen=True, eq=False, kw_only=True)
class Loaded:
    """A frame that has been read."""

    frame: Frame
    fingerprint: str
    image: io.Image
    depth: NDArray[np.float32]
    framed: Framed | None = None
    channels: Mapping[str, Any] = field(default_factory=dict)
    neighbours: tuple[Framed, ...] = ()
    holdout: tuple[NDArray[np.float32], NDArray[np.float32]] | None = None


@dataclass(frozen=True, eq=False, kw_only=True)
class Rendered:
    """A frame that has been computed: the pixels of its files by what they hold, and what was chosen."""

    frame: Frame
    fingerprint: str
    pixels: dict[str, NDArray[Any]]
    alpha: Alpha
    dtype: SampleType | None
    profile: io.ColorProfile | None
    found: dict[str, Any]
    seconds: float
    framed: Framed | None = None


def run(frame: Frame, resume: bool) -> Result:
    """Do all of a frame.

    Parameters
    ----------
    frame : Frame
        The frame.
    resume : bool
        Whether to leave it alone if it is done.

    Returns
    -------
    Result
        What became of it.
    """
    return write(compute(read(frame, resume)))


def read(frame: Frame, resume: bool) -> Loaded | Result:
    """Read a frame, unless it is done."""
    return _guarded(frame, lambda: _read(frame, resume))


def compute(loaded: Loaded | Result) -> Rendered | Result:
    """Compute a frame that could be read."""
    if isinstance(loaded, Result):
        return loaded
    return _guarded(loaded.frame, lambda: render(loaded))


def write(rendered: Rendered | Result) -> Result:
    """Write a frame that could be computed."""
    if isinstance(rendered, Result):
        return rendered
    return _guarded(rendered.frame, lambda: _write(rendered))


def _guarded(frame: Frame, step: Callable[[], T]) -> T | Result:
    try:
        return step()
    except Exception as error:
        if isinstance(error, OSError) and error.errno in _DISK_FULL:
            raise OSError(error.errno, error.strerror, str(frame.output)) from error
        if isinstance(error, OSError) and error.filename:
            message = f"{error.filename}: {error.strerror}"
        elif isinstance(error, MemoryError):
            message = str(error) or "not enough memory"
        elif isinstance(error, (OSError, ValueError, TypeError, dofsim.DeviceError, ImportError)):
            message = str(error)
        else:
            message = f"internal error: {type(error).__name__}: {error}"
        return Result(frame=frame, status="failed", error=message)


def _read(frame: Frame, resume: bool) -> Loaded | Result:
    mark = fingerprint(frame)
    if resume and is_done(frame, mark):
        return Result(frame=frame, status="skipped")
    words = dict(frame.reading)
    alpha = words.pop("alpha", None)
    grid = {name: frame.options[name] for name in ("overscan", "supersample") if name in frame.options}
    read_words = {**grid, **words}
    if frame.options.get("depth_kind") == "relative":
        # Whole numbers need no unit then.
        read_words.setdefault("depth_scale", 1.0)
    beside: list[Framed] = []
    if frame.neighbours:
        keep = len(frame.neighbours) + 2
        pictures: list[Frame | Neighbour] = [frame, *frame.neighbours]
        framed, *beside = [
            _PICTURES.read(one.color, one.depth, keep, read_words, read_framed) for one in pictures
        ]
    else:
        framed = read_framed(frame.color, frame.depth, **read_words)
    rgbd = framed.rgbd
    image = rgbd.image
    holdout = None
    if frame.holdout is not None:
        of_holdout = {name: word for name, word in read_words.items() if name not in _OF_PICTURES}
        holdout = read_holdout(frame.holdout, framed, **of_holdout)
    return Loaded(
        frame=frame,
        fingerprint=mark,
        image=replace(image, alpha=alpha) if alpha else image,
        depth=rgbd.depth,
        framed=framed,
        channels={"color_channels": rgbd.color_channels, "depth_channel": rgbd.depth_channel},
        neighbours=tuple(beside),
        holdout=holdout,
    )


def render(loaded: Loaded) -> Rendered:
    """Compute a frame, and raise what is wrong with it.

    Parameters
    ----------
    loaded : Loaded
        The frame.

    Returns
    -------
    Rendered
        What is to be written.

    Raises
    ------
    ValueError, TypeError, DeviceError
        As `dofsim.render`.
    """
    frame, image, depth, framed = loaded.frame, loaded.image, loaded.depth, loaded.framed
    options = dict(frame.options)
    kind = {name: options[name] for name in _DEPTH_WORDS if name in options}
    alpha: Alpha = "premultiplied" if image.alpha != "none" else "none"
    color = image.to_linear()
    others = [(one.rgbd.image.to_linear(), one.rgbd.depth) for one in loaded.neighbours]
    # The margin that was found may be wider than the one that was asked for.
    margin = options.get("overscan", 0) if framed is None else framed.overscan
    finer = options.get("supersample", 1)
    scene_words = {name: value for name, value in options.items() if name in _SCENE_WORDS}
    scene_words |= {"overscan": margin, "alpha": alpha, "transfer": "linear"}
    if loaded.holdout is not None:
        if others and kind.get("depth_kind", "z") != "z":
            raise ValueError(
                "holdout goes with neighbours for depth_kind='z', as layers of several pictures have it; got "
                f"depth_kind={kind['depth_kind']!r}"
            )
        scene_words["holdout"] = loaded.holdout
    scene: dofsim.Scene | None = None
    # Before all else: the focus, the circle of confusion and the pictures are of the refined depth.
    if options.pop("refine", False):
        if others:
            given = {name: options[name] for name in _REFINING_WORDS if name in options}
            pictures = [(color, depth), *others]
            (_, depth), *others = [
                (one, dofsim.refine_depth(one, plane, alpha=alpha, **given)) for one, plane in pictures
            ]
        else:
            scene = dofsim.Scene(color, depth, refine=True, **scene_words)
            depth = scene.depth
        framed = framed and replace(framed, rgbd=replace(framed.rgbd, depth=depth))
    seen = depth if framed is None else framed.seen_depth(finer)
    found = dict(loaded.channels)
    words = dict(frame.lens)
    if frame.focus_at is not None:
        pixel = _any_pixel(words, seen, frame, kind) if frame.focus_at == "random" else frame.focus_at
        words = _options.focused_words(words, pixel, seen, **kind)
        found["focus_at"] = pixel
    lens = _options.make_lens(words)
    render_words = {name: value for name, value in options.items() if name not in _SCENE_WORDS}
    if (in_focus := render_words.pop("in_focus", None)) is not None:
        lens = lens.replace(in_focus=in_focus)
    found["lens"] = words
    if framed is not None:
        lens, aperture = squeezed(
            lens, render_words.get("aperture"), framed.pixel_aspect, kind.get("depth_kind", "z")
        )
        render_words |= {} if aperture is None else {"aperture": aperture}
    report = Report.of(
        depth,
        lens,
        **kind,
        overscan=margin,
        supersample=finer,
        max_coc_px=frame.options.get("max_coc_px"),
    )
    found |= report.record()

    start = time.perf_counter()
    pixels: dict[str, NDArray[Any]] = {}
    lenses = {"picture": lens} if "picture" in frame.outputs else {}
    if "stack" in frame.outputs:
        slices = _stack(lens, depth, frame, kind)
        found["stack"] = {name: _focus(one) for name, one in slices.items()}
        lenses |= slices
    if lenses:
        if others:
            # Views have a metric scale of their own.
            scale = ("device", "depth_range")
            viewing = {name: value for name, value in scene_words.items() if name not in scale}
            viewing.pop("holdout", None)
            viewing["threads"] = options.get("threads")
            layers, planes = layered(frame, color, depth, others, lens, **viewing)
            found["layers"] = len(layers)
            # What comes back is planar depth, and colours that are finite and have coverage.
            scene_words = {name: value for name, value in scene_words.items() if name not in _DEPTH_WORDS}
            scene = dofsim.Scene(layers, planes, **scene_words | {"alpha": "premultiplied"})
        scene = scene or dofsim.Scene(color, depth, **scene_words)
        if scene.filled_pixels:
            found["filled_pixels"] = scene.filled_pixels
        for name, one in lenses.items():
            picture = scene.render(one, **render_words)
            if others:
                picture = _as_given(picture, color)
            pixels[name] = picture if framed is None else framed.cut(picture)
    if {"coc", "mask"} & set(frame.outputs):
        radius = _coc(lens, depth, frame, kind, max_coc_px=options.get("max_coc_px"))
        sharp = np.abs(radius) <= frame.sharp_radius_px
        maps = {"coc": radius, "mask": np.where(sharp, np.uint8(255), np.uint8(0))}
        pixels |= {name: maps[name] for name in ("coc", "mask") if name in frame.outputs}

    dtype = frame.dtype
    if dtype is None and image.pixels.dtype == np.uint16 and io.holds(frame.output, "uint16"):
        dtype = "uint16"
    return Rendered(
        frame=frame,
        fingerprint=loaded.fingerprint,
        pixels=pixels,
        alpha=alpha,
        dtype=dtype,
        profile=image.profile,
        found=found,
        seconds=time.perf_counter() - start,
        framed=framed,
    )


def _as_given(picture: NDArray[Any], color: NDArray[Any]) -> NDArray[Any]:
    """Give a picture of premultiplied colour the channels that another one has."""
    return picture[..., 0] if color.ndim == 2 else picture[..., : color.shape[2]]


def _write(rendered: Rendered) -> Result:
    frame, framed = rendered.frame, rendered.framed
    inputs = {path.resolve() for path in frame.inputs}
    for path in frame.files.values():
        if path.resolve() in inputs:
            raise ValueError(f"{path}: is one of the inputs, which are not overwritten")
    frame.output.parent.mkdir(parents=True, exist_ok=True)
    # From here to the new record, the outputs may be of two kinds.
    frame.record.unlink(missing_ok=True)
    for name, path in frame.files.items():
        pixels = rendered.pixels[name]
        if name == "coc":
            io.write_exr(path, {"coc": pixels})
        elif name == "mask":
            io.write_image(path, pixels)
        else:
            io.write_image(
                path,
                pixels,
                alpha=rendered.alpha,
                dtype=rendered.dtype,
                attributes_of=framed.source if framed else None,
                corner=framed.corner if framed else None,
                profile=rendered.profile,
            )
    write_record(frame, rendered.fingerprint, rendered.found)
    return Result(frame=frame, status="written", seconds=rendered.seconds)


def _any_pixel(
    words: dict[str, Any], depth: NDArray[np.float32], frame: Frame, kind: dict[str, Any]
) -> tuple[int, int]:
    """Choose among the pixels that can be focused on; the generator's numbers are the same everywhere."""
    candidates = _focusable(_options.make_lens(_options.without_focus(words)), depth, kind)
    chosen = candidates[random.Random(frame.seed).randrange(candidates.size)]
    y, x = divmod(int(chosen), depth.shape[1])
    return x, y


def _focusable(lens: dofsim.Lens, depth: NDArray[np.float32], kind: dict[str, Any]) -> NDArray[np.int64]:
    """Find the pixels that the lens can be focused on, in the order of rows."""
    if depth.ndim != 2:
        raise ValueError(
            "focus_at='random' and stack: the depth has layers, of which none is the one to focus on"
        )
    found = focusable_pixels(lens, depth, **kind)
    if found.size == 0:
        raise ValueError("focus_at='random' and stack: no pixel has a finite depth to focus on")
    return found


def _coc(
    lens: dofsim.Lens,
    depth: NDArray[np.float32],
    frame: Frame,
    kind: dict[str, Any],
    max_coc_px: float | None = None,
) -> NDArray[np.float32]:
    if frame.options.get("overscan"):
        raise ValueError("coc, mask and stack are of the whole depth map and go with overscan=0 alone")
    invalid = frame.options.get("invalid", "raise")
    return dofsim.coc(depth, lens, **kind, invalid=invalid, max_coc_px=max_coc_px)


def _stack(
    lens: dofsim.Lens, depth: NDArray[np.float32], frame: Frame, kind: dict[str, Any]
) -> dict[str, dofsim.Lens]:
    """Lenses focused from the nearest to the farthest depth, evenly spaced in disparity."""
    # Of a range in focus, its middle: within the range no depth has a larger radius than another.
    lens = focused(lens, _focus(lens))
    pixels = _focusable(lens, depth, kind)
    # The radius grows with the distance, whatever the kind of depth.
    radius = _coc(lens, depth, frame, kind).ravel()[pixels]
    ends = [divmod(int(pixels[extreme]), depth.shape[1]) for extreme in (radius.argmin(), radius.argmax())]
    near, far = (lens.focused_at(depth, x, y, **kind) for y, x in ends)
    share = np.linspace(0.0, 1.0, frame.slices) if frame.slices > 1 else np.array([0.5])
    if lens.focus is not None:
        between = _focus(near) + share * (_focus(far) - _focus(near))
        lenses = [focused(lens, float(disparity)) for disparity in between]
    else:
        between = 1.0 / _focus(near) + share * (1.0 / _focus(far) - 1.0 / _focus(near))
        # Disparity zero is the infinite distance.
        with np.errstate(divide="ignore"):
            lenses = [focused(lens, float(distance)) for distance in 1.0 / between]
    return {f"focus-{index:02}": one for index, one in enumerate(lenses)}


def _focus(lens: dofsim.Lens) -> float:
    focus = lens.focus if lens.focus is not None else lens.focus_distance
    assert focus is not None
    return focus
