"""`dofsim.FocusPicker` end to end: JupyterLab on this machine, in a real browser.

No waiting is for a
time: it is for the kernel, or for a frame that answers the newest request.
"""

import base64
import io
import json
import os
import subprocess
import sys
import time
from pathlib import Path
from urllib.parse import urlsplit

import numpy as np
import pytest
from PIL import Image

pytest.importorskip("anywidget", reason="FocusPicker needs anywidget: pip install anywidget")

WIDTH, HEIGHT = 1000, 750
NEAR_M, FAR_M = 1.5, 6.0
# Fractions of the picture's width and height, and patches away from where the two surfaces meet.
NEAR, FAR = (0.2, 0.5), (0.8, 0.6)
PATCHES = {"near": np.s_[150:600, 80:380], "far": np.s_[150:600, 620:920]}
# A page that hangs is given up after so long; nothing is measured against it.
TIMEOUT_MS = 300_000
# Of the kernel's processor time, which other processes have no part in.
PREVIEW_S = 0.25

CELL = f"""
import dofsim, numpy as np
color = np.random.default_rng(1).random(({HEIGHT}, {WIDTH}, 3), np.float32)
depth = np.full(color.shape[:2], {NEAR_M}, np.float32)
depth[:, {WIDTH // 2}:] = {FAR_M}
lens = dofsim.Lens(aperture_radius=0.05, focus_distance=3.0, fov=42.0)
picker = dofsim.FocusPicker(color, depth, lens)
picker
"""


@pytest.fixture(scope="module")
def lab(browser, tmp_path_factory):
    """Start JupyterLab with settings of its own; give its address and where kernels keep theirs."""
    pytest.importorskip("jupyterlab", reason="the widget is tested in JupyterLab")
    root = tmp_path_factory.mktemp("lab")
    notebook = {
        "cells": [
            {
                "cell_type": "code",
                "id": "a",
                "metadata": {},
                "outputs": [],
                "execution_count": None,
                "source": CELL,
            }
        ],
        "metadata": {"kernelspec": {"name": "python3", "display_name": "Python 3", "language": "python"}},
        "nbformat": 4,
        "nbformat_minor": 5,
    }
    (root / "notes").mkdir()
    (root / "notes/picker.ipynb").write_text(json.dumps(notebook))
    # Not to be asked whether there may be news.
    page = {"disabledExtensions": {"@jupyterlab/apputils-extension:announcements": True}}
    (root / "config/labconfig").mkdir(parents=True)
    (root / "config/labconfig/page_config.json").write_text(json.dumps(page))
    folders = {f"JUPYTER_{name}_DIR": str(root / name.lower()) for name in ("CONFIG", "DATA", "RUNTIME")}
    options = [
        "--no-browser",
        "--ip=127.0.0.1",
        "--ServerApp.port=0",
        "--IdentityProvider.token=",
        "--LabApp.check_for_updates_class=jupyterlab.NeverCheckForUpdate",
        "--LabApp.extension_manager=readonly",
        f"--ServerApp.root_dir={root / 'notes'}",
    ]
    if hasattr(os, "geteuid") and os.geteuid() == 0:
        options.append("--allow-root")
    with (
        (root / "log").open("w") as log,
        subprocess.Popen(
            [sys.executable, "-m", "jupyterlab", *options],
            env=os.environ | folders | {"IPYTHONDIR": str(root / "ipython")},
            stdout=log,
            stderr=log,
        ) as server,
    ):
        try:
            deadline = time.monotonic() + TIMEOUT_MS / 1e3
            while not (found := list((root / "runtime").glob("jpserver-*.json"))):
                assert server.poll() is None, (root / "log").read_text()
                assert time.monotonic() < deadline, (root / "log").read_text()
                time.sleep(0.05)
            yield json.loads(found[0].read_text())["url"], root / "runtime"
        finally:
            server.terminate()


