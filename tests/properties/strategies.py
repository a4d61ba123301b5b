"""Pictures, depth, lenses, openings and options of every kind that the public functions take."""

from dataclasses import dataclass, field
from typing import Any

import dofsim
import numpy as np
from hypothesis import reject
from hypothesis import strategies as st

METHODS = ["lens", "poisson", "gaussian", "hexagonal", "levels", "taps", "sprites"]
FLOATS = [np.float16, np.float32, np.float64]
INTEGERS = [np.uint8, np.uint16]


def in_memory(array, layout):
    """Give the same values another layout in memory; a broadcast array repeats its first row."""
    match layout:
        case "record":
            # A packed record: its fields have strides that are no multiples of their own size.
            packed = np.zeros(array.shape[:2], [("tag", "u1"), ("value", array.dtype, array.shape[2:])])
            packed["value"] = array
            return packed["value"]
        case "unaligned":
            start = np.empty(array.nbytes + 1, np.uint8)[1:]
            moved = start.view(array.dtype).reshape(array.shape)
            moved[...] = array
            return moved
        case "swapped":
            return array.astype(array.dtype.newbyteorder())
        case "broadcast":
            return np.broadcast_to(array[:1], array.shape)
        case "fortran":
            return np.asfortranarray(array)
        case "strided":
            wide = np.full((*array.shape[:-1], 2 * array.shape[-1]), 77, array.dtype)
            wide[..., ::2] = array
            return wide[..., ::2]
        case "reversed":
            return array[::-1].copy()[::-1]
        case "read-only":
            array = array.copy()
            array.flags.writeable = False
            return array
    return np.ascontiguousarray(array)


LAYOUTS = st.sampled_from(
    ["plain", "fortran", "strided", "reversed", "read-only", "record", "unaligned", "swapped", "broadcast"]
)


@st.composite
def shapes(draw, most=40):
    """Draw rows and columns; tiles, blocks and lanes end at powers of two."""
    side = st.one_of(st.integers(1, most), st.sampled_from([1, 2, 15, 16, 17, 31, 32, 33, 63, 64, 65]))
    return draw(side), draw(side)


def values(rng, shape, look):
    """Make values of some look, in float64."""
    match look:
        case "constant":
            return np.full(shape, rng.random())
        case "dark":
            return rng.random(shape) * 1e-42
        case "bright":
            return rng.random(shape) * 1e30
        case "negative":
            return rng.normal(size=shape)
        case "lamps":
            return np.where(rng.random(shape) < 0.02, 1e4, rng.random(shape))
        case "black":
            return np.zeros(shape)
    return rng.random(shape)


@st.composite
def colors(draw, shape, dtypes=(*FLOATS, *INTEGERS), looks=None, channels=(None, 1, 2, 3, 4)):
    """Draw a picture."""
    dtype = draw(st.sampled_from(dtypes))
    looks = looks or ["random", "constant", "dark", "bright", "negative", "lamps", "black"]
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    count = draw(st.sampled_from(channels))
    full = shape if count is None else (*shape, count)
    array = values(rng, full, draw(st.sampled_from(looks)))
    if count in (2, 4):
        # What may be coverage has to be one.
        array[..., -1] = rng.random(shape)
        array[..., :-1] *= array[..., -1:]
    if np.issubdtype(dtype, np.integer):
        array = np.clip(array, 0, 1) * np.iinfo(dtype).max
    elif dtype == np.float16:
        array = np.clip(array, -1e4, 1e4)
    return in_memory(array.astype(dtype), draw(LAYOUTS))


@st.composite
def depths(draw, shape, dtypes=FLOATS, wild=True):
    """Draw distances in metres."""
    height, width = shape
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    looks = ["constant", "random", "steps", "ramp", *(["infinite", "wild"] if wild else [])]
    match draw(st.sampled_from(looks)):
        case "constant":
            z = np.full(shape, draw(st.floats(0.5, 20)))
        case "steps":
            z = np.full(shape, 8.0)
            for near in (4.0, 2.0, 1.0):
                y, x = rng.integers(height), rng.integers(width)
                z[y : y + 1 + rng.integers(height), x : x + 1 + rng.integers(width)] = near
        case "ramp":
            x, y = np.meshgrid(np.linspace(0, 1, width), np.linspace(0, 1, height))
            z = 1 + 8 * (rng.random() * x + rng.random() * y)
        case "infinite":
            z = np.where(rng.random(shape) < 0.3, np.inf, 1 + 5 * rng.random(shape))
        case "wild":
            z = 10.0 ** rng.uniform(-6, 12, shape)
        case _:
            z = 1 + 9 * rng.random(shape)
    dtype = draw(st.sampled_from(dtypes))
    if dtype == np.float16:
        z = np.clip(z, 1e-3, 6e4)
    return in_memory(z.astype(dtype), draw(LAYOUTS))


def made(kind, words):
    """Make an object of words that may not go together."""
    try:
        return kind(**words)
    except ValueError:
        reject()


