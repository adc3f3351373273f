"""Compute ink in the dish from recorded printer motion and a fault file."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Self

from pydantic import Field, model_validator

from firmware_profiles import Ink, Printer, Syringe, load
from gcode.deposit.ink_faults import NO_FAULTS
from gcode.deposit.lay import Laid, Style, laid, nothing_laid
from gcode.errors import DepositError
from gcode.motion.executed import ExecutedMotion
from gcode.user_files import FileSection, UserFile
from sim.devices.faults import FaultFile


class InkSource(FileSection):
    """How executed motion becomes ink.

    Attributes
    ----------
    printer, syringe, ink : str
        Profiles: shipped name, or path of a .yaml. Without an ink as much comes out as is pushed.
    head : int
        Of a printer with several: whose ink is seen.
    style : "layered" or "embedded" or None
        None decides from the motion.
    layer_mm : float or None, mm
        Height of the lines while there is but one level.
    """

    printer: str
    syringe: str
    ink: str | None = None
    head: Annotated[int, Field(ge=0, le=15)] = 0
    style: Style | None = None
    layer_mm: Annotated[float, Field(gt=0, le=10)] | None = None


class InkBox(UserFile):
    """Ink within a box of the printer's frame, as a device sees it.

    Attributes
    ----------
    low_mm, high_mm : (x, y, z), mm
        Corners of the box.
    """

    low_mm: tuple[float, float, float]
    high_mm: tuple[float, float, float]
    laid: InkSource

    @model_validator(mode="after")
    def _box_has_room(self) -> Self:
        if not all(high > low for low, high in zip(self.low_mm, self.high_mm, strict=True)):
            raise ValueError("high_mm must be above low_mm in x, y and z")
        return self


def read_record(path: Path) -> ExecutedMotion:
    """Read executed motion.

    Raises
    ------
    DepositError
        When there is none.
    """
    try:
        return ExecutedMotion.load(path)
    except (OSError, ValueError, TypeError, KeyError) as exc:
        raise DepositError(
            f"record {path} can't be read ({exc}); the simulated printer writes it (--record)"
        ) from exc


def ink_of_record(motion: ExecutedMotion, faults: Path | None, source: InkSource) -> Laid:
    """Return what lies in the dish; nothing before the first line is written.

    Raises
    ------
    DepositError
        When the head is a pneumatic one.
    ServeError
        When the fault file can't be read.
    ProfileError
        When a profile isn't there.
    """
    printer = load(Printer, source.printer)
    if printer.pneumatic is not None:
        raise DepositError(
            f"{printer.name} has a pneumatic head, whose record doesn't say when its valve stood "
            "open; simulated devices over the dish know plungers only"
        )
    wrong = FaultFile.load(faults).of_ink if faults else NO_FAULTS
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
        wrong.of_head(source.head),
        area,
        style=source.style,
        plunger_step_mm=step,
        layer_mm=source.layer_mm,
    )
