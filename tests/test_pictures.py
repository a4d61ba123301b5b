"""The pictures of the documentation are those that this build makes."""

import runpy
from pathlib import Path

import numpy as np
import pytest

image = pytest.importorskip("PIL.Image", reason="pictures are read with Pillow")
for package in ("matplotlib", "skimage", "flip_evaluator"):
    pytest.importorskip(package, reason=f"pictures are drawn and measured with {package}")

DOCS = Path(__file__).parents[1] / "docs"
# Titles have the seconds that a render took, and JPEG has noise of its own: 40 to 45 dB are left. A lens that
# is a tenth wider is 28 dB away.
LEAST_DB = 37.0


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    folder = tmp_path_factory.mktemp("pictures")
    runpy.run_path(str(DOCS / "pictures.py"))["draw"](folder)
    return folder


@pytest.mark.parametrize("name", ["demo.png", "gallery.jpg", "lenses.jpg", "passes.jpg"])
def test_pages_show_what_this_build_makes(made, name):
    shown, now = (np.asarray(image.open(folder / name).convert("RGB"), np.float64) for folder in (DOCS, made))
    assert shown.shape == now.shape
    error = np.mean((shown - now) ** 2)
    assert 10 * np.log10(255**2 / max(error, 1e-9)) > LEAST_DB