@st.composite
def lenses(draw, *, plain=False):
    """Draw a thin lens, and unless `plain` one with flaws."""
    words = {
        "aperture_radius": draw(st.one_of(st.just(0.0), st.floats(1e-4, 0.5))),
        "focus_distance": draw(st.one_of(st.floats(0.5, 20), st.just(np.inf))),
        "fov": draw(st.floats(5, 120)),
    }
    if plain:
        return dofsim.Lens(**words)
    signed = st.floats(-1, 1)
    flaws = {
        "tilt": st.tuples(st.floats(-60, 60), st.floats(-60, 60)),
        "field_curvature": signed,
        "axial_color": st.tuples(*[st.floats(-0.05, 0.05)] * 3),
        "lateral_color": st.tuples(*[st.floats(-0.05, 0.05)] * 3),
        "cat_eye": st.floats(0, 1),
        "vignetting": st.sampled_from(["none", "optical", "natural", "full"]),
        "principal_point": st.tuples(st.floats(-0.3, 0.3), st.floats(-0.3, 0.3)),
    }
    chosen = draw(st.sets(st.sampled_from(sorted(flaws)), max_size=2))
    return made(dofsim.Lens, words | {name: draw(flaws[name]) for name in sorted(chosen)})


@st.composite
def apertures(draw):
    """Draw an opening of any shape."""
    if draw(st.integers(0, 4)) == 0:
        rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
        return dofsim.Aperture(image=rng.random((draw(st.integers(1, 12)), draw(st.integers(1, 12)))) + 1e-3)
    words = {
        "blades": st.sampled_from([0, 3, 4, 5, 6, 9]),
        "rotation": st.floats(-180, 180),
        "roundness": st.floats(0, 1),
        "ratio": st.floats(0.3, 3),
        "obstruction": st.floats(0, 0.9),
        "apodization": st.floats(0.1, 2),
        "spherical": st.floats(-1, 1),
    }
    chosen = draw(st.sets(st.sampled_from(sorted(words)), max_size=3))
    return made(dofsim.Aperture, {name: draw(words[name]) for name in sorted(chosen)})


OPTIONS: dict[str, dict[str, st.SearchStrategy[Any]]] = {
    "lens": {"views": st.integers(16, 128), "max_coc_px": st.floats(0.5, 40)},
    "poisson": {
        "taps": st.integers(1, 128),
        "bokeh": st.sampled_from(["uniform", "ring", "gaussian", "inverse"]),
        "max_coc_px": st.floats(0.5, 40),
        "leak_test": st.sampled_from(["on", "off"]),
    },
    "gaussian": {"max_coc_px": st.floats(0.5, 60), "focal_range": st.floats(0.1, 10)},
    "hexagonal": {"max_coc_px": st.floats(1, 40)},
    "levels": {"c0_px": st.floats(0.5, 40), "max_coc_px": st.floats(0.5, 40)},
    "taps": {
        "variant": st.sampled_from(["thirteen", "seven", "six", "four", "four_rings"]),
        "hyperfocal_factor": st.floats(0.01, 2),
        "max_coc_px": st.floats(0.5, 40),
    },
    "sprites": {"coc_threshold_px": st.floats(0.5, 4), "max_coc_px": st.floats(1, 30)},
}


@dataclass
class Call:
    """The arguments of `dofsim.render`."""

    color: np.ndarray
    depth: np.ndarray
    lens: dofsim.Lens
    options: dict[str, Any] = field(default_factory=dict)

    def render(self, **changes):
        """Call it, with some arguments changed."""
        args = {"color": self.color, "depth": self.depth, "lens": self.lens, **self.options, **changes}
        return dofsim.render(**args)


@st.composite
def methods(draw):
    """Draw a method with some of its options."""
    method = draw(st.sampled_from(METHODS))
    of_method = OPTIONS[method]
    # Two measures of one thing exclude each other.
    most = 1 if method == "gaussian" else 2
    chosen = draw(st.sets(st.sampled_from(sorted(of_method)), max_size=most))
    return {"method": method, **{name: draw(of_method[name]) for name in sorted(chosen)}}


@st.composite
def calls(draw):
    """Draw any call at all, refused ones among them."""
    shape = draw(shapes())
    call = Call(draw(colors(shape)), draw(depths(shape)), draw(lenses()), draw(methods()))
    if draw(st.booleans()):
        call.options["aperture"] = draw(apertures())
    if np.issubdtype(call.color.dtype, np.integer) or draw(st.integers(0, 5)) == 0:
        call.options["transfer"] = draw(st.sampled_from(["linear", "srgb"]))
    if call.color.ndim == 3 and call.color.shape[2] in (2, 4):
        call.options["alpha"] = draw(st.sampled_from(["premultiplied", "straight", "none"]))
    call.options["overscan"] = draw(st.sampled_from([0, 0, 0, 1, 5]))
    call.options["supersample"] = draw(st.sampled_from([1, 1, 1, 2, 3]))
    call.options["invalid"] = draw(st.sampled_from(["raise", "far"]))
    return call


@st.composite
def plain_calls(draw, looks=("random", "lamps", "negative", "constant")):
    """Draw calls in float32 of a thin lens over depth of ordinary range, which every method takes."""
    shape = draw(shapes())
    color = draw(colors(shape, dtypes=[np.float32], looks=list(looks), channels=(None, 1, 3)))
    depth = draw(depths(shape, dtypes=[np.float32], wild=False))
    lens = dofsim.Lens(
        aperture_radius=draw(st.floats(1e-3, 0.2)),
        focus_distance=draw(st.floats(0.8, 12)),
        fov=draw(st.floats(30, 90)),
    )
    return Call(color, depth, lens, draw(methods()))
