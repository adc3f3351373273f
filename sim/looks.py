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
from sim.devices.recorded_ink import InkBox, ink_of_record, read_record
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
    camera, (seen, settings) = device == "camera", DEVICES[device]
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
        help=f"{settings} (YAML)",
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
    try:
        _look(device, parser(device).parse_args(rest))
    except (SimError, ProfileError) as exc:
        print(f"error: {exc}", file=sys.stderr)
        return 2
    return 0


def _look(device: str, given: argparse.Namespace) -> None:
    """Write what a device sees of what the record says to lie in the dish; all empty without one.

    OCT and laser line look between ``low`` and ``high`` of their fields only, where given.
    """
    out: Path = given.out
    _check_suffix(device, out)
    motion = read_record(given.record) if given.record else NO_MOTION
    seed = _seed(given.look, motion)
    if device == "camera":
        file = load_camera(given.device)
        ink = ink_of_record(motion, given.faults, file.laid)
        with keep_freed_memory():
            picture = paint(ink, file.camera, file.scene, seed)

        def write(path: Path) -> None:
            # Less packed, in a third of the time.
            if not cv2.imwrite(str(path), picture, [cv2.IMWRITE_PNG_COMPRESSION, 1]):
                raise CameraError(f"{out} can't be written; check the folder and its space")

        _write_whole(out, write)
    elif device == "oct":
        oct_field = load_oct(given.device)
        ink = ink_of_record(motion, given.faults, oct_field.laid)
        scan = live_scan(ink, oct_field, seed, _region(given, oct_field))
        _write_whole(out, lambda path: write_live_scan(path, scan))
    else:
        profiler = load_profiler(given.device)
        ink = ink_of_record(motion, given.faults, profiler.laid)
        heights, to_map = measured_heights(ink, profiler, seed, _region(given, profiler))
        _write_whole(out, lambda path: write_heights(path, heights, to_map, profiler.pixel_um))


def _check_suffix(device: str, out: Path) -> None:
    suffix = out.suffix.lower()
    if device == "camera" and suffix not in PICTURES:
        raise CameraError(f"{out}: a picture is written as {', '.join(PICTURES)}")
    if device == "oct" and suffix != ".npz":
        raise ScannerError(f"{out}: a scan is written as .npz")
    if device == "laser_line" and suffix != ".npz":
        raise CameraError(f"{out}: a height map is written as .npz")


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


def _seed(look: int | None, motion: ExecutedMotion) -> int:
    if look is not None and look < 0:
        raise CameraError(f"look {look} must be 0 or more")
    return len(motion) if look is None else look


def _write_whole(path: Path, write: Callable[[Path], None]) -> None:
    """Write by way of a temporary file: whoever waits for it never sees half of it."""
    draft = path.with_name(f".{path.stem}.{os.getpid()}.part{path.suffix}")
    try:
        write(draft)
        draft.replace(path)
    except OSError as exc:
        raise CameraError(f"{path} can't be written: {exc.strerror}") from exc
    finally:
        draft.unlink(missing_ok=True)
