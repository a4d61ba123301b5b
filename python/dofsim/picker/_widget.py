"""The widget: a request in, a frame out."""

from __future__ import annotations

import base64
from functools import cached_property
from pathlib import Path
from typing import Any, Literal

import anywidget
import numpy as np
import traitlets
from numpy.typing import NDArray

import dofsim
from dofsim import io
from dofsim._blur import in_focus
from dofsim._relative import range_of

from ._look import OVERLAYS, PREVIEW_PX, SHOWN_PX, Look, png, reduction, seen

__all__ = ["FocusPicker"]

# Whole stops that the opening can be closed and opened from what it is.
_STOPS = (-8.0, 4.0)
# A slider's place for a round opening, below that of three blades.
_ROUND = 2


class FocusPicker(anywidget.AnyWidget):  # type: ignore[misc, unused-ignore]
    """A widget that focuses a picture by a click, in Jupyter.

    A click or a drag on the picture focuses there; so do the arrow keys. Sliders open the lens, count its
    blades and expose the picture; the blur of every pixel can be laid over it as colour (near red, far blue,
    in focus clear), or the sharp zone as an outline; and a wipe shows the pinhole picture beside it. While
    something is dragged the picture is reduced to at most 512 pixels; then it is shown with at most 2048, and
    `render` gives it at its own size.

    Parameters
    ----------
    color, depth : ndarray
        As for `dofsim.render`, layers too.
    lens : Lens
        The lens to begin with, with an opening.
    aperture : Aperture, optional
        The shape of the opening to begin with.
    device : str, optional
        Where to compute, as for `dofsim.render`.
    depth_kind, near, far, depth_range, invalid, invalid_color, alpha, transfer : optional
        As for `dofsim.render`. Relative depth is on one scale at every size that is shown.
    max_coc_px : float, optional
        As for `dofsim.render`, in pixels of the given picture.
    refine : bool, optional
        Whether to refine the depth first, as `dofsim.refine_depth` does; it may then be of another size.
    **options
        ``method`` and its options, ``threads``: as for `Scene.render`. A range in focus is a property of the
        lens, which a click replaces.

    Attributes
    ----------
    lens : Lens
        The lens as it is set now. Its ``repr`` is Python to paste; `observe` says when it changes.
    aperture : Aperture
        The opening as it is set now.

    Raises
    ------
    ValueError, TypeError
        If the arguments are not as `dofsim.render` wants them, or the lens is a pinhole.

    Examples
    --------
    >>> import dofsim
    >>> import numpy as np
    >>> lens = dofsim.Lens(aperture_radius=0.05, focus_distance=3.0, fov=42.0)
    >>> picker = dofsim.FocusPicker(np.ones((24, 32, 3), np.float32), np.full((24, 32), 2.0), lens)
    >>> picker.focus_at(5, 7)
    >>> picker.lens
    Lens(aperture_radius=0.05, focus_distance=2.0, fov=42.0, fov_axis='x')
    """

    _esm = Path(__file__).parent / "picker.js"
    _css = Path(__file__).parent / "picker.css"

    lens = traitlets.Any(read_only=True)
    aperture = traitlets.Any(read_only=True)
    # What is asked for: written by the browser, or by `focus_at`.
    _request = traitlets.Dict().tag(sync=True)
    # The newest answer.
    _frame = traitlets.Dict().tag(sync=True)
    # The ranges of the controls.
    _setup = traitlets.Dict().tag(sync=True)

    def __init__(
        self,
        color: NDArray[Any],
        depth: NDArray[Any],
        lens: dofsim.Lens,
        *,
        aperture: dofsim.Aperture | None = None,
        device: str = "auto",
        depth_kind: str = "z",
        near: float | None = None,
        far: float | None = None,
        depth_range: tuple[float, float] | None = None,
        invalid: Literal["raise", "far"] = "raise",
        invalid_color: Literal["raise", "fill"] = "raise",
        alpha: Literal["premultiplied", "straight", "none"] | None = None,
        transfer: Literal["linear", "srgb"] | None = None,
        max_coc_px: float | None = None,
        refine: bool = False,
        **options: Any,
    ) -> None:
        if _opening(lens)[1] == 0.0:
            raise ValueError(f"lens must have an opening to begin with; got {lens!r}")
        self._words: dict[str, Any] = {"depth_kind": depth_kind, "near": near, "far": far, "invalid": invalid}
        depth = np.asarray(depth)
        if refine:
            # Once, at the picture's own size: every size that is shown has the same edges.
            words = {"alpha": alpha, "transfer": transfer, "invalid_color": invalid_color, **self._words}
            depth = dofsim.refine_depth(np.asarray(color), depth, **words)
        if depth_kind == "relative" and depth_range is None:
            # That of the whole picture, and not another one of the reduced picture.
            depth_range = range_of(depth)
        self._words["depth_range"] = depth_range
        self._color, self._alpha = _linear(np.asarray(color), depth, alpha, transfer)
        self._depth = depth
        self._device, self._invalid_color = device, invalid_color
        self._options = {"max_coc_px": max_coc_px, **options}
        self._first_lens, self._first_aperture = lens, aperture or dofsim.Aperture()
        # What is wrong with the arguments is said here rather than at the first click.
        self._preview.picture(lens, self._first_aperture, **self._options)

        height, width = self._depth.shape[-2:]
        blades = self._first_aperture.blades
        setup = {
            "size": [width, height],
            "stops": list(_STOPS),
            "hasBlades": self._first_aperture.image is None,
            "overlays": list(OVERLAYS),
        }
        request = {
            "number": 0,
            "dragging": False,
            "focus": None,
            "stops": 0.0,
            "blades": max(blades, _ROUND),
            "exposure": 0.0,
            "overlay": OVERLAYS[0],
        }
        super().__init__(_setup=setup, _request=request)
        self.set_trait("lens", lens)
        self.set_trait("aperture", self._first_aperture)
        self.observe(self._answer, names="_request")

    @cached_property
    def _preview(self) -> Look:
        reduced = reduction(self._depth.shape, PREVIEW_PX)
        return self._shown if reduced == 1 else self._look(reduced)

    @cached_property
    def _shown(self) -> Look:
        return self._look(reduction(self._depth.shape, SHOWN_PX))

    @cached_property
    def _seen_depth(self) -> NDArray[Any]:
        """The depth that is seen at the picture's own size, on which a click focuses."""
        return seen(self._color, self._depth)

    def _look(self, reduced: int) -> Look:
        return Look.at(
            self._color,
            self._depth,
            reduced=reduced,
            alpha=self._alpha,
            device=self._device,
            invalid_color=self._invalid_color,
            depth_words=self._words,
        )

    def focus_at(self, x: int, y: int) -> None:
        """Focus on a pixel, as a click does.

        Parameters
        ----------
        x, y : int
            Column and row of the pixel.

        Raises
        ------
        IndexError
            If the pixel is outside the picture.
        ValueError
            If there is no depth.
        """
        self._lens_for({**self._request, "focus": [x, y]})
        number = self._request["number"] + 1
        self._request = {**self._request, "focus": [x, y], "number": number, "dragging": False}

    def render(self) -> NDArray[np.float32]:
        """Return the picture at its own size as it is set now, without exposure.

        Returns
        -------
        ndarray of float32
            Shape (H, W, 3), linear light.
        """
        look = self._shown if self._shown.reduced == 1 else self._look(1)
        return look.picture(self.lens, self.aperture, **self._options)

    def _answer(self, _: Any) -> None:
        """Make the frame that was asked for last."""
        request = self._request
        problem = ""
        try:
            self.set_trait("lens", self._lens_for(request))
        except (IndexError, ValueError) as error:
            problem = str(error)
        self.set_trait("aperture", self._aperture_for(request))
        look = self._preview if request["dragging"] else self._shown
        picture = look.picture(self.lens, self.aperture, **self._options)
        exposure = request["exposure"]
        readout = self._readout()
        self._frame = {
            "number": request["number"],
            "full": not request["dragging"],
            "picture": png(picture, exposure=exposure),
            "pinhole": png(look.pinhole, exposure=exposure),
            "overlay": look.overlay(self.lens, request["overlay"]),
            "repr": repr(self.lens),
            "readout": problem or readout,
            "alt": f"The picture through the lens: {readout}",
        }

    def _lens_for(self, request: dict[str, Any]) -> dofsim.Lens:
        name, size = _opening(self._first_lens)
        # A stop halves the area.
        lens = self._first_lens.replace(**{name: size * 2.0 ** (0.5 * request["stops"])})
        if request["focus"] is None:
            return lens
        x, y = request["focus"]
        words: dict[str, Any] = {
            key: self._words[key] for key in ("depth_kind", "near", "far", "depth_range")
        }
        return lens.focused_at(self._seen_depth, int(x), int(y), **words)

    def _aperture_for(self, request: dict[str, Any]) -> dofsim.Aperture:
        blades = 0 if request["blades"] <= _ROUND else int(request["blades"])
        words = self._first_aperture.__getnewargs_ex__()[1]
        if words["image"] is not None or words["blades"] == blades:
            return self._first_aperture
        return dofsim.Aperture(**{**words, "blades": blades})

    def _readout(self) -> str:
        """Say how the lens is set, in a photographer's words."""
        lens = self.lens
        if lens.focus_distance is None:
            name, size = _opening(lens)
            unit = "px" if name == "strength_px" else "% of the width"
            return f"{in_focus(lens)} in focus, blur radius {size:.3g} {unit}"
        opening = f"{2e3 * lens.aperture_radius:.3g} mm wide"
        if lens.f_number is not None:
            opening = f"f/{lens.f_number:.2g}"
        return f"focused at {in_focus(lens)}, {opening}"

    def _repr_mimebundle_(self, **kwargs: Any) -> Any:
        """Give the widget, and a picture where scripts do not run."""
        bundle = super()._repr_mimebundle_(**kwargs)
        if bundle is None:
            return None
        data, metadata = bundle
        picture = self._preview.picture(self.lens, self.aperture, **self._options)
        still = base64.b64encode(png(picture, exposure=self._request["exposure"])).decode()
        return {**data, "text/plain": repr(self), "image/png": still}, metadata

    def __repr__(self) -> str:
        """Say what it is set to."""
        return f"FocusPicker(lens={self.lens!r}, aperture={self.aperture!r})"


def _opening(lens: dofsim.Lens) -> tuple[str, float]:
    """Give the word that makes a lens blur, and its value."""
    for name in ("aperture_radius", "strength_px", "strength_percent"):
        if (value := getattr(lens, name)) is not None:
            return name, float(value)
    raise TypeError(f"lens must be a Lens; got {lens!r}")


def _linear(
    color: NDArray[Any], depth: NDArray[Any], alpha: Any, transfer: Any
) -> tuple[NDArray[np.float32], Literal["premultiplied", "none"]]:
    """Give linear light with a channel axis, and whether its last channel is premultiplied alpha."""
    if np.issubdtype(color.dtype, np.integer) and transfer is None:
        raise ValueError('transfer must be "srgb" or "linear" for integers')
    if color.ndim == depth.ndim:
        color = color[..., np.newaxis]
    if color.shape[:-1] != depth.shape:
        raise ValueError(f"color and depth must be of one size; got {color.shape} and {depth.shape}")
    alpha = alpha or ("premultiplied" if color.shape[-1] == 4 else "none")
    image = io.Image(color, transfer or "linear", alpha)
    return image.to_linear(), "none" if alpha == "none" else "premultiplied"
