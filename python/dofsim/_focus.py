"""Focus that moves from frame to frame."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from itertools import pairwise
from typing import TYPE_CHECKING, Any, Literal

from dofsim._dofsim import Lens, Scene

if TYPE_CHECKING:
    from numpy.typing import NDArray

Easing = Literal["linear", "smooth", "in", "out"]

# How far along a move is, by the part of its time that is over. Smooth starts and ends at rest.
_EASINGS: dict[str, Callable[[float], float]] = {
    "linear": lambda part: part,
    "smooth": lambda part: part * part * (3.0 - 2.0 * part),
    "in": lambda part: part * part,
    "out": lambda part: part * (2.0 - part),
}


def focus_pull(
    scene: Scene,
    lens: Lens,
    keyframes: Sequence[tuple[int, float]],
    *,
    easing: Easing = "smooth",
    **options: Any,
) -> Iterator[NDArray[Any]]:
    """Yield the pictures of a scene while the focus moves, one frame after another.

    Between two keyframes the disparity in focus moves, not the distance: blur is linear in disparity, so that
    it changes evenly, and the focus may come from infinity.

    Parameters
    ----------
    scene : Scene
        The scene; what does not depend on the focus is prepared once.
    lens : Lens
        The lens; its own focus does not matter. One that breathes does so here.
    keyframes : sequence of (int, float)
        Numbers of frames, rising, and what is in focus then: a distance in metres, or a disparity for a lens
        made by `Lens.from_disparity`.
    easing : {"smooth", "linear", "in", "out"}, optional
        How the focus moves between two keyframes: at rest at both, evenly, or at rest at the first or the
        last only.
    **options
        As for `Scene.render`: ``method``, ``aperture``, ``max_coc_px``, ``threads`` and those of the method.

    Yields
    ------
    ndarray
        A picture for every frame from the first keyframe to the last, both among them.

    Raises
    ------
    ValueError
        If there is no keyframe, their frames do not rise, the easing is none of these, or `in_focus` is among
        the options; before the first frame.

    Examples
    --------
    >>> import dofsim
    >>> import numpy as np
    >>> scene = dofsim.Scene(np.ones((32, 48, 3), np.float32), np.full((32, 48), 2.0))
    >>> lens = dofsim.Lens(aperture_radius=0.1, focus_distance=3.0, fov=42.0)
    >>> frames = dofsim.focus_pull(scene, lens, [(0, 1.0), (4, 8.0)])
    >>> sum(1 for frame in frames)
    5
    """
    if options.get("in_focus") is not None:
        raise ValueError("in_focus would hold the focus still; focus_pull takes keyframes alone")
    if easing not in _EASINGS:
        raise ValueError(f"easing must be one of {', '.join(_EASINGS)}; got {easing!r}")
    frames = [frame for frame, _ in keyframes]
    if not frames or any(later <= earlier for earlier, later in pairwise(frames)):
        raise ValueError(
            f"keyframes must have at least one frame, and rising numbers of frames; got {frames}"
        )
    lenses = [focused(lens, focus) for focus in _positions(lens, keyframes, _EASINGS[easing])]
    return (scene.render(one, **options) for one in lenses)


def _positions(
    lens: Lens, keyframes: Sequence[tuple[int, float]], ease: Callable[[float], float]
) -> Iterator[float]:
    """Give what is in focus in every frame, in the words of the keyframes."""
    metric = lens.focus is None
    if metric and (bad := [focus for _, focus in keyframes if not focus > 0.0]):
        raise ValueError(f"keyframes must have distances in metres greater than 0; got {bad[0]}")
    ends = [(frame, 1.0 / focus if metric else focus) for frame, focus in keyframes]
    for (first, start), (last, end) in pairwise(ends):
        for frame in range(first, last):
            disparity = start + (end - start) * ease((frame - first) / (last - first))
            yield _distance(disparity) if metric else disparity
    yield keyframes[-1][1]


def _distance(disparity: float) -> float:
    return 1.0 / disparity if disparity > 0.0 else float("inf")


def focused(lens: Lens, focus: float) -> Lens:
    """Focus a lens on a distance in metres, or on a relative disparity."""
    return lens.replace(focus_distance=focus) if lens.focus is None else lens.replace(focus=focus)
