"""Packages that are not always there."""

from __future__ import annotations

__all__ = ["missing"]


def missing(what: str, package: str, extra: str) -> str:
    """Say what is not installed, and how it can be, from a clone of the repository or from an index.

    Parameters
    ----------
    what : str
        What needs it, with its verb.
    package : str
        The package.
    extra : str
        The extra of dofsim that has it.

    Returns
    -------
    str
        The message of an `ImportError`.

    Examples
    --------
    >>> from dofsim._extras import missing
    >>> missing("plots need", "matplotlib", "plot")
    "plots need matplotlib: pip install '.[plot]' in a clone of dofsim, or 'dofsim[plot]' from an index"
    """
    return (
        f"{what} {package}: pip install '.[{extra}]' in a clone of dofsim, or 'dofsim[{extra}]' from an index"
    )