class Notebook:
    """The notebook's page, with all that it asked for and all that went wrong in it, and its kernel."""

    def __init__(self, browser, address: str, runtime: Path) -> None:
        self.requests: list[str] = []
        self.errors: list[str] = []
        self.page = browser.new_page(viewport={"width": 1280, "height": 1100})
        self.page.set_default_timeout(TIMEOUT_MS)
        self.page.on("request", lambda request: self.requests.append(request.url))
        self.page.on("pageerror", lambda error: self.errors.append(str(error)))
        self.page.goto(f"{address}doc/tree/picker.ipynb")
        # Only the status bar tells a kernel that is there and idle from one that is not there yet.
        self.page.locator(".jp-StatusBar-TextItem", has_text="| Idle").wait_for()
        self.page.locator(".jp-Cell .cm-content").first.click()
        self.page.keyboard.press("Shift+Enter")
        self.root = self.page.locator(".dofsim-picker")
        self.stage = self.root.locator(".stage")
        self.settle()
        self.runtime = runtime

    def settle(self) -> None:
        """Wait for the whole picture that answers the newest request."""
        self.page.wait_for_function(
            """() => {
                const root = document.querySelector('.dofsim-picker');
                return root && root.dataset.full === 'true' && root.dataset.number === root.dataset.asked;
            }"""
        )

    def ask_kernel(self, expression: str):
        """Evaluate Python in the notebook's kernel, beside the notebook."""
        from jupyter_client.blocking import BlockingKernelClient

        (connection,) = self.runtime.glob("kernel-*.json")
        client = BlockingKernelClient(connection_file=str(connection))
        client.load_connection_file()
        # A heart that begins to beat when the client has gone is an error of its thread.
        client.start_channels(stdin=False, hb=False)
        try:
            reply = client.execute(
                "", user_expressions={"answer": expression}, reply=True, timeout=TIMEOUT_MS / 1e3
            )
        finally:
            client.stop_channels()
        answer = reply["content"]["user_expressions"]["answer"]
        assert answer["status"] == "ok", answer
        return eval(answer["data"]["text/plain"])

    def point(self, at: tuple[float, float]) -> tuple[float, float]:
        box = self.stage.bounding_box()
        return box["x"] + at[0] * box["width"], box["y"] + at[1] * box["height"]

    def click(self, at: tuple[float, float]) -> None:
        self.stage.scroll_into_view_if_needed()
        self.page.mouse.click(*self.point(at))
        self.settle()

    def drag(self, name: str, start: float, end: float, events: int) -> None:
        """Drag a slider, from one part of its way to another, in so many moves of the mouse."""
        slider = self.root.locator(f"input[name={name}]")
        slider.scroll_into_view_if_needed()
        box = slider.bounding_box()
        y = box["y"] + box["height"] / 2
        self.page.mouse.move(box["x"] + start * box["width"], y)
        self.page.mouse.down()
        for step in range(1, events + 1):
            self.page.mouse.move(box["x"] + (start + (end - start) * step / events) * box["width"], y)
        self.page.mouse.up()
        self.settle()

    def shown(self) -> bytes:
        """Give the bytes of the picture that the page shows."""
        text = self.stage.locator("img").first.evaluate(
            """async (image) => {
                const bytes = new Uint8Array(await (await fetch(image.src)).arrayBuffer());
                let text = '';
                for (const byte of bytes) text += String.fromCharCode(byte);
                return btoa(text);
            }"""
        )
        return base64.b64decode(text)

    def sharpness(self) -> dict[str, float]:
        """Give the variance of the Laplacian in each patch."""
        grey = np.asarray(Image.open(io.BytesIO(self.shown())).convert("L"), dtype=float)
        assert grey.shape == (HEIGHT, WIDTH)
        laplacian = np.zeros_like(grey)
        laplacian[1:-1, 1:-1] = (
            grey[:-2, 1:-1] + grey[2:, 1:-1] + grey[1:-1, :-2] + grey[1:-1, 2:] - 4 * grey[1:-1, 1:-1]
        )
        return {name: float(laplacian[patch].var()) for name, patch in PATCHES.items()}


@pytest.fixture(scope="module")
def notebook(lab, browser):
    return Notebook(browser, *lab)


@pytest.fixture(autouse=True)
def nothing_outside_and_no_errors(notebook):
    yield
    hosts = {urlsplit(url).hostname for url in notebook.requests if not url.startswith(("blob:", "data:"))}
    assert hosts == {"127.0.0.1"}
    assert notebook.errors == []


@pytest.mark.parametrize(
    ("at", "metres", "sharp", "soft"), [(NEAR, NEAR_M, "near", "far"), (FAR, FAR_M, "far", "near")]
)
def test_a_click_focuses_there(notebook, at, metres, sharp, soft):
    before = notebook.sharpness()
    notebook.click(at)
    assert notebook.ask_kernel("picker.lens.focus_distance") == pytest.approx(metres, rel=1e-6)
    x, y = notebook.ask_kernel("picker._request['focus']")
    assert abs(x - at[0] * WIDTH) <= 2
    assert abs(y - at[1] * HEIGHT) <= 2
    after = notebook.sharpness()
    assert after[sharp] > 4.0 * before[sharp]
    assert after[sharp] > 4.0 * after[soft]
    assert notebook.root.locator("code").inner_text() == notebook.ask_kernel("repr(picker.lens)")


