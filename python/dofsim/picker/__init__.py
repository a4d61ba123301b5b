"""Focus by a click: a widget for Jupyter (the extra ``notebook``).

The browser keeps what is asked for, in one numbered request; the kernel answers with one numbered frame.
ipywidgets sends the next request when the kernel has dealt with the last one, and the newest replaces those
that wait; so frames that nobody needs any more are never made. While something is dragged, frames are those
of a reduced picture; when it is let go, of the whole one.
"""

from dofsim._extras import missing as _missing

try:
    import anywidget as _anywidget  # noqa: F401
except ImportError as error:
    raise ImportError(_missing("FocusPicker needs", "anywidget", "notebook")) from error

from ._widget import FocusPicker

__all__ = ["FocusPicker"]
