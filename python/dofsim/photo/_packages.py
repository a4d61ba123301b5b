"""What reading and writing photographs takes: the extra ``photo``."""

from __future__ import annotations

from typing import Any

from dofsim._extras import missing


def load_pillow() -> Any:
    """Import Pillow, or say how to install it."""
    try:
        from PIL import Image
    except ImportError as error:
        raise ImportError(missing("writing photographs needs", "Pillow", "photo")) from error
    return Image


def load_heif() -> Any:
    """Import pillow-heif, or say how to install it."""
    try:
        import pillow_heif
    except ImportError as error:
        raise ImportError(missing("HEIC and AVIF need", "pillow-heif", "photo")) from error
    return pillow_heif
