"""Depth of field as a real lens would have taken it, from a picture and its depth."""

from dofsim._dofsim import Aperture, DeviceError, Lens, Scene, __version__, coc, render

__all__ = ["Aperture", "DeviceError", "Lens", "Scene", "__version__", "coc", "render"]
