"""Every example in the documentation of a public object runs and gives what it says."""

import doctest
import inspect
from importlib import import_module
from importlib.util import find_spec

import dofsim
import pytest
from dofsim import batch, io, metrics, plot, presets

MODULES = [dofsim, batch, io, metrics, plot, presets]
if find_spec("torchvision"):
    MODULES.append(import_module("dofsim.torch"))
if find_spec("mitsuba"):
    MODULES.append(import_module("dofsim.mitsuba"))
if find_spec("anywidget"):
    MODULES.append(import_module("dofsim.picker"))


def documented():
    """Yield the name and the text of all public objects and of their public members."""
    for module in MODULES:
        for name in module.__all__:
            thing = getattr(module, name)
            if not (inspect.isclass(thing) or callable(thing)):
                continue
            yield f"{module.__name__}.{name}", thing.__doc__
            for member in vars(thing) if inspect.isclass(thing) else ():
                if not member.startswith("_") and (text := getattr(getattr(thing, member), "__doc__", None)):
                    yield f"{module.__name__}.{name}.{member}", text


TEXTS = dict(documented())
EXAMPLES = {name: text for name, text in TEXTS.items() if text and ">>>" in text}


@pytest.mark.parametrize("name", EXAMPLES)
def test_example(name, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    test = doctest.DocTestParser().get_doctest(EXAMPLES[name], {}, name, None, None)
    report = []
    results = doctest.DocTestRunner(verbose=False).run(test, out=report.append)
    assert results.attempted > 0
    assert results.failed == 0, "".join(report)


@pytest.mark.parametrize(
    "name", ["dofsim.render", "dofsim.coc", "dofsim.Lens", "dofsim.Lens.from_camera", "dofsim.Scene"]
)
def test_the_core_has_examples(name):
    assert name in EXAMPLES


def test_every_public_function_is_documented():
    assert [name for name, text in TEXTS.items() if not text] == []
