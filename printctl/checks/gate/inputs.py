"""Inputs of the G-code gate: origin of the line, printer state, limits in force."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Final

from firmware_profiles import Printer
from printctl.checks.gate.limits import Bounds
from printctl.checks.gate.verdict import Place

UNNAMED_C: Final = 45.0
"""Hottest target while nobody said which ink or bath is there: cells and proteins bear no more."""


class LineOrigin(StrEnum):
    """Origin of a G-code line."""

    CONSOLE = "console"
    """Typed by a person, a macro, or the REST API."""
    JOB = "job"
    """A job's file: a calibration print's and a recovery's rest, too."""


class Phase(StrEnum):
    """State of the printer."""

    STANDING = "standing"
    PRINTING = "printing"
    PAUSED = "paused"


@dataclass(frozen=True)
class Limit:
    """A limit of heat, °C, and where it comes from."""

    celsius: float
    why: str


_UNNAMED_INK: Final = Limit(UNNAMED_C, "no ink is named; name it (mount, --ink) if it bears more")
_UNNAMED_BATH: Final = Limit(
    UNNAMED_C, "no bath is named; name it (mount, --bath) if it bears more"
)


@dataclass(frozen=True)
class PrinterSituation:
    """The moment, as far as it is known.

    Attributes
    ----------
    bounds : Bounds
        The machine, and the room around the tip.
    phase : Phase
    position : (x, y, z) or None, mm
        Of the tip, as the printer counts.
    heat : mapping of str to Limit
        By heater: ``nozzle``, ``nozzle 1``, ``bed``, ``chamber``.
    heaters : tuple of str or None
        Those that the printer tells of; None where it hasn't been asked.
    plunger_mm : float or None, mm
        E as the printer counts it; None where it isn't known, or nobody may move it.
    plunger_mm_s : float, mm/s
        Fastest that the ink bears; infinite where nobody named it.
    needle_off : bool
        Whether a person said that the needle was taken off (homing).
    """

    bounds: Bounds
    phase: Phase = Phase.STANDING
    position: Place | None = None
    heat: Mapping[str, Limit] = field(default_factory=dict)
    heaters: tuple[str, ...] | None = None
    plunger_mm: float | None = None
    plunger_mm_s: float = float("inf")
    needle_off: bool = False

    @staticmethod
    def of_job(printer: Printer) -> PrinterSituation:
        """For a job's lines: its moves and its heat are judged by preflight, as a whole."""
        anything = Limit(math.inf, "judged by preflight")
        heat = dict.fromkeys(("nozzle", "bed", "chamber"), anything)
        return PrinterSituation(Bounds(printer), Phase.PRINTING, heat=heat)

    @property
    def printer(self) -> Printer:
        """Its profile."""
        return self.bounds.printer

    def hottest(self, heater: str) -> Limit:
        """Hottest target of a heater."""
        kind = heater.partition(" ")[0]
        unnamed = _UNNAMED_INK if kind == "nozzle" else _UNNAMED_BATH
        return self.heat.get(heater) or self.heat.get(kind) or unnamed
