"""A picture with its depth as it is shown: prepared once at its own size and once reduced."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

import dofsim
from dofsim import falsecolor
from dofsim._dofsim import encode_png
from dofsim._drawing import SHARP_RADIUS_PX, codes

Overlay = Literal["picture", "coc", "outline"]
OVERLAYS: tuple[Overlay, ...] = ("picture", "coc", "outline")

# The longest side of what is shown while something is dragged, and else: about that of the widest page. A PNG
# of 24 million pixels would be tens of megabytes for the browser to decode.
PREVIEW_PX, SHOWN_PX = 512, 2048

# How much of the picture a far-off colour hides.
_OPACITY = 0.78
_OUTLINE = (255, 214, 10)


@dataclass(frozen=True, eq=False)
class Look:
    """A scene at one size.

    Attributes
    ----------
    scene : Scene
        What is rendered.
    pinhole : ndarray of float32
        Shape (H, W, 3): what is seen without a lens.
    depth : ndarray
        Shape (H, W): of the surface that is seen.
    reduced : int
        Pixels of the given picture to one of this, along each axis.
    depth_words : dict
        How to read the depth.
    """

    scene: dofsim.Scene
    pinhole: NDArray[np.float32]
    depth: NDArray[Any]
    reduced: int
    depth_words: dict[str, Any]

    @classmethod
    def at(
        cls,
        color: NDArray[np.float32],
        depth: NDArray[Any],
        *,
        reduced: int,
        alpha: Literal["premultiplied", "none"],
        device: str,
        invalid_color: Literal["raise", "fill"],
        depth_words: dict[str, Any],
    ) -> Look:
        """Prepare linear colour (..., H, W, C) and depth (..., H, W), reduced by a whole factor."""
        if reduced > 1:
            color, depth = _mean_of_blocks(color, reduced), _middle_of_blocks(depth, reduced)
        scene = dofsim.Scene(
            color, depth, alpha=alpha, device=device, invalid_color=invalid_color, **depth_words
        )
        # Where the scene has filled a pixel, there was nothing to be seen.
        given = np.where(np.isfinite(color), color, 0.0) if scene.filled_pixels else color
        return cls(scene, _flat(given), seen(given, depth), reduced, depth_words)

    def _lens(self, lens: dofsim.Lens) -> dofsim.Lens:
        """Give the lens for pixels of this size: only strengths are counted in them."""
        return lens if lens.strength_px is None else lens.replace(strength_px=lens.strength_px / self.reduced)

    def picture(
        self,
        lens: dofsim.Lens,
        aperture: dofsim.Aperture,
        *,
        max_coc_px: float | None = None,
        **options: Any,
    ) -> NDArray[np.float32]:
        """Render what the lens sees, (H, W, 3) over black."""
        # No method takes a bound below a pixel.
        bound = None if max_coc_px is None else max(max_coc_px / self.reduced, min(max_coc_px, 1.0))
        return _flat(self.scene.render(self._lens(lens), aperture=aperture, max_coc_px=bound, **options))

    def overlay(self, lens: dofsim.Lens, kind: Overlay) -> bytes | None:
        """Draw what lies over the picture, as a PNG with transparency."""
        if kind == "picture":
            return None
        radius = dofsim.coc(self.depth, self._lens(lens), **self.depth_words)
        return encode_png(_colored(radius) if kind == "coc" else _outlined(radius))


def reduction(shape: tuple[int, ...], longest_px: int) -> int:
    """Give the factor that makes a picture at most so wide and high."""
    return -(-max(shape[-2:]) // longest_px)


def png(linear: NDArray[np.float32], *, exposure: float) -> bytes:
    """Encode linear light as it looks when exposed by so many stops more."""
    return encode_png(codes(linear * np.float32(2.0**exposure)))


def _colored(radius: NDArray[np.float32]) -> NDArray[np.uint8]:
    """Colour signed radii: near red, far blue, and nothing where the picture is sharp."""
    limit = falsecolor.round_limit(radius)
    sharpness = np.clip((np.abs(radius) - SHARP_RADIUS_PX) / (0.35 * limit), 0.0, 1.0)
    # A weak blur shows a weak tint rather than none of its hue.
    hue = np.sign(radius) * np.maximum(np.abs(radius), 0.4 * limit)
    cover = np.rint(255.0 * _OPACITY * sharpness).astype(np.uint8)
    return np.concatenate([falsecolor.false_color(hue, limit), cover[..., np.newaxis]], axis=-1)


def _outlined(radius: NDArray[np.float32]) -> NDArray[np.uint8]:
    """Draw the border of what is sharp, outside of it."""
    sharp = np.pad(np.abs(radius) <= SHARP_RADIUS_PX, 1, mode="edge")
    rows, columns = radius.shape
    around = np.zeros(radius.shape, bool)
    for y, x in np.ndindex(3, 3):
        around |= sharp[y : y + rows, x : x + columns]
    line = around & ~sharp[1:-1, 1:-1]
    codes = np.zeros((*radius.shape, 4), np.uint8)
    codes[line] = (*_OUTLINE, 255)
    return codes


def _mean_of_blocks(color: NDArray[np.float32], n: int) -> NDArray[np.float32]:
    """Average squares of n x n pixels; what does not fill one at the right and the bottom is left out."""
    *first, rows, columns, channels = color.shape
    rows, columns = rows // n, columns // n
    blocks = color[..., : n * rows, : n * columns, :].reshape(*first, rows, n, columns, n, channels)
    mean: NDArray[np.float32] = blocks.mean(axis=(-4, -2), dtype=np.float32)
    return mean


def _middle_of_blocks(depth: NDArray[Any], n: int) -> NDArray[Any]:
    """Pick the middle of each: depths of two surfaces have no mean."""
    rows, columns = depth.shape[-2] // n, depth.shape[-1] // n
    return np.ascontiguousarray(depth[..., n // 2 :: n, n // 2 :: n][..., :rows, :columns])


def _flat(color: NDArray[Any]) -> NDArray[np.float32]:
    """Lay layers over each other, and over black; grey becomes three channels."""
    if color.ndim == 4:
        covered = np.cumprod(1.0 - color[:-1, ..., 3:], axis=0)
        color = color[0] + (covered * color[1:]).sum(axis=0)
    color = color[..., :3] if color.shape[-1] >= 3 else color[..., :1]
    return np.ascontiguousarray(np.broadcast_to(color, (*color.shape[:2], 3)), dtype=np.float32)


def seen(color: NDArray[np.float32], depth: NDArray[Any]) -> NDArray[Any]:
    """Give the depth of the nearest layer that mostly covers a pixel; of the farthest where none does."""
    if depth.ndim == 2:
        return depth
    covers = color[..., 3] >= 0.5
    covers[-1] = True
    found: NDArray[Any] = np.take_along_axis(depth, covers.argmax(axis=0)[np.newaxis], axis=0)[0]
    return found
