"""Which of Mitsuba's variants to render with."""

import os
import re
from pathlib import Path

import mitsuba as mi

# Older ones abort the process when Dr.Jit loads them.
OLDEST_LLVM = 17


def find_llvm() -> Path | None:
    """Find an LLVM that Dr.Jit can use: the one named in its own variable, or the newest installed."""
    named = os.environ.get("DRJIT_LIBLLVM_PATH")
    if named:
        return Path(named)
    found = []
    for pattern in ("lib/*/libLLVM*.so*", "lib/llvm-*/lib/libLLVM*.so*", "lib64/libLLVM*.so*"):
        for path in Path("/usr").glob(pattern):
            version = re.search(r"(\d+)", path.resolve().name)
            if version and int(version[1]) >= OLDEST_LLVM:
                found.append((int(version[1]), path))
    return max(found)[1] if found else None


def choose_variant(wanted: str | None = None) -> str:
    """Set a variant and say which: `wanted`, else LLVM, else scalar, which needs nothing installed."""
    llvm = find_llvm()
    variant = wanted or ("llvm_ad_rgb" if llvm else "scalar_rgb")
    if variant.startswith("llvm") and llvm:
        os.environ["DRJIT_LIBLLVM_PATH"] = str(llvm)
    mi.set_variant(variant)
    # Progress bars would tear what the caller prints; errors are raised all the same.
    mi.logger().clear_appenders()
    return variant
