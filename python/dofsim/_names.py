"""Names that others gave, in messages: of channels, of arrays, of files."""

from __future__ import annotations

from collections.abc import Iterable

# A message names no more than this, and no name at greater length.
_MOST_NAMES = 24
_LONGEST_NAME = 100


def printable(text: str) -> str:
    r"""Escape what a terminal would obey, such as colours, bells and new lines.

    Parameters
    ----------
    text : str
        Any text.

    Returns
    -------
    str
        The same text, with its control characters and what is no character as Python writes them.

    Examples
    --------
    >>> from dofsim._names import printable
    >>> print(printable("red \x1b[31m, and a new\nline"))
    red \x1b[31m, and a new\nline
    """
    return "".join(one if one.isprintable() else one.encode("unicode_escape").decode() for one in text)


def shortened(text: str) -> str:
    """Cut a text that is longer than a line."""
    return text if len(text) <= _LONGEST_NAME else text[: _LONGEST_NAME - 3] + "..."


def listed(names: Iterable[str]) -> str:
    """List names in one line, escaped, and cut if there are many or if they are long.

    Parameters
    ----------
    names : iterable of str
        The names.

    Returns
    -------
    str
        The names with commas between them.

    Examples
    --------
    >>> from dofsim._names import listed
    >>> listed(["R", "G", "B"])
    'R, G, B'
    """
    every = list(names)
    more = [f"and {len(every) - _MOST_NAMES} more"] if len(every) > _MOST_NAMES else []
    return ", ".join([*(printable(shortened(one)) for one in every[:_MOST_NAMES]), *more])
