"""Command line of the simulated camera: ``python -m sim camera``.

It looks once: paints what lies in the dish by a simulated printer's record, writes the picture and
ends. The record is as it stands: a printer writes it before each M400 is answered, so that in a
look it holds all that was laid.
"""

from __future__ import annotations

import argparse
import os
import sys
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from firmware_profiles import Ink, Printer, ProfileError, Syringe, load
from sim.camera.camera_file import InkSource, load_camera
from sim.camera.paint import paint
from sim.deposit.laid import Laid, laid, nothing_laid
from sim.errors import CameraError, SimError
from sim.faults.fault_file import load_faults
from sim.faults.ink_faults import NO_FAULTS, InkFaults
from sim.motion.executed import ExecutedMotion

_LOOKS = 2**31
_SUFFIXES = (".png", ".tif", ".tiff", ".jpg", ".jpeg", ".bmp")


def parser() -> argparse.ArgumentParser:
    """The command line's options."""
    options = argparse.ArgumentParser(
        prog="python -m sim camera",
        description="Paint what lies in a simulated printer's dish, once, into a picture file.",
    )
    options.add_argument(
        "--record", required=True, type=Path, help="the executed motion (.npz) of the printer"
    )
    options.add_argument(
        "--camera", required=True, type=Path, metavar="FILE", help="camera and scene (YAML)"
    )
    options.add_argument(
        "--faults", type=Path, metavar="FILE", help="a fault file (YAML), whose `ink` counts"
    )
    options.add_argument("--out", required=True, type=Path, help="the picture: .png, .tif, .jpg")
    options.add_argument(
        "--look", type=int, default=0, help="number of the look: the sensor's noise differs by it"
    )
    return options


def main(arguments: list[str]) -> int:
    """Look once; 0 when that went well, 2 when not."""
    given = parser().parse_args(arguments)
    try:
        look(given.record, given.faults, given.camera, given.out, given.look)
    except (SimError, ProfileError) as exc:
        print(f"error: {exc}", file=sys.stderr)
        return 2
    return 0


def look(record: Path, faults: Path | None, camera: Path, out: Path, number: int = 0) -> None:
    """Take one picture of what a record says to lie in the dish.

    Raises
    ------
    SimError
        When a file can't be read or written, or the ink can't be known.
    ProfileError
        When a profile isn't there.
    """
    if not 0 <= number < _LOOKS:
        raise CameraError(f"look {number} must be 0 to {_LOOKS - 1}")
    if out.suffix.lower() not in _SUFFIXES:
        raise CameraError(f"{out}: a picture is written as {', '.join(_SUFFIXES)}")
    file = load_camera(camera)
    wrong = load_faults(faults).of_ink if faults else NO_FAULTS
    motion = read_record(record)
    ink = ink_of_record(motion, wrong, file.laid)
    tip = motion.end[-1] if len(motion) else None
    picture = paint(ink, file.camera, file.scene, number, tip_mm=tip, folder=camera.parent)
    _write(out, picture)


def read_record(path: Path) -> ExecutedMotion:
    """Read executed motion.

    Raises
    ------
    CameraError
        When there is none.
    """
    try:
        return ExecutedMotion.load(path)
    except (OSError, ValueError, TypeError, KeyError) as exc:
        raise CameraError(
            f"record {path} can't be read ({exc}); the simulated printer writes it (--record)"
        ) from exc


def ink_of_record(motion: ExecutedMotion, faults: InkFaults, source: InkSource) -> Laid:
    """Return what lies in the dish by a record; nothing before the first line is written.

    Raises
    ------
    CameraError
        When the head is a pneumatic one.
    """
    printer = load(Printer, source.printer)
    if printer.pneumatic is not None:
        raise CameraError(
            f"{printer.name} has a pneumatic head, whose record doesn't say when its valve stood "
            "open; the simulated camera knows plungers only"
        )
    flow_factor = load(Ink, source.ink).flow_factor if source.ink else 1.0
    area = load(Syringe, source.syringe).area_mm2 * flow_factor
    step = 1 / printer.of_head(source.head).steps_per_mm.e
    if printer.heads:
        motion = motion.of_head(source.head, printer.heads[source.head].offset_mm.mm)
    pushes = motion.plunger_end > motion.plunger_start
    if not (pushes & (motion.start != motion.end).any(axis=1)).any():
        return nothing_laid()
    return laid(
        motion,
        faults.of_head(source.head),
        area,
        style=source.style,
        plunger_step_mm=step,
        layer_mm=source.layer_mm,
    )


def _write(path: Path, picture: NDArray[np.uint8]) -> None:
    """Write by way of a temporary file: whoever waits for the picture never sees half of it."""
    draft = path.with_name(f".{path.stem}.{os.getpid()}.part{path.suffix}")
    try:
        if not cv2.imwrite(str(draft), picture):
            raise CameraError(f"picture {path} can't be written; check the folder and its space")
        draft.replace(path)
    except OSError as exc:
        raise CameraError(f"picture {path} can't be written: {exc.strerror}") from exc
    finally:
        draft.unlink(missing_ok=True)
