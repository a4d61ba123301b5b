"""Depth of field in PyTorch: a transform of torchvision's v2 interface, a data set, a render with gradients.

Needs PyTorch and torchvision, the extra ``torch``. Tensors on the CPU are handed over without a copy.
"""

from __future__ import annotations

import warnings
from collections.abc import Iterator, Sequence
from typing import Any, Literal

import numpy as np
import torch
from numpy.typing import NDArray
from torch.utils.data import Dataset, get_worker_info
from torchvision import tv_tensors
from torchvision.transforms import v2

import dofsim
from dofsim._dofsim import focusable_pixels
from dofsim._gradients import vjp
from dofsim._relative import range_of

__all__ = ["Depth", "DepthOfField", "RandomDepthOfField", "render"]


def __dir__() -> list[str]:
    """List the public names."""
    return sorted(__all__)


_DEPTH_WORDS = ("depth_kind", "near", "far", "depth_range", "invalid")


def render(
    color: torch.Tensor,
    depth: torch.Tensor,
    focus_distance: torch.Tensor | float,
    aperture_radius: torch.Tensor | float,
    *,
    fov: float,
    fov_axis: Literal["x", "y", "diagonal", "smaller", "larger"] = "x",
    **options: Any,
) -> torch.Tensor:
    """Return pictures that a thin lens would have taken, with gradients by all four tensors.

    Parameters
    ----------
    color : Tensor
        Pinhole pictures in linear light, floats of shape (..., C, H, W) with 1 to 4 channels.
    depth : Tensor
        What each pixel sees, in metres unless ``depth_kind`` says otherwise: shape (..., H, W) or
        (..., 1, H, W).
    focus_distance, aperture_radius : Tensor or float
        The lens, in metres: numbers, or one for each picture, of shape (...).
    fov : float
        Field of view in degrees along `fov_axis`.
    fov_axis : {"x", "y", "diagonal", "smaller", "larger"}, optional
        As in `dofsim.Lens`.
    **options
        ``depth_kind``, ``depth_range``, ``aperture``, ``max_coc_px``, ``threads`` and ``views``, as in
        `dofsim.vjp`. In a worker of a data loader ``threads`` is 1 unless given.

    Returns
    -------
    Tensor
        Of the shape and the dtype of `color`.

    Raises
    ------
    ValueError, TypeError
        If an argument cannot be used.

    Notes
    -----
    The gradients are those of `dofsim.vjp`. They cannot be differentiated again. `torch.func.vmap` renders
    one picture after another.

    Examples
    --------
    >>> import torch
    >>> from dofsim.torch import render
    >>> color, depth = torch.rand(2, 3, 24, 32), torch.full((2, 24, 32), 4.0)
    >>> focus = torch.tensor(2.0, requires_grad=True)
    >>> render(color, depth, focus, 0.05, fov=40.0).square().sum().backward()
    >>> focus.grad.shape
    torch.Size([])
    """
    if get_worker_info() is not None:
        options.setdefault("threads", 1)
    words = {"fov": fov, "fov_axis": fov_axis}
    for name, tensor in (("color", color), ("depth", depth)):
        if not isinstance(tensor, torch.Tensor):
            raise TypeError(f"{name} must be a tensor; got {type(tensor).__name__}")
        if tensor.device.type != "cpu":
            raise ValueError(
                f"{name} must be on the CPU, where it is rendered; got a tensor on {tensor.device}"
            )
    if color.ndim < 3:
        raise ValueError(f"color must have shape (..., C, H, W); got {tuple(color.shape)}")
    batch, size = color.shape[:-3], color.shape[-2:]
    if depth.shape == (*batch, 1, *size):
        depth = depth.squeeze(-3)
    if depth.shape != (*batch, *size):
        raise ValueError(
            f"depth must have shape (..., H, W) or (..., 1, H, W) where color has (..., C, H, W); got "
            f"{tuple(depth.shape)} and {tuple(color.shape)}"
        )
    numbers = []
    for name, number in (("focus_distance", focus_distance), ("aperture_radius", aperture_radius)):
        tensor = torch.as_tensor(number, dtype=None if torch.is_tensor(number) else torch.float64)
        if tensor.shape not in ((), batch):
            raise ValueError(
                f"{name} must be a number, or one for each picture, of shape {tuple(batch)}; got shape "
                f"{tuple(tensor.shape)}"
            )
        numbers.append(tensor.expand(batch))
    return _Render.apply(color, depth, *numbers, words, options)


