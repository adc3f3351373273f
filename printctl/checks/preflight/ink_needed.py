"""Compute a print's ink: written, left in syringe and needle, and to be loaded."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

from firmware_profiles import Needle, Printer, Syringe
from sim.gcode.dry_run.run import DryRun
from sim.gcode.heads import flowing_s


@dataclass(frozen=True)
class InkUse:
    """Ink of one print.

    Attributes
    ----------
    pushed_ul : float, µL
        What leaves the syringe.
    dead_ul : float, µL
        What stays in syringe, hub and needle at the end of each filling.
    holds_ul : float, µL
        What a filling may push out: the syringe's volume less the dead one, or what the drive's
        travel reaches.
    fillings : int
    """

    pushed_ul: float
    dead_ul: float
    holds_ul: float
    fillings: int

    @property
    def needed_ul(self) -> float:
        """To be mixed: pushed, and the dead volume of every filling."""
        return self.pushed_ul + self.fillings * self.dead_ul

    @property
    def loaded_ul(self) -> float:
        """What full syringes hold, dead volume included."""
        return self.fillings * (self.holds_ul + self.dead_ul)

    def facts(self) -> dict[str, Any]:
        """For the report."""
        return {
            "ink_pushed_ul": round(self.pushed_ul, 3),
            "ink_left_per_filling_ul": round(self.dead_ul, 3),
            "fillings": self.fillings,
            "ink_needed_ul": round(self.needed_ul, 3),
            "fillings_hold_ul": round(self.loaded_ul, 3),
        }


def bore_ul(needle: Needle) -> float:
    """What the needle's bore holds, µL: π d² L / 4."""
    return math.pi / 4 * needle.inner_mm**2 * needle.length_mm


def ink_use(
    run: DryRun,
    printer: Printer,
    syringe: Syringe,
    needle: Needle | None = None,
    flow_ul_s: float | None = None,
    reloads: int = 0,
) -> InkUse:
    """Ink of a dry run.

    Parameters
    ----------
    run : DryRun
    printer, syringe : Printer, Syringe
    needle : Needle or None
        Its bore is added to the dead volume where it is known.
    flow_ul_s : float or None, µL/s
        Of a pneumatic head.
    reloads : int
        Planned changes of syringe; there are at least as many as the ink asks for.
    """
    area = syringe.area_mm2
    pushed, reach = run.plunger_max_mm * area, math.inf
    if printer.plunger_travel_mm is not None:
        reach = printer.plunger_travel_mm * area
    if printer.pneumatic is not None and run.valve is not None and flow_ul_s is not None:
        pushed = flow_ul_s * flowing_s(run.executed, run.program, run.valve, printer.pneumatic)
    dead = syringe.dead_volume_ul + (0.0 if needle is None else bore_ul(needle))
    holds = min(max(syringe.volume_ul - dead, 0.0), reach)
    asked = math.ceil(pushed / holds - 1e-9) if holds > 0 else 1
    return InkUse(pushed, dead, holds, max(asked, reloads + 1, 1))
