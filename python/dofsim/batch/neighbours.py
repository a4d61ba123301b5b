"""What the frames beside a frame saw: which they are, their pictures, and layers."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from threading import Lock
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

import dofsim
from dofsim._frame import Framed

from .frames import Frame, Neighbour

if TYPE_CHECKING:
    from dofsim.cameras import Camera

__all__ = ["Pictures", "layered", "with_neighbours"]


def with_neighbours(frames: Sequence[Frame], cameras: Sequence[Camera], neighbours: int) -> list[Frame]:
    """Return frames that get what the frames beside them saw.

    Parameters
    ----------
    frames : sequence of Frame
        The frames of one shot, in the order of time.
    cameras : sequence of Camera
        Of each frame the camera whose name has the stem of the picture's; where no camera has such a name, as
        many cameras as frames, in their order. See `dofsim.cameras.read_cameras`.
    neighbours : int
        How many frames beside each, the nearest ones: for 4, two before and two after it.

    Returns
    -------
    list of Frame
        The same frames with `camera` and `neighbours`.

    Raises
    ------
    ValueError
        If a frame has no camera.

    Examples
    --------
    >>> import numpy as np
    >>> from dofsim import Camera
    >>> from dofsim.batch import Frame, with_neighbours
    >>> lens = {"aperture_radius": 0.02, "focus_distance": 1.0, "fov": 40.0}
    >>> frames = [Frame(color=f"{i}.exr", output=f"out/{i}.exr", lens=lens) for i in range(3)]
    >>> camera = Camera(np.eye(4), [[500, 0, 319.5], [0, 500, 239.5], [0, 0, 1]], (640, 480))
    >>> cameras = [camera.moved(right=0.01 * i) for i in range(3)]
    >>> [[one.color.name for one in frame.neighbours] for frame in with_neighbours(frames, cameras, 2)]
    [['1.exr', '2.exr'], ['0.exr', '2.exr'], ['1.exr', '0.exr']]
    """
    if neighbours < 1:
        raise ValueError(f"neighbours must be at least 1; got {neighbours}")
    words = [camera_words(camera) for camera in _matched(frames, cameras)]
    out = []
    for i, frame in enumerate(frames):
        others = sorted((j for j in range(len(frames)) if j != i), key=lambda j: (abs(j - i), j))
        beside = tuple(
            Neighbour(color=frames[j].color, depth=frames[j].depth, camera=words[j])
            for j in others[:neighbours]
        )
        out.append(replace(frame, camera=words[i], neighbours=beside))
    return out


def camera_words(camera: Camera) -> dict[str, Any]:
    """Put a camera into the words of a record."""
    return {
        "pose": camera.pose.tolist(),
        "intrinsics": camera.intrinsics.tolist(),
        "size": list(camera.size),
    }


def _matched(frames: Sequence[Frame], cameras: Sequence[Camera]) -> list[Camera]:
    by_stem = {Path(camera.name).stem: camera for camera in cameras if camera.name}
    found = [by_stem.get(frame.color.stem) for frame in frames]
    if not any(found) and len(cameras) == len(frames):
        return list(cameras)
    for frame, camera in zip(frames, found, strict=True):
        if camera is None:
            raise ValueError(
                f"{frame.color}: no camera has the name {frame.color.stem!r}; of {len(cameras)} cameras for "
                f"{len(frames)} frames, {len(by_stem)} have a name"
            )
    return [camera for camera in found if camera is not None]


class Pictures:
    """The pictures that were last read, for the frames that follow.

    A frame holds itself and its neighbours. The next one needs one more, and so does one that is read ahead.
    """

    def __init__(self) -> None:
        """Keep nothing yet."""
        self._kept: OrderedDict[tuple[Any, ...], Framed] = OrderedDict()
        self._lock = Lock()

    def read(
        self,
        color: Path,
        depth: Path | None,
        keep: int,
        words: Mapping[str, Any],
        read: Callable[..., Framed],
    ) -> Framed:
        """Read a picture unless it is kept; keep so many."""
        stamps = [_stamp(path) for path in (color, depth) if path is not None]
        key = (str(color), str(depth), tuple(stamps), repr(sorted(words.items())))
        with self._lock:
            if (found := self._kept.get(key)) is not None:
                self._kept.move_to_end(key)
                return found
        found = read(color, depth, **words)
        with self._lock:
            self._kept[key] = found
            while len(self._kept) > keep:
                self._kept.popitem(last=False)
        return found


def _stamp(path: Path) -> tuple[int, int]:
    status = path.stat()
    return status.st_size, status.st_mtime_ns


def layered(
    frame: Frame,
    color: NDArray[Any],
    depth: NDArray[np.float32],
    others: Sequence[tuple[NDArray[Any], NDArray[np.float32]]],
    lens: dofsim.Lens,
    **options: Any,
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Make layers of a frame and its neighbours; ``options`` as of `dofsim.layers_from_views`.

    Raises
    ------
    ValueError
        If a picture is not of the size that its camera says, or as `dofsim.layers_from_views`.
    """
    assert frame.camera is not None
    cameras = [frame.camera, *(one.camera for one in frame.neighbours)]
    files = [frame.color, *(one.color for one in frame.neighbours)]
    for file, camera, (picture, _) in zip(files, cameras, [(color, depth), *others], strict=True):
        if tuple(camera["size"]) != picture.shape[1::-1]:
            width, height = camera["size"]
            raise ValueError(
                f"{file}: is of {picture.shape[1]} x {picture.shape[0]} pixels, and its camera of "
                f"{width} x {height}"
            )
    return dofsim.layers_from_views(
        [color, *(picture for picture, _ in others)],
        [depth, *(plane for _, plane in others)],
        np.array([camera["pose"] for camera in cameras]),
        np.array([camera["intrinsics"] for camera in cameras]),
        lens=lens,
        **options,
    )