class _Render(torch.autograd.Function):
    """The render of pictures with any number of leading axes."""

    @staticmethod
    def forward(
        color: torch.Tensor,
        depth: torch.Tensor,
        focus_distance: torch.Tensor,
        aperture_radius: torch.Tensor,
        lens_words: dict[str, Any],
        options: dict[str, Any],
    ) -> torch.Tensor:
        given = (color, depth, focus_distance, aperture_radius)
        # As the gradients are.
        chosen = {**options, "device": "cpu", "resolution": "full"}
        pictures = [
            np.moveaxis(dofsim.render(pixels, plane, lens, **chosen), -1, 0)
            for pixels, plane, lens in _each(given, lens_words)
        ]
        return torch.from_numpy(np.stack(pictures)).reshape(color.shape)

    @staticmethod
    def setup_context(ctx: Any, inputs: tuple[Any, ...], output: torch.Tensor) -> None:
        *given, ctx.lens_words, ctx.options = inputs
        ctx.save_for_backward(*given)

    @staticmethod
    @torch.autograd.function.once_differentiable  # type: ignore[untyped-decorator]
    def backward(ctx: Any, cotangent: torch.Tensor) -> tuple[Any, ...]:
        given = ctx.saved_tensors
        names = ("color", "depth", "focus_distance", "aperture_radius")
        wrt = [name for name, needed in zip(names, ctx.needs_input_grad, strict=False) if needed]
        weights = np.moveaxis(_array(cotangent).reshape(-1, *cotangent.shape[-3:]), 1, -1)
        found: dict[str, list[Any]] = {name: [] for name in wrt}
        for one, weight in zip(_each(given, ctx.lens_words), weights, strict=True):
            for name, value in vjp(*one, weight, wrt=wrt, **ctx.options).items():
                found[name].append(np.moveaxis(value, -1, 0) if name == "color" else value)
        gradients: list[torch.Tensor | None] = []
        for name, tensor in zip(names, given, strict=True):
            values = torch.from_numpy(np.array(found[name])) if name in found else None
            gradients.append(None if values is None else values.reshape(tensor.shape).to(tensor.dtype))
        return (*gradients, None, None)

    @staticmethod
    def vmap(info: Any, in_dims: tuple[int | None, ...], *inputs: Any) -> tuple[torch.Tensor, int]:
        tensors, words = inputs[:4], inputs[4:]
        moved = [
            tensor.expand(info.batch_size, *tensor.shape) if dim is None else tensor.movedim(dim, 0)
            for tensor, dim in zip(tensors, in_dims, strict=False)
        ]
        return _Render.apply(*moved, *words), 0


def _each(
    given: Sequence[torch.Tensor], lens_words: dict[str, Any]
) -> Iterator[tuple[Any, Any, dofsim.Lens]]:
    """Give the picture, the depth and the lens of each picture of a batch; channels last, as a view."""
    color, depth, focus_distance, aperture_radius = (_array(tensor) for tensor in given)
    pixels = np.moveaxis(color.reshape(-1, *color.shape[-3:]), 1, -1)
    planes = depth.reshape(-1, *depth.shape[-2:])
    numbers = zip(focus_distance.reshape(-1), aperture_radius.reshape(-1), strict=True)
    for one, plane, (focus, radius) in zip(pixels, planes, numbers, strict=True):
        lens = dofsim.Lens(aperture_radius=float(radius), focus_distance=float(focus), **lens_words)
        yield one, plane, lens


class Depth(tv_tensors.Mask):
    """A depth map of shape (..., H, W), such as transforms of torchvision crop, flip and resize as a mask.

    Examples
    --------
    >>> import torch
    >>> from dofsim.torch import Depth
    >>> Depth(torch.ones(4, 6)).shape
    torch.Size([4, 6])
    """


class _PlaceOfLens:
    """Stands in a sample where the lens that is drawn will be."""


