"""Limit an insert's total plunger travel and duration, summed line by line."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

from firmware_profiles import Printer
from printctl.machine.errors import Refused
from printctl.machine.job.modal import Modal
from sim.gcode.reading import read_sent

LONGEST_S: Final = 1800.0
MOST_RELIEF_MM: Final = 10.0
"""Farthest that an insert may draw the plunger back: a relief, and no opening of the syringe."""
MOST_PUSH_MM: Final = 60.0
"""Farthest that one may push it where the profile names no travel."""
_SAME_MM: Final = 1e-3


@dataclass
class InsertSums:
    """Sums over an insert's lines so far.

    Attributes
    ----------
    plunger_mm : float, mm
        From where it stood as the insert begins, whatever it is called (G92).
    seconds : float, s
        Moves at the speeds asked for, and waits.
    """

    plunger_mm: float = 0.0
    seconds: float = 0.0

    def add(self, line: bytes, before: Modal, after: Modal) -> None:
        """Add a line that leads from one place to another.

        Raises
        ------
        Refused
            When the plunger is drawn back too far, or all takes too long.
        """
        if line.startswith(b"G4"):
            read = read_sent(line)
            self.seconds += (read.number("P") or 0.0) / 1e3 + (read.number("S") or 0.0)
        elif line.startswith((b"G0", b"G1")):
            push = (after.e or 0.0) - (before.e or 0.0) if before.e is not None else 0.0
            self.plunger_mm += push
            way = math.dist(_place(before), _place(after)) or abs(push)
            self.seconds += 60.0 * way / after.f if after.f else 0.0
        if self.plunger_mm < -MOST_RELIEF_MM:
            raise Refused(
                f"the plunger would stand {-self.plunger_mm:.3g} mm behind its place; an insert "
                f"draws it back by {MOST_RELIEF_MM:g} mm at most"
            )
        if self.seconds > LONGEST_S:
            raise Refused(
                f"the insert would take more than {LONGEST_S / 60:g} min with the needle in the "
                "bath; raise F, wait less, or mend less at a time"
            )

    def check_whole(self, printer: Printer, name: str) -> None:
        """Refuse an insert behind which the plunger stands elsewhere than its count says.

        Raises
        ------
        Refused
        """
        if self.plunger_mm < -_SAME_MM:
            raise Refused(
                f"{name} leaves the plunger {-self.plunger_mm:.3g} mm behind where it stood, so "
                "what follows would be dry; push back what was drawn back"
            )
        most = printer.plunger_travel_mm or MOST_PUSH_MM
        if self.plunger_mm > most:
            raise Refused(
                f"{name} pushes the plunger by {self.plunger_mm:.3g} mm, more than the {most:g} mm "
                "that it has to go"
            )


def _place(at: Modal) -> tuple[float, float, float]:
    return at.x or 0.0, at.y or 0.0, at.z or 0.0
