"""The adapter that GPU tests run on, and how many of them did."""

import os

import dofsim
import pytest


def adapter():
    """Name the adapter to test: what the environment asks for, else a GPU, else a software rasteriser."""
    found = sorted(dofsim.devices(), key=lambda device: device.kind == "software")
    return os.environ.get("DOFSIM_DEVICE") or (found[0].id if found else None)


@pytest.fixture(scope="session")
def gpu():
    if (name := adapter()) is None:
        pytest.skip("there is no GPU and no software rasteriser (Debian: mesa-vulkan-drivers)")
    return name


def pytest_collection_modifyitems(items):
    for item in items:
        if "gpu" in getattr(item, "fixturenames", ()):
            item.add_marker(pytest.mark.gpu)


def pytest_terminal_summary(terminalreporter):
    def count(outcome):
        reports = terminalreporter.stats.get(outcome, [])
        return sum("gpu" in report.keywords for report in reports if hasattr(report, "keywords"))

    ran, skipped = count("passed") + count("failed"), count("skipped")
    if ran or skipped:
        names = {device.id: str(device) for device in dofsim.devices()}
        where = f" on {names.get(adapter(), adapter())}" if ran else ""
        terminalreporter.write_line(f"GPU tests: {ran} ran{where}, {skipped} skipped")