class RandomDepthOfField(v2.Transform):
    """A transform that sees a picture through a lens of random aperture, focused on a random pixel.

    Samples have any structure that torchvision's transforms take, with one `Depth` and one picture of its
    size: a `torchvision.tv_tensors.Image`, or else the first plain tensor, of shape (..., C, H, W). The depth
    has shape (..., H, W) or (..., 1, H, W). All else is passed on. Each picture of a batch has a lens of its
    own. Pictures of uint8 are taken for sRGB, floats for linear light. Random numbers are PyTorch's.
    Relative depth has one scale for all pictures of a sample, such as the frames of a clip; ``depth_range``
    gives one to all samples. Gradients do not pass; a picture or a depth that requires them is warned of.

    Parameters
    ----------
    lens : Lens
        The lens to vary; its focus is replaced, unless it is a range, ``in_focus``.
    max_coc_px : tuple of float
        The largest radius of the circle of confusion in the picture, in pixels, is drawn between these two.
        The lens is opened so far.
    depth_to : {"depth", "coc"}, optional
        Whether the depth is passed on, or replaced by the signed radius of the circle of confusion in pixels.
    lens_to : str, optional
        The key under which a sample that is a dictionary gets the lens that was drawn: a dictionary of
        ``aperture_radius`` and ``focus_distance`` in metres, or of the strength and the focus of a lens over
        relative disparity; or ``in_focus``. They are numbers; of a batch, tensors.
    **options
        ``depth_kind``, ``near``, ``far``, ``depth_range``, ``invalid``, ``invalid_color``, ``in_focus`` and
        all that `dofsim.render` knows of methods and openings. In a worker of a data loader ``threads`` is 1
        unless given.

    Raises
    ------
    ValueError
        If `max_coc_px` is no range, or when it is called if the sample has not one depth and one picture, or
        if they cannot be rendered.
    TypeError
        When it is called with `lens_to`, if the sample is no dictionary.

    Examples
    --------
    >>> import dofsim, torch
    >>> from torchvision import tv_tensors
    >>> from dofsim.torch import Depth, RandomDepthOfField
    >>> lens = dofsim.Lens(aperture_radius=0.01, focus_distance=1.0, fov=40.0)
    >>> transform = RandomDepthOfField(lens, max_coc_px=(2.0, 8.0))
    >>> sample = {"image": tv_tensors.Image(torch.rand(3, 24, 32)), "depth": Depth(torch.rand(24, 32) + 1)}
    >>> transform(sample)["image"].shape
    torch.Size([3, 24, 32])
    """

    # What the base class asks for: pictures and depth, no other masks, boxes or videos; and the place of the
    # lens.
    _transformed_types = (tv_tensors.Image, Depth, v2.functional.is_pure_tensor, _PlaceOfLens)

    def __init__(
        self,
        lens: dofsim.Lens,
        *,
        max_coc_px: tuple[float, float],
        depth_to: str = "depth",
        lens_to: str | None = None,
        **options: Any,
    ) -> None:
        super().__init__()
        low, high = max_coc_px
        if not 0 <= low <= high < float("inf"):
            raise ValueError(f"max_coc_px must be two radii, 0 <= low <= high; got {max_coc_px}")
        if "in_focus" in options:
            lens = lens.replace(in_focus=options.pop("in_focus"))
        if depth_to not in ("depth", "coc"):
            raise ValueError(f"depth_to must be 'depth' or 'coc'; got {depth_to!r}")
        self.lens = lens
        self.max_coc_px = (float(low), float(high))
        self.depth_to = depth_to
        self.lens_to = lens_to
        self.depth_options = {name: options.pop(name) for name in _DEPTH_WORDS if name in options}
        self.options = options

    def forward(self, *inputs: Any) -> Any:
        """Return a sample as a lens sees it.

        Parameters
        ----------
        *inputs
            The sample.

        Returns
        -------
        object
            The same structure.
        """
        if self.lens_to is None:
            return super().forward(*inputs)
        if len(inputs) != 1 or not isinstance(inputs[0], dict):
            raise TypeError(f"a sample must be a dictionary to get the lens as {self.lens_to!r}")
        return super().forward({**inputs[0], self.lens_to: _PlaceOfLens()})

    def extra_repr(self) -> str:
        """Return the arguments."""
        words = {"max_coc_px": self.max_coc_px, "depth_to": self.depth_to, "lens_to": self.lens_to}
        words = {**words, **self.depth_options, **self.options}
        return ", ".join([repr(self.lens), *(f"{name}={value!r}" for name, value in words.items())])

    def make_params(self, flat_inputs: list[Any]) -> dict[str, Any]:
        """Return lenses that are drawn at random.

        Parameters
        ----------
        flat_inputs : list
            The picture and the depth of a sample.

        Returns
        -------
        dict
            The lenses as ``lenses``, one for each picture, the depth maps as ``planes``, shape (N, H, W), and
            what they measure as ``depth_words``.
        """
        found = [one for one in flat_inputs if not isinstance(one, _PlaceOfLens)]
        depths = [one for one in found if isinstance(one, Depth)]
        if len(depths) != 1 or len(found) != 2:
            raise ValueError(
                f"a sample must have one dofsim.torch.Depth and one picture; got {len(depths)} and "
                f"{len(found) - len(depths)}"
            )
        if any(one.requires_grad for one in found):
            warnings.warn("RandomDepthOfField passes no gradients: it computes outside PyTorch", stacklevel=4)
        (depth,) = depths
        (image,) = (one for one in found if one is not depth)
        batch = image.shape[:-3]
        if depth.shape[:-2] not in (batch, (*batch, 1)) or depth.shape[-2:] != image.shape[-2:]:
            raise ValueError(
                "the picture must have shape (..., C, H, W) where the depth has (..., H, W) or (..., 1, H, "
                "W); got "
                f"{tuple(image.shape)} and {tuple(depth.shape)}"
            )
        planes = _array(depth).reshape(-1, *depth.shape[-2:])
        words = self._depth_words(planes)
        lenses = [self._draw(plane, words) for plane in planes]
        return {"lenses": lenses, "planes": planes, "batch": batch, "depth_words": words}

    def draw(self, depth: torch.Tensor) -> dofsim.Lens:
        """Return a lens that is drawn at random for a depth map.

        Parameters
        ----------
        depth : Tensor
            Shape (H, W) or (1, H, W).

        Returns
        -------
        Lens
            Focused on a random pixel with finite depth, or over its range in focus; as wide as was drawn.
        """
        if depth.ndim < 2 or any(side != 1 for side in depth.shape[:-2]):
            raise ValueError(f"depth must have shape (H, W) or (1, H, W); got {tuple(depth.shape)}")
        plane = _array(depth).reshape(depth.shape[-2:])
        return self._draw(plane, self._depth_words(plane))

    def _depth_words(self, planes: NDArray[Any]) -> dict[str, Any]:
        """Give the words of depth; of relative depth, with one scale for all pictures of a sample."""
        words = self.depth_options
        if words.get("depth_kind") != "relative" or words.get("depth_range") is not None:
            return words
        return {**words, "depth_range": range_of(planes)}

    def _draw(self, plane: NDArray[Any], depth_words: dict[str, Any]) -> dofsim.Lens:
        words = {name: value for name, value in depth_words.items() if name != "invalid"}
        usable = focusable_pixels(self.lens, plane, **words)
        if usable.size == 0:
            raise ValueError("the depth has no pixel to focus on: none is finite")
        y, x = divmod(int(usable[int(torch.randint(usable.size, ()))]), plane.shape[1])
        lens = self.lens
        if lens.in_focus is None:
            lens = lens.focused_at(plane, x, y, **words)
        # The radius is proportional to the opening, so that one look at any opening tells how far to open it.
        largest = float(np.abs(dofsim.coc(plane, lens, **depth_words)).max())
        low, high = self.max_coc_px
        wanted = low + (high - low) * float(torch.rand(()))
        factor = wanted / largest if largest > 0 else 0.0
        if lens.strength_px is not None:
            return lens.replace(strength_px=factor * lens.strength_px)
        if lens.strength_percent is not None:
            return lens.replace(strength_percent=factor * lens.strength_percent)
        assert lens.aperture_radius is not None
        return lens.replace(aperture_radius=factor * lens.aperture_radius)

    def transform(self, inpt: Any, params: dict[str, Any]) -> Any:
        """Return one entry of a sample as the lens sees it.

        Parameters
        ----------
        inpt : Tensor
            The picture or the depth; or the place of the lens.
        params : dict
            What `make_params` gave.

        Returns
        -------
        Tensor
            Of the same type, shape, dtype and device.
        """
        lenses, planes = params["lenses"], params["planes"]
        if isinstance(inpt, _PlaceOfLens):
            return _numbers(lenses, params["batch"])
        if isinstance(inpt, Depth):
            if self.depth_to == "depth":
                # What a worker sends is moved in memory, also while the next sample is rendered from it.
                return inpt.clone() if get_worker_info() is not None else inpt
            words = params["depth_words"]
            radii = [dofsim.coc(plane, lens, **words) for plane, lens in zip(planes, lenses, strict=True)]
            coc = torch.from_numpy(np.stack(radii).reshape(inpt.shape))
            return tv_tensors.wrap(coc.to(inpt.device, inpt.dtype), like=inpt)
        colors = _array(inpt).reshape(-1, *inpt.shape[-3:])
        options = {**params["depth_words"], **self.options}
        if get_worker_info() is not None:
            options.setdefault("threads", 1)
        if np.issubdtype(colors.dtype, np.integer):
            options.setdefault("transfer", "srgb")
        # Channels last, as a view.
        rendered = [
            dofsim.render(color.transpose(1, 2, 0), plane, lens, **options).transpose(2, 0, 1)
            for color, plane, lens in zip(colors, planes, lenses, strict=True)
        ]
        pixels = rendered[0] if len(rendered) == 1 else np.stack(rendered)
        result = torch.from_numpy(pixels.reshape(inpt.shape)).to(inpt.device)
        return tv_tensors.wrap(result, like=inpt) if isinstance(inpt, tv_tensors.TVTensor) else result


