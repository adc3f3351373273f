"""Test a print's camera or scanner before the print; keep a camera's picture of the empty dish."""

from __future__ import annotations

import shlex
import shutil
from dataclasses import replace
from pathlib import Path

from printctl.observe.devices import DeviceError, DeviceSettings, acquire
from printctl.observe.order import ObserverOrder
from printctl.observe.profiler import try_laser_frame
from printctl.observe.records import emptied_look_folder
from printctl.observe.view_before import EMPTY
from printctl.observe.views import camera_frame, open_view, read_oct_frame
from sim.devices.camera.laser_line import load_profiler
from sim.devices.scanner.oct import load_oct


def try_device(order: ObserverOrder, folder: Path) -> None:
    """Raise where a look couldn't be made; a camera takes a picture, a scanner isn't set going.

    Parameters
    ----------
    order : ObserverOrder
    folder : Path
        The print's; a camera's picture is kept as the one before the first look.

    Raises
    ------
    DeviceError
        When camera, folder, program or file isn't there, or the camera's marks have moved.
    UsageError, SimError, ValueError, OSError
        When the frame or a simulated device's file can't be read.
    """
    _try_frame(order)
    device = order.device
    if device.kind == "camera":
        picture = acquire(device, emptied_look_folder(folder, EMPTY) / "picture")
        open_view(picture, order, 0.0, 0.0)
    elif device.kind == "simulated" and not order.tells_heights:
        acquire(_before_any_motion(device), emptied_look_folder(folder, EMPTY) / "picture")
    elif device.kind == "folder" and not Path(device.source).is_dir():
        raise DeviceError(
            f"folder {device.source} isn't there; the device's program writes into it (a command "
            "would say {out}, the file to write)"
        )
    elif device.kind == "command":
        program = shlex.split(device.source)[0]
        if shutil.which(program) is None:
            raise DeviceError(f"the device's program {program} isn't there, or may not be run")


def _before_any_motion(device: DeviceSettings) -> DeviceSettings:
    """A simulated device without the printer's record, which may still be an earlier print's."""
    extra = {name: value for name, value in device.extra.items() if name != "record"}
    return replace(device, extra=extra)


def _try_frame(order: ObserverOrder) -> None:
    if not order.tells_heights:
        camera_frame(order)
    elif order.frame:
        if order.oct:
            read_oct_frame(Path(order.frame))
        else:
            try_laser_frame(Path(order.frame))
    elif order.oct:
        load_oct(Path(order.device.extra["oct"]))
    else:
        load_profiler(Path(order.device.extra["laser_line"]))
