"""What `dofsim devices` prints."""

import os
import textwrap

from . import _console, _dofsim
from ._dofsim import Device

_TAKEN = {
    "discrete": "taken by --device auto and --device gpu",
    "integrated": "shares the CPU's memory and is mostly no faster",
    "virtual": "a share of a GPU, of unknown speed",
    "other": "of unknown speed, for its driver does not say what it is",
    "software": "computes on the CPU",
}


def describe(device: Device) -> None:
    """Print what an adapter is and can."""
    print(f"{device.id}  {device.name}")
    where = f", {device.pci_bus_id}" if device.pci_bus_id else ""
    _print(f"{device.kind}, {device.backend}, {device.driver}{where}")
    if device.memory_bytes is not None:
        _print(f"{_mebibytes(device.memory_bytes)} MiB of memory")
    buffers = f"buffers of up to {_mebibytes(device.max_binding_bytes)} MiB"
    _print(f"{buffers}; larger frames are rendered in bands")
    if not device.measures_time:
        print("       does not measure time: no --profile")
    taken = _TAKEN[device.kind]
    if not device.visible:
        taken = f"hidden by CUDA_VISIBLE_DEVICES: used only if it is named (--device {device.id})"
    elif device.kind == "software":
        taken += f": used only if it is named (--device {device.id})"
    elif device.kind != "discrete":
        taken += f": used with --device gpu or {device.id}, and not by itself"
    _print(taken)


def _print(words: str) -> None:
    """Print lines beside the name of an adapter."""
    print(textwrap.indent(textwrap.fill(words, 73, break_on_hyphens=False), 7 * " "))


def wrapped(sentence: str) -> str:
    """Give a sentence in lines that fit a terminal."""
    return textwrap.fill(sentence, 80, break_long_words=False, break_on_hyphens=False)


def automatic() -> str:
    """Say what ``device="auto"`` stands for here, and why."""
    chosen = _dofsim.chosen_device("auto")
    name = "the CPU" if chosen == "cpu" else chosen
    if preset := os.environ.get("DOFSIM_DEVICE"):
        return f"--device auto is {name}: the environment variable DOFSIM_DEVICE is {preset!r}."
    reason = "no discrete GPU is to be had" if chosen == "cpu" else "a discrete GPU"
    return f"--device auto is {name}: {reason}."


def check(device: Device, *, verbose: bool) -> bool:
    """Print how far each method on an adapter is from the CPU; say whether all agree."""
    from . import _device_check

    with _console.without_noise(verbose):
        verdicts = list(_device_check.check(device))
    for verdict in verdicts:
        print(f"       {verdict.method:<10} {verdict.text}")
    return all(verdict.agrees for verdict in verdicts)


def _mebibytes(number: int) -> int:
    return number // 2**20