class DepthOfField(Dataset[Any]):
    """A data set of sharp pictures with depth, seen through random lenses that depend on the index alone.

    Whatever the number of workers and the order of access, an index gives the same picture in the same epoch.

    Parameters
    ----------
    dataset : Dataset
        Gives samples that ``transform`` takes.
    transform : RandomDepthOfField
        What is applied to them.
    seed : int, optional
        Another seed draws other lenses; `set_epoch` likewise.

    Examples
    --------
    >>> import dofsim, torch
    >>> from dofsim.torch import Depth, DepthOfField, RandomDepthOfField
    >>> sharp = [(torch.rand(3, 24, 32), Depth(torch.rand(24, 32) + 1.0)) for _ in range(2)]
    >>> lens = dofsim.Lens(aperture_radius=0.01, focus_distance=1.0, fov=40.0)
    >>> data = DepthOfField(sharp, RandomDepthOfField(lens, max_coc_px=(2.0, 8.0), depth_to="coc"))
    >>> blurred, coc = data[1]
    >>> bool(torch.equal(blurred, data[1][0]))
    True
    """

    def __init__(self, dataset: Any, transform: RandomDepthOfField, *, seed: int = 0) -> None:
        self.dataset = dataset
        self.transform = transform
        self.seed = seed
        self.epoch = 0

    def set_epoch(self, epoch: int) -> None:
        """Set the epoch, by which other lenses are drawn.

        Parameters
        ----------
        epoch : int
            Its number; the same one draws the same lenses.
        """
        self.epoch = epoch

    def __repr__(self) -> str:
        """Return the arguments."""
        return f"DepthOfField({self.dataset!r}, {self.transform!r}, seed={self.seed})"

    def __len__(self) -> int:
        """Return the number of samples."""
        return len(self.dataset)

    def __getitem__(self, index: int) -> Any:
        """Return one sample, blurred."""
        sample = self.dataset[index]
        entropy = np.random.SeedSequence([self.seed, self.epoch, index % max(1, len(self))])
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(int(entropy.generate_state(1, np.uint64)[0]))
            return self.transform(sample)


def _numbers(lenses: list[dofsim.Lens], batch: tuple[int, ...]) -> dict[str, Any]:
    """Give what was drawn of some lenses; of a batch as tensors of its shape."""
    names = ("aperture_radius", "strength_px", "strength_percent", "focus_distance", "focus", "in_focus")
    drawn = {
        name: [getattr(lens, name) for lens in lenses]
        for name in names
        if getattr(lenses[0], name) is not None
    }
    if not batch:
        return {name: values[0] for name, values in drawn.items()}
    return {
        name: torch.tensor(values, dtype=torch.float64).reshape(*batch, *np.shape(values[0]))
        for name, values in drawn.items()
    }


def _array(tensor: torch.Tensor) -> NDArray[Any]:
    """View a tensor as an array; one that is elsewhere is copied to the CPU."""
    array: NDArray[Any] = np.from_dlpack(tensor.detach().as_subclass(torch.Tensor).cpu())
    return array
