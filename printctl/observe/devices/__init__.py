"""Acquire a picture or volume from a camera, a folder, a command or the simulated printer.

Goes in: a device's settings. Comes out: a file. Each acquisition is a process of its own that is
ended at its time limit, so that a device that hangs holds up nobody. Begin with `acquire.py`.
"""

from printctl.observe.devices.acquire import DeviceError, acquire
from printctl.observe.devices.files import picture_of
from printctl.observe.devices.settings import DeviceSettings

__all__ = ["DeviceError", "DeviceSettings", "acquire", "picture_of"]
