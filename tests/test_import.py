"""`import dofsim` is quick, and takes nothing optional with it."""

import subprocess
import sys

# In milliseconds, beyond NumPy's own; the best of some, as other work may share the processors.
MOST_MS, TRIES = 50.0, 7


def run(code):
    return subprocess.check_output([sys.executable, "-c", code], text=True).strip()


def test_import_is_quick():
    code = (
        "import numpy, time; start = time.perf_counter(); import dofsim; print(time.perf_counter() - start)"
    )
    took = [1e3 * float(run(code)) for _ in range(TRIES)]
    assert min(took) < MOST_MS, took


def test_nothing_optional_is_imported():
    optional = ("matplotlib", "anywidget", "IPython", "mitsuba", "torch", "skimage", "scipy", "typer")
    code = f"import sys, dofsim; print([name for name in {optional} if name in sys.modules])"
    assert run(code) == "[]"
