"""``python -m dofsim`` is the ``dofsim`` command."""

from .cli import main

main()
