"""Which of Mitsuba's variants to render with."""

import mitsuba as mi
from dofsim.mitsuba import set_variant


def choose_variant(wanted: str | None = None) -> str:
    """Set a variant and say which: `wanted`, else LLVM, else scalar, which needs nothing installed."""
    variant = set_variant(wanted)
    # Progress bars would tear what the caller prints; errors are raised all the same.
    mi.logger().clear_appenders()
    return variant
