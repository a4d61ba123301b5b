"""A bar of progress, where somebody looks."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager

__all__ = ["bar"]


@contextmanager
def bar(total: int, name: str, *, shown: bool | None = None) -> Iterator[Callable[[int], object]]:
    """Show how far some work is, on the standard error stream or in a notebook.

    Parameters
    ----------
    total : int
        All of the work.
    name : str
        What is at work.
    shown : bool, optional
        Whether the bar is shown. By default in terminals and notebooks.

    Yields
    ------
    callable
        To be told how much more has been done.
    """
    from tqdm.auto import tqdm

    if shown is None:
        shown = sys.stderr.isatty() or "ipykernel" in sys.modules
    with tqdm(total=total, desc=name, disable=not shown, unit="sample", unit_scale=True) as progress:
        yield progress.update
