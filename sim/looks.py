"""Command lines of the simulated camera, OCT and laser line over a printer's dish: one look.

Each looks once: it shows what lies in the dish by a simulated printer's record, writes a file
and ends. The record is as it stands: a printer writes it before each M400 is answered, so that in
a look it holds all that was laid.
"""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any, Final, NamedTuple

import cv2
import numpy as np

from firmware_profiles import ProfileError
from gcode.deposit.lay import Laid
from gcode.errors import SimError
from gcode.motion.executed import NO_MOTION
from kernels import keep_freed_memory
from kernels.arrays import FloatArray
from sim.devices.camera.laser_line import ProfilerField, measured_heights, write_heights
from sim.devices.camera.paint import CameraFile, paint
from sim.devices.recorded_ink import InkBox, ink_of_record, read_record
from sim.devices.scanner.oct import OctField, live_scan, write_live_scan
from sim.errors import CameraError

PICTURES = (".png", ".tif", ".tiff", ".jpg", ".jpeg", ".bmp")
Writer = Callable[[Path], None]


class Device(NamedTuple):
    """A device over the dish.

    Attributes
    ----------
    seen, settings : str
        What it shows, and what its own file says.
    suffixes : tuple of str
        Of the files that it writes.
    file : type
        Of its own file.
    look : function
        Looks at the ink by the device's own file and the parsed options, with a seed for the noise;
        returns what writes the result.
    """

    seen: str
    settings: str
    suffixes: tuple[str, ...]
    file: type[CameraFile] | type[OctField] | type[ProfilerField]
    look: Callable[[Laid, Any, argparse.Namespace, int], Writer]


def _picture(ink: Laid, file: CameraFile, given: argparse.Namespace, seed: int) -> Writer:
    with keep_freed_memory():
        picture = paint(ink, file.camera, file.scene, seed)

    def write(path: Path) -> None:
        # Less packed, in a third of the time.
        if not cv2.imwrite(str(path), picture, [cv2.IMWRITE_PNG_COMPRESSION, 1]):
            raise CameraError(f"{given.out} can't be written; check the folder and its space")

    return write


def _scan(ink: Laid, field: OctField, given: argparse.Namespace, seed: int) -> Writer:
    scan = live_scan(ink, field, seed, _region(given, field))
    return lambda path: write_live_scan(path, scan)


def _heights(ink: Laid, field: ProfilerField, given: argparse.Namespace, seed: int) -> Writer:
    heights, to_map = measured_heights(ink, field, seed, _region(given, field))
    return lambda path: write_heights(path, heights, to_map, field.pixel_um)


DEVICES: Final = {
    "camera": Device("a picture", "camera and scene", PICTURES, CameraFile, _picture),
    "oct": Device(
        "an OCT scan of a fixed field", "field and instrument", (".npz",), OctField, _scan
    ),
    "laser_line": Device(
        "a laser profiler's height map", "field and instrument", (".npz",), ProfilerField, _heights
    ),
}


def parser(name: str) -> argparse.ArgumentParser:
    """The options of a device."""
    device = DEVICES[name]
    options = argparse.ArgumentParser(
        prog=f"python -m sim {name}",
        description=f"Show what lies in a simulated printer's dish, once: {device.seen}.",
    )
    options.add_argument(
        "--record",
        type=Path,
        help="the executed motion (.npz) of the printer; without it nothing lies in the dish",
    )
    options.add_argument(
        f"--{name}",
        dest="device",
        required=True,
        type=Path,
        metavar="FILE",
        help=f"{device.settings} (YAML)",
    )
    options.add_argument(
        "--faults", type=Path, metavar="FILE", help="a fault file (YAML), whose `ink` counts"
    )
    if issubclass(device.file, InkBox):
        for corner in ("low", "high"):
            options.add_argument(
                f"--{corner}",
                type=_place,
                metavar="X,Y,Z",
                help=f"{corner}est corner of what is looked at, mm; default: all of the field",
            )
    written = ", ".join(device.suffixes)
    options.add_argument("--out", required=True, type=Path, help=f"the file to write: {written}")
    options.add_argument(
        "--look",
        type=int,
        help="number that the noise is drawn by; default: of the record's blocks, so that a second "
        "picture of the same look needs another one",
    )
    return options


def main(words: list[str]) -> int:
    """Look once; 0 when that went well, 2 when not."""
    name, *rest = words
    try:
        _look(DEVICES[name], parser(name).parse_args(rest))
    except (SimError, ProfileError) as exc:
        print(f"error: {exc}", file=sys.stderr)
        return 2
    return 0


def _look(device: Device, given: argparse.Namespace) -> None:
    """Write what a device sees of what the record says to lie in the dish; all empty without one.

    OCT and laser line look between ``low`` and ``high`` of their fields only, where given.
    """
    out: Path = given.out
    if out.suffix.lower() not in device.suffixes:
        raise device.file.error(f"{out}: {device.seen} is written as {', '.join(device.suffixes)}")
    motion = read_record(given.record) if given.record else NO_MOTION
    if given.look is not None and given.look < 0:
        raise device.file.error(f"look {given.look} must be 0 or more")
    seed = len(motion) if given.look is None else given.look
    file = device.file.load(given.device)
    _write_whole(
        out, device.look(ink_of_record(motion, given.faults, file.laid), file, given, seed)
    )


def _region(given: argparse.Namespace, field: InkBox) -> tuple[FloatArray, FloatArray]:
    low = np.array(field.low_mm) if given.low is None else given.low
    high = np.array(field.high_mm) if given.high is None else given.high
    return low, high


def _place(words: str) -> FloatArray:
    """Three numbers with commas between them, (3,), mm."""
    place = np.array([float(word) for word in words.split(",")])
    if place.shape != (3,) or not np.isfinite(place).all():
        raise ValueError
    return place


def _write_whole(path: Path, write: Writer) -> None:
    """Write by way of a temporary file: whoever waits for it never sees half of it."""
    draft = path.with_name(f".{path.stem}.{os.getpid()}.part{path.suffix}")
    try:
        write(draft)
        draft.replace(path)
    except OSError as exc:
        raise CameraError(f"{path} can't be written: {exc.strerror}") from exc
    finally:
        draft.unlink(missing_ok=True)
