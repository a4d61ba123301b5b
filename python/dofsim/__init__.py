"""Depth of field as a real lens would have taken it, from a picture and its depth."""

from dofsim._dofsim import Aperture, Device, DeviceError, Lens, Scene, __version__, coc, devices, render

__all__ = ["Aperture", "Device", "DeviceError", "Lens", "Scene", "__version__", "coc", "devices", "render"]
