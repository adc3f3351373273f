"""Checks of a job's ink: volume needed, temperatures, lifetime of the cells."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from firmware_profiles import Bath, Ink, Needle, Printer, ProfileError, Syringe, steady_flow
from gcode.dry_run.run import DryRun
from gcode.heads import flowing_s
from gcode.program.modal import MOVE
from kernels.arrays import FloatArray
from printctl.checks.gate import UNNAMED_C
from printctl.checks.kinds import Kind
from printctl.checks.set_up import Budget, Check, HeadLoading, finding


def volumes(run: DryRun, printer: Printer, loads: Sequence[HeadLoading]) -> FloatArray:
    """Ink pushed out by each row of the program, of the head in use, (rows,), µL.

    Of a pneumatic head whose needle is unknown, at whose flow one can only guess, the ink's lines
    have no thickness.
    """
    program = run.program
    if not printer.airs:
        bore = [np.pi / 4 * one.syringe.inner_mm**2 * one.ink.flow_factor for one in loads]
        return np.asarray(program.pushed * np.array(bore)[program.tool])
    flow = np.array(
        [
            steady_flow(head, one.ink, one.needle).ul_s if one.needle else 0.0
            for head, one in zip(printer.airs, loads, strict=False)
        ]
    )
    ends = np.vstack([program.start[None, :3], program.target[:, :3]])
    length = np.linalg.norm(np.diff(ends, axis=0), axis=1)
    lasts = np.divide(length, program.feed, out=np.zeros(len(length)), where=program.feed > 0)
    return np.where(run.doses & (program.kind == MOVE), flow[program.tool] * lasts, 0.0)


def written_ul(run: DryRun, printer: Printer, loads: Sequence[HeadLoading]) -> float:
    """What comes out of all heads in the whole run, µL; nothing where the pressure moves no ink."""
    try:
        return float(volumes(run, printer, loads).sum())
    except ProfileError:  # said by a check of its own
        return 0.0


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


_INK: Final = "temperature_c"


def temperature_checks(run: DryRun, ink: Ink, bath: Bath | None) -> list[Check]:
    """Check every set temperature against the limits of ink and bath; 0 switches off."""
    span = ink.temperature_c
    bears = f"maximum for {ink.name} (ink: {_INK})"
    unnamed = "maximum for cells, as no bath is specified; specify it (--bath) if it tolerates more"
    warmest = (
        (UNNAMED_C, unnamed)
        if bath is None
        else (bath.max_printing_c, f"maximum for {bath.name} (bath: max_printing_c)")
    )
    return [
        _setting(run, "ink", "highest", span.high, bears),
        _setting(run, "ink", "lowest", span.low, f"minimum for {ink.name} (ink: {_INK})"),
        _setting(run, "bath", "highest", *warmest),
    ]


def _setting(run: DryRun, part: str, which: str, limit: float, bears: str) -> Check:
    """The warmest or coldest setting of one part against its limit."""
    sign, bounds = (1, ("is", "least")) if which == "highest" else (-1, ("is", "most"))
    those = [
        heat
        for heat in run.heats
        if heat.part in (part, "both") and heat.celsius != 0 and heat.bound in bounds
    ]
    worst = max(those, key=lambda heat: sign * heat.celsius, default=None)
    return Check(
        Kind.INK_TEMPERATURE if part == "ink" else Kind.BATH_TEMPERATURE,
        f"{which} {part} temperature",
        limit if worst is None else worst.celsius,
        limit,
        "°C",
        worst is None or sign * worst.celsius <= sign * limit,
        "not set by the job" if worst is None else f"line {worst.line}",
        f"{bears}; {'lower' if sign > 0 else 'raise'} the setting in the job",
    )


@dataclass(frozen=True)
class PrintTime:
    """Print time of a job, with its syringe changes.

    The dry run's time runs from the first byte to the last; mixing and filling before it, and what
    the cells bear in the bath afterwards, aren't in it. How long cells have is never guessed: the
    ink's profile or the recipe says it, with a source, or it is told as unknown.

    Attributes
    ----------
    duration_s : float, s
        Of the dry run.
    reloads : int
        Changes of syringe.
    reload_min : float or None, min
        Of each; None where nobody said it.
    """

    duration_s: float
    reloads: int = 0
    reload_min: float | None = None

    @property
    def minutes(self) -> float:
        """With the changes, as far as their time is known."""
        return self.duration_s / 60 + self.reloads * (self.reload_min or 0.0)

    @property
    def lacks_reloads(self) -> bool:
        """Whether changes of unknown length are to be added."""
        return self.reloads > 0 and self.reload_min is None


def viability_checks(time: PrintTime, budget: Budget | None) -> list[Check]:
    """Print time within the budget; none where no budget is known."""
    if budget is None:
        return []
    changes = f" with {time.reloads} syringe changes" if time.reloads else ""
    checks = [
        Check(
            Kind.VIABILITY,
            f"print time{changes} vs. cell viability limit",
            time.minutes,
            budget.minutes,
            "min",
            time.minutes <= budget.minutes,
            f"{budget.key} ({budget.source})",
            "cells in the syringe would lose viability; print a smaller part, or faster with a "
            "wider needle and thicker layers, or mix the ink later",
            "refuses" if budget.refuses else "warns",
        )
    ]
    if time.lacks_reloads:
        checks.append(
            finding(
                Kind.RELOAD_TIME,
                "duration of syringe changes",
                "printer.care.reload_min",
                f"not set, so the print time excludes {time.reloads} syringe changes; specify how "
                "long one takes",
                "warns",
            )
        )
    return checks


def viability_facts(time: PrintTime, budget: Budget | None) -> dict[str, Any]:
    """For the report: the time and what it is held against, or that nobody knows."""
    available = (
        "not set, neither by the ink (viability_min) nor by the recipe"
        if budget is None
        else f"{budget.minutes:g} min ({budget.source})"
    )
    return {
        "print_time_s": 60 * time.minutes,
        "changes_of_syringe": time.reloads,
        "time_the_cells_have": available,
        **({"changes_timed": False} if time.lacks_reloads else {}),
    }
