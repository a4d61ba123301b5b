"""The adapter of GPU tests, the browser that pages are looked at with, and folders for the command line."""

import os
import shutil

import dofsim
import pytest
from command_lines import write_scene
from data_set import keep_few, write_data


def adapter():
    """Name the adapter to test: what the environment asks for, else a GPU, else a software rasteriser."""
    found = sorted(dofsim.devices(), key=lambda device: device.kind == "software")
    return os.environ.get("DOFSIM_DEVICE") or (found[0].id if found else None)


@pytest.fixture(scope="session")
def gpu():
    if (name := adapter()) is None:
        pytest.skip("there is no GPU and no software rasteriser (Debian: mesa-vulkan-drivers)")
    return name


@pytest.fixture
def restricted():
    """Restrict devices until the end of the test."""
    from dofsim._dofsim import restrict_devices

    yield restrict_devices
    restrict_devices()


@pytest.fixture(scope="session")
def browser():
    """Start the system's Chromium, driven by Playwright, which brings none of its own."""
    sync_api = pytest.importorskip("playwright.sync_api", reason="pages are looked at with Playwright")
    found = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
    if found is None:
        pytest.skip("there is no Chromium (Debian: chromium)")
    options = ["--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run", "--disable-sync"]
    options += ["--disable-background-networking", "--disable-component-update"]
    with sync_api.sync_playwright() as playwright:
        chromium = playwright.chromium.launch(executable_path=found, args=options)
        yield chromium
        chromium.close()


@pytest.fixture
def scene(tmp_path, monkeypatch):
    """Go to a folder with a small scene; give its colour and depth."""
    monkeypatch.chdir(tmp_path)
    return write_scene()


@pytest.fixture
def data(tmp_path, monkeypatch):
    """Go to a folder with a data set of which three frames are bad."""
    monkeypatch.chdir(tmp_path)
    write_data()
    return tmp_path


@pytest.fixture
def few(data):
    """Leave four good frames of it."""
    keep_few()


def pytest_collection_modifyitems(items):
    for item in items:
        for need in ("gpu", "browser"):
            if need in getattr(item, "fixturenames", ()):
                item.add_marker(need)


def pytest_terminal_summary(terminalreporter):
    def count(need):
        def of(outcome):
            reports = terminalreporter.stats.get(outcome, [])
            return sum(need in report.keywords for report in reports if hasattr(report, "keywords"))

        return of("passed") + of("failed"), of("skipped")

    ran, skipped = count("gpu")
    if ran or skipped:
        names = {device.id: str(device) for device in dofsim.devices()}
        where = f" on {names.get(adapter(), adapter())}" if ran else ""
        terminalreporter.write_line(f"GPU tests: {ran} ran{where}, {skipped} skipped")
    ran, skipped = count("browser")
    if ran or skipped:
        terminalreporter.write_line(f"Browser tests: {ran} ran, {skipped} skipped")