def test_the_last_frame_is_that_of_the_last_parameters(notebook):
    notebook.click(NEAR)
    for name, start, end in (("stops", 0.66, 0.3), ("blades", 0.0, 0.42), ("exposure", 0.5, 0.62)):
        notebook.drag(name, start, end, events=50)
        value = float(notebook.root.locator(f"input[name={name}]").input_value())
        assert notebook.ask_kernel(f"picker._request[{name!r}]") == value
    stops = notebook.ask_kernel("picker._request['stops']")
    assert stops < -1.0
    radius = notebook.ask_kernel("picker.lens.aperture_radius")
    assert radius == pytest.approx(0.05 * 2.0 ** (stops / 2.0))
    assert 3 <= notebook.ask_kernel("picker.aperture.blades") <= 8
    # Rendered anew by the kernel from what it says that the parameters are.
    fresh = (
        "__import__('base64').b64encode(__import__('dofsim').picker._look.png("
        "dofsim.render(color, depth, picker.lens, aperture=picker.aperture),"
        " exposure=picker._request['exposure'])).decode()"
    )
    assert notebook.shown() == base64.b64decode(notebook.ask_kernel(fresh))


def test_stale_frames_are_dropped(notebook):
    """Of 50 requests made at once only few are answered: the newest, and those that were under way."""
    made = notebook.ask_kernel(
        "picker.observe(lambda c: frames.append(c['new']['number']), '_frame')"
        " if not globals().__setitem__('frames', []) else 0"
    )
    assert made is None
    notebook.root.locator("input[name=stops]").evaluate(
        """(slider) => {
            for (let i = 0; i < 50; i++) {
                slider.value = -4 + 0.1 * i;
                slider.dispatchEvent(new Event('input'));
            }
            slider.dispatchEvent(new Event('change'));
        }"""
    )
    notebook.settle()
    frames = notebook.ask_kernel("frames")
    assert len(frames) < 10
    assert frames == sorted(frames)
    assert notebook.ask_kernel("picker._request['number']") == frames[-1]


def test_a_preview_comes_quickly(notebook):
    """The reduced picture comes first, and takes little of the kernel's time; the best of some clicks."""
    spent = "__import__('time').process_time()"
    took = []
    for at in (NEAR, FAR) * 4:
        notebook.root.evaluate(
            """(root) => {
                new MutationObserver((_, observer) => {
                    root.dataset.first = root.dataset.full === 'false' ? 'preview' : 'whole';
                    observer.disconnect();
                }).observe(root, { attributes: true, attributeFilter: ['data-full'] });
            }"""
        )
        notebook.page.mouse.move(*notebook.point(at))
        before = notebook.ask_kernel(spent)
        notebook.page.mouse.down()
        notebook.page.wait_for_function("() => document.querySelector('.dofsim-picker').dataset.first")
        took.append(notebook.ask_kernel(spent) - before)
        assert notebook.root.get_attribute("data-first") == "preview"
        size = Image.open(io.BytesIO(notebook.shown())).size
        assert max(size) <= 512
        notebook.page.mouse.up()
        notebook.settle()
        notebook.root.evaluate("(root) => { delete root.dataset.first; }")
    assert min(took) < PREVIEW_S, took


def test_the_keyboard_does_it_too(notebook):
    notebook.click((0.45, 0.5))
    assert notebook.ask_kernel("picker.lens.focus_distance") == pytest.approx(NEAR_M, rel=1e-6)
    notebook.stage.focus()
    notebook.page.keyboard.press("Shift+ArrowRight")
    notebook.page.keyboard.press("Shift+ArrowRight")
    notebook.settle()
    assert notebook.ask_kernel("picker.lens.focus_distance") == pytest.approx(FAR_M, rel=1e-6)
    notebook.root.locator("input[name=exposure]").focus()
    before = notebook.ask_kernel("picker._request['exposure']")
    notebook.page.keyboard.press("ArrowRight")
    notebook.settle()
    assert notebook.ask_kernel("picker._request['exposure']") == before + 0.25


def test_overlays_and_the_wipe(notebook):
    overlay = notebook.stage.locator("img").nth(2)
    for kind, visible in (("coc", True), ("outline", True), ("picture", False)):
        notebook.root.locator("select[name=overlay]").select_option(kind)
        notebook.settle()
        assert overlay.is_visible() == visible
    wipe = notebook.root.locator("input[name=wipe]")
    wipe.focus()
    wipe.press("End")
    assert notebook.stage.locator("img").nth(1).evaluate("(image) => image.style.clipPath") in (
        "inset(0px 0% 0px 0px)",
        "inset(0px 0%)",
        "inset(0px)",
    )
    wipe.press("Home")


def test_pictures_say_what_they_show(notebook):
    notebook.click(FAR)
    alt = notebook.stage.locator("img").first.get_attribute("alt")
    assert "focused at 6 m" in alt
    assert "focused at 6 m" in notebook.root.locator("[role=status]").inner_text()
    assert notebook.stage.get_attribute("aria-label")
