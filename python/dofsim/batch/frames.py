"""What a frame is, and what is known of it afterwards: small records that travel between processes."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal, get_args

from dofsim._save import SampleType

Output = Literal["picture", "coc", "mask", "stack"]
Status = Literal["written", "skipped", "failed"]

# Bytes in a name.
_LONGEST_NAME = 255
# All of them are held at a time.
_MOST_SLICES = 1000

OUTPUTS: tuple[Output, ...] = get_args(Output)


@dataclass(frozen=True, kw_only=True)
class Neighbour:
    """A picture beside a frame: another frame of the shot, or the other one of a stereo pair.

    Attributes
    ----------
    color : Path
        File of the picture. Paths may be given as strings.
    depth : Path, optional
        File of the depth; without it the depth is in the file of the picture.
    camera : mapping
        ``pose`` and ``intrinsics`` as of `dofsim.layers_from_views`, and ``size``, width and height.
    """

    color: Path
    camera: Mapping[str, Any]
    depth: Path | None = None

    def __post_init__(self) -> None:
        """Turn paths into paths."""
        for name in ("color", "depth"):
            if (path := getattr(self, name)) is not None:
                object.__setattr__(self, name, Path(path))


@dataclass(frozen=True, kw_only=True)
class Frame:
    """One picture to be rendered: where it comes from, where it goes, and how.

    Attributes
    ----------
    color : Path
        File of the picture. Paths may be given as strings.
    depth : Path, optional
        File of the depth; without it the depth is in the file of the picture.
    output : Path
        File of the result. The others are named after it: ``a.exr`` has ``a.exr.json`` (the record),
        ``a.coc.exr``, ``a.mask.png`` and ``a.focus-00.exr``, ``a.focus-01.exr`` and so on.
    lens : mapping
        The arguments of `dofsim.Lens`, of `Lens.from_camera` or of `Lens.from_disparity`, by name.
    focus_at : tuple of int or "random", optional
        Column and row of the pixel to focus on, in place of the lens's own focus; or any pixel with finite
        depth, chosen by ``seed``.
    seed : int
        Chooses the pixel of ``focus_at="random"``.
    reading : mapping
        Arguments of `dofsim.io.read_rgbd` by name, and ``alpha`` in place of that of the file. By
        ``window="data"``, what an OpenEXR file stores beyond its display window is overscan.
    options : mapping
        Arguments of `dofsim.render` by name, those of the method among them.
    dtype : {"half", "float", "uint8", "uint16"}, optional
        The samples of the result, as for `dofsim.io.write_image`.
    outputs : tuple of {"picture", "coc", "mask", "stack"}
        What to write: the picture, the signed radius of the circle of confusion in pixels of the depth map
        (OpenEXR), which of these pixels are within the depth of field (PNG, white), and a focal stack.
    sharp_radius_px : float
        The largest radius of the circle of confusion that counts as within the depth of field.
    camera : mapping, optional
        The frame's own camera, as of `Neighbour`.
    neighbours : tuple of Neighbour
        Pictures that see what this one hides; see `dofsim.layers_from_views` and `with_neighbours`.
    holdout : Path, optional
        File of a picture with depth and alpha that blocks the light of what is behind it, as of
        `dofsim.render`.
    slices : int
        Pictures of the focal stack. Their distances are evenly spaced in disparity from the nearest to the
        farthest finite depth of the frame.

    Examples
    --------
    >>> from dofsim.batch import Frame
    >>> lens = {"aperture_radius": 0.02, "focus_distance": 2.0, "fov": 40.0}
    >>> frame = Frame(color="0001.exr", output="out/0001.exr", lens=lens)
    >>> frame.record.as_posix()
    'out/0001.exr.json'
    """

    color: Path
    output: Path
    lens: Mapping[str, Any]
    depth: Path | None = None
    focus_at: tuple[int, int] | Literal["random"] | None = None
    seed: int = 0
    reading: Mapping[str, Any] = field(default_factory=dict)
    options: Mapping[str, Any] = field(default_factory=dict)
    dtype: SampleType | None = None
    outputs: tuple[Output, ...] = ("picture",)
    sharp_radius_px: float = 0.5
    slices: int = 0
    camera: Mapping[str, Any] | None = None
    neighbours: tuple[Neighbour, ...] = ()
    holdout: Path | None = None

    def __post_init__(self) -> None:
        """Turn paths into paths and refuse what no frame can be."""
        for name in ("color", "output", "depth", "holdout"):
            if (path := getattr(self, name)) is not None:
                object.__setattr__(self, name, Path(path))
        object.__setattr__(self, "outputs", tuple(self.outputs))
        if not self.outputs or not set(self.outputs) <= set(OUTPUTS):
            raise ValueError(f"outputs must be some of {', '.join(OUTPUTS)}; got {self.outputs}")
        most = _MOST_SLICES if "stack" in self.outputs else 0
        if not min(most, 1) <= self.slices <= most:
            raise ValueError(
                f"slices must be positive and at most {_MOST_SLICES} with a stack and 0 without; "
                f"got {self.slices}"
            )
        object.__setattr__(self, "neighbours", tuple(self.neighbours))
        if self.neighbours and self.camera is None:
            raise ValueError("camera must be given with neighbours")
        if not self.sharp_radius_px > 0:
            raise ValueError(f"sharp_radius_px must be positive; got {self.sharp_radius_px}")

    @property
    def inputs(self) -> list[Path]:
        """The files that are read, those of neighbours among them."""
        pictures: list[Frame | Neighbour] = [self, *self.neighbours]
        paths = [path for one in pictures for path in (one.color, one.depth)]
        return [path for path in (*paths, self.holdout) if path is not None]

    @property
    def record(self) -> Path:
        """The file that says how the frame was made; when it is there, the frame is done."""
        return self.output.with_name(_fitting(self.output.name, ".json"))

    @property
    def files(self) -> dict[str, Path]:
        """The files to write, by what they hold; the slices of the stack are ``focus-00`` and so on."""
        stem, suffix = self.output.stem, self.output.suffix
        single = {
            "picture": self.output.name,
            "coc": _fitting(stem, ".coc.exr"),
            "mask": _fitting(stem, ".mask.png"),
        }
        wanted: set[str] = set(self.outputs)
        files = {name: file for name, file in single.items() if name in wanted}
        slices = [f"focus-{index:02}" for index in range(self.slices)]
        files |= {name: _fitting(stem, f".{name}{suffix}") for name in slices}
        return {name: self.output.with_name(file) for name, file in files.items()}


def _fitting(name: str, suffix: str) -> str:
    """Add a suffix; where that is more than a file system allows, a hash stands for the end of the name."""
    if len(os.fsencode(name + suffix)) <= _LONGEST_NAME:
        return name + suffix
    whole = os.fsencode(name)
    mark = "-" + hashlib.sha256(whole).hexdigest()[:16] + suffix
    return whole[: _LONGEST_NAME - len(mark)].decode(errors="ignore") + mark


@dataclass(frozen=True, kw_only=True)
class Result:
    """What became of a frame.

    Attributes
    ----------
    frame : Frame
        The frame.
    status : {"written", "skipped", "failed"}
        Skipped frames were there already, made from the same inputs with the same parameters.
    error : str, optional
        What went wrong, if it failed.
    seconds : float
        Time spent rendering.
    """

    frame: Frame
    status: Status
    error: str | None = None
    seconds: float = 0.0
