"""Which of Mitsuba's variants to render with."""

from __future__ import annotations

import os
import re
from pathlib import Path

import mitsuba as mi

__all__ = ["check_variant", "find_llvm", "set_variant"]

# Older ones abort the process when Dr.Jit loads them.
_OLDEST_LLVM = 17


def find_llvm() -> Path | None:
    """Return the path of an LLVM that Mitsuba's ``llvm`` variants can use.

    Returns
    -------
    Path or None
        What the environment variable ``DRJIT_LIBLLVM_PATH`` names, else the newest one installed under
        ``/usr`` that is new enough not to abort the process.

    Examples
    --------
    >>> from dofsim.mitsuba import find_llvm
    >>> found = find_llvm()
    """
    named = os.environ.get("DRJIT_LIBLLVM_PATH")
    if named:
        return Path(named)
    found = []
    for pattern in ("lib/*/libLLVM*.so*", "lib/llvm-*/lib/libLLVM*.so*", "lib64/libLLVM*.so*"):
        for path in Path("/usr").glob(pattern):
            version = re.search(r"(\d+)", path.resolve().name)
            if version and int(version[1]) >= _OLDEST_LLVM:
                found.append((int(version[1]), path))
    return max(found)[1] if found else None


def set_variant(wanted: str | None = None) -> str:
    """Set a variant of Mitsuba, and return its name.

    Parameters
    ----------
    wanted : str, optional
        Its name; by default ``"llvm_ad_rgb"`` where `find_llvm` finds one, else ``"scalar_rgb"``, which needs
        nothing installed.

    Returns
    -------
    str
        Its name.

    Examples
    --------
    >>> from dofsim.mitsuba import set_variant
    >>> set_variant("scalar_rgb")
    'scalar_rgb'
    """
    llvm = find_llvm()
    variant = wanted or ("llvm_ad_rgb" if llvm else "scalar_rgb")
    if variant.startswith("llvm") and llvm:
        os.environ["DRJIT_LIBLLVM_PATH"] = str(llvm)
    mi.set_variant(variant)
    return variant


def check_variant() -> None:
    """Set a variant if none is; refuse those whose colours are not red, green and blue."""
    variant = mi.variant() or set_variant()
    if "rgb" not in variant or "polarized" in variant:
        raise ValueError(f"Mitsuba's variant must be one of rgb without polarisation; {variant!r} is set")
