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

import cv2
import numpy as np

from firmware_profiles import ProfileError
from kernels import keep_freed_memory
from kernels.arrays import FloatArray
from sim.devices.camera.laser_line import load_profiler, measured_heights, write_heights
from sim.devices.camera.paint import load_camera, paint
from sim.devices.recorded_ink import ink_of_record, read_record
from sim.devices.scanner.oct import live_scan, load_oct, write_live_scan
from sim.errors import CameraError, ScannerError, SimError
from sim.gcode.motion.executed import NO_MOTION, ExecutedMotion

PICTURES = (".png", ".tif", ".tiff", ".jpg", ".jpeg", ".bmp")
DEVICES = {
    "camera": ("a picture", "camera and scene"),
    "oct": ("an OCT scan of a fixed field", "field and instrument"),
    "laser_line": ("a laser profiler's height map", "field and instrument"),
}


def parser(device: str) -> argparse.ArgumentParser:
    """The options of a device."""
    camera, (seen, told) = device == "camera", DEVICES[device]
    options = argparse.ArgumentParser(
        prog=f"python -m sim {device}",
        description=f"Show what lies in a simulated printer's dish, once: {seen}.",
    )
    options.add_argument(
        "--record",
        type=Path,
        help="the executed motion (.npz) of the printer; without it nothing lies in the dish",
    )
    options.add_argument(
        f"--{device}",
        dest="device",
        required=True,
        type=Path,
        metavar="FILE",
        help=f"{told} (YAML)",
    )
    options.add_argument(
        "--faults", type=Path, metavar="FILE", help="a fault file (YAML), whose `ink` counts"
    )
    if not camera:
        for corner in ("low", "high"):
            options.add_argument(
                f"--{corner}",
                type=_place,
                metavar="X,Y,Z",
                help=f"{corner}est corner of what is looked at, mm; default: all of the field",
            )
    written = ", ".join(PICTURES) if camera else ".npz"
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
    device, *rest = words
    given = parser(device).parse_args(rest)
    common = given.record, given.faults, given.device, given.out, given.look
    try:
        if device == "camera":
            take_picture(*common)
        else:
            take = take_scan if device == "oct" else take_heights
            take(*common, low_mm=given.low, high_mm=given.high)
    except (SimError, ProfileError) as exc:
        print(f"error: {exc}", file=sys.stderr)
        return 2
    return 0


def take_picture(
    record: Path | None, faults: Path | None, camera: Path, out: Path, look: int | None = None
) -> None:
    """Take one picture of what a record says to lie in the dish; of an empty dish without one.

    Raises
    ------
    SimError
        When a file can't be read or written, or the ink can't be known.
    ProfileError
        When a profile isn't there.
    """
    if out.suffix.lower() not in PICTURES:
        raise CameraError(f"{out}: a picture is written as {', '.join(PICTURES)}")
    file = load_camera(camera)
    motion = read_record(record) if record else NO_MOTION
    seed = _seed(look, motion)
    ink = ink_of_record(motion, faults, file.laid)
    with keep_freed_memory():
        picture = paint(ink, file.camera, file.scene, seed)

    def write(path: Path) -> None:
        # Less packed, in a third of the time.
        if not cv2.imwrite(str(path), picture, [cv2.IMWRITE_PNG_COMPRESSION, 1]):
            raise CameraError(f"{out} can't be written; check the folder and its space")

    _whole(out, write)


def take_scan(
    record: Path | None,
    faults: Path | None,
    field: Path,
    out: Path,
    look: int | None = None,
    *,
    low_mm: FloatArray | None = None,
    high_mm: FloatArray | None = None,
) -> None:
    """Take one OCT scan of what a record says to lie in the dish, as `take_picture` does.

    Only what lies between ``low_mm`` and ``high_mm`` of the field is scanned, where they are given.
    """
    if out.suffix.lower() != ".npz":
        raise ScannerError(f"{out}: a scan is written as .npz")
    oct_field = load_oct(field)
    motion = read_record(record) if record else NO_MOTION
    ink = ink_of_record(motion, faults, oct_field.laid)
    low = np.array(oct_field.low_mm) if low_mm is None else low_mm
    high = np.array(oct_field.high_mm) if high_mm is None else high_mm
    scan = live_scan(ink, oct_field, _seed(look, motion), (low, high))
    _whole(out, lambda path: write_live_scan(path, scan))


def take_heights(
    record: Path | None,
    faults: Path | None,
    field: Path,
    out: Path,
    look: int | None = None,
    *,
    low_mm: FloatArray | None = None,
    high_mm: FloatArray | None = None,
) -> None:
    """Take one height map of what a record says to lie in the dish, as `take_scan` does."""
    if out.suffix.lower() != ".npz":
        raise CameraError(f"{out}: a height map is written as .npz")
    profiler = load_profiler(field)
    motion = read_record(record) if record else NO_MOTION
    ink = ink_of_record(motion, faults, profiler.laid)
    low = np.array(profiler.low_mm) if low_mm is None else low_mm
    high = np.array(profiler.high_mm) if high_mm is None else high_mm
    heights, to_map = measured_heights(ink, profiler, _seed(look, motion), (low, high))
    _whole(out, lambda path: write_heights(path, heights, to_map, profiler.pixel_um))


def _place(words: str) -> FloatArray:
    """Three numbers with commas between them, (3,), mm."""
    place = np.array([float(word) for word in words.split(",")])
    if place.shape != (3,) or not np.isfinite(place).all():
        raise ValueError
    return place


def _seed(look: int | None, motion: ExecutedMotion) -> int:
    if look is not None and look < 0:
        raise CameraError(f"look {look} must be 0 or more")
    return len(motion) if look is None else look


def _whole(path: Path, write: Callable[[Path], None]) -> None:
    """Write by way of a temporary file: whoever waits for it never sees half of it."""
    draft = path.with_name(f".{path.stem}.{os.getpid()}.part{path.suffix}")
    try:
        write(draft)
        draft.replace(path)
    except OSError as exc:
        raise CameraError(f"{path} can't be written: {exc.strerror}") from exc
    finally:
        draft.unlink(missing_ok=True)
