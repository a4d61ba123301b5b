"""RGB-D pictures of Mitsuba 3 scenes, and dofsim beside Mitsuba's own ``thinlens``.

Needs Mitsuba, the extra ``mitsuba``. A scene is a loaded one, a dictionary, or the path of an XML file. The
lens is that of the scene's own ``thinlens`` sensor; the pinhole has the same place, field of view and film.
Where no variant of Mitsuba has been set, LLVM's is if there is an LLVM for it, else ``scalar_rgb``.
"""

from dofsim._extras import missing as _missing

try:
    import mitsuba as _mitsuba  # noqa: F401
except ImportError as error:
    raise ImportError(_missing("dofsim.mitsuba needs", "Mitsuba 3", "mitsuba")) from error

from ._capture import Capture, rgbd
from ._comparison import Comparison, compare
from ._variant import find_llvm, set_variant

__all__ = ["Capture", "Comparison", "compare", "find_llvm", "rgbd", "set_variant"]


def __dir__() -> list[str]:
    """List the public names."""
    return sorted(__all__)
