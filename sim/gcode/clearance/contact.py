"""Record of a needle shaft's contact with a filament: place, intrusion in mm, G-code lines."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

TOUCH_MM: Final = 0.005
"""Deeper is a crossing: the text's rounding and the motors' steps leave places as uncertain."""


@dataclass(frozen=True)
class ShaftContact:
    """A move whose shaft passes through a vessel's ink, or by it nearer than the clearance.

    Attributes
    ----------
    line : int
        Of the G-code, from 1.
    kind : str
        Of `sim.gcode.clearance.heads.KINDS`.
    head : int
        Whose needle.
    vessel : int or None
        Being written; of a lift the one left, of another travel the one gone to.
    crossed : int or None
        Whose ink; None for ink of no vessel.
    crossed_line : int
        Line that wrote it.
    depth_mm : float, mm
        How far the bare shaft reaches into the filament; more than its diameter when the axis is
        well inside the shaft. Negative where it passes by at that distance.
    place_mm, tip_mm : (x, y, z), mm
        On the axis of the ink; of the tip meanwhile.
    """

    line: int
    kind: str
    head: int
    vessel: int | None
    crossed: int | None
    crossed_line: int
    depth_mm: float
    place_mm: tuple[float, float, float]
    tip_mm: tuple[float, float, float]

    @property
    def crosses(self) -> bool:
        """Whether the needle itself is in the ink."""
        return self.depth_mm > TOUCH_MM

    def sentence(self) -> str:
        """For people."""
        x, y, z = self.place_mm
        own = "" if self.vessel is None else f" for vessel {self.vessel}"
        other = "ink of no vessel" if self.crossed is None else f"vessel {self.crossed}"
        if self.depth_mm > 0:
            what = f"drives the shaft {self.depth_mm:.3f} mm into {other}"
        else:
            what = f"takes the shaft past {other} at {-self.depth_mm:.3f} mm"
        return (
            f"line {self.line} ({self.kind}{own}) {what}, written by line {self.crossed_line}, at "
            f"x {x:.2f}, y {y:.2f}, z {z:.2f} mm (printer's frame)"
        )


def pairs_of(contacts: tuple[ShaftContact, ...]) -> int:
    """Counted once for each vessel being written and vessel crossed."""
    return len({(contact.vessel, contact.crossed) for contact in contacts})
