"""Compute a print's progress (time, layer, vessel, ink) from the commands executed so far."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any

from printctl.machine.prints.remaining import Estimate

if TYPE_CHECKING:
    from printctl.machine.prints.job_table import JobTable


@dataclass(frozen=True)
class Filling:
    """Ink left in the syringe in use.

    Attributes
    ----------
    command : int
        Commands executed when it was put in.
    left_mm : float or None, mm
        Plunger travel it had then; None where nobody knows.
    ul_per_mm : float, µL/mm
    """

    command: int
    left_mm: float | None
    ul_per_mm: float


@dataclass(frozen=True)
class Progress:
    """How far a print has come.

    Attributes
    ----------
    commands, commands_total : int
        Executed, and in the job.
    file_line : int
    share : float
        Of the dry run's time, 0 to 1.
    predicted_s, predicted_total_s : float, s
    active_s : float, s
        Real time so far, pauses left out.
    remaining_s : float, s
    remaining_error_s : float or None, s
    ratio : float
        Real time over the dry run's.
    ends_at : float
        Wall-clock time, s since 1970, if nothing holds the print any more.
    layer, layers, layers_done : int
        Layer being written, from 1 (0 for none), how many there are, how many are whole.
    passes : bool
        Whether these are passes of an embedded print.
    vessel, vessels, vessels_done : int
    ink_ul, ink_total_ul : float, µL
    ink_left_ul : float or None, µL
        In the syringe, but for its dead volume; None where nobody knows.
    tip_mm : (x, y, z), mm
        Where the executed lines lead; a pause or a stop has raised the tip from there.
    """

    commands: int
    commands_total: int
    file_line: int
    share: float
    predicted_s: float
    predicted_total_s: float
    active_s: float
    remaining_s: float
    remaining_error_s: float | None
    ratio: float
    ends_at: float
    layer: int
    layers: int
    layers_done: int
    passes: bool
    vessel: int
    vessels: int
    vessels_done: int
    ink_ul: float
    ink_total_ul: float
    ink_left_ul: float | None
    tip_mm: tuple[float, float, float]

    def to_dict(self) -> dict[str, Any]:
        """As a JSON object."""
        return asdict(self)


def predicted_s(table: JobTable, executed: int) -> float:
    """The dry run's time of so many commands, s."""
    return float(table.time_s[min(max(executed, 0), len(table))])


def progress(
    table: JobTable,
    executed: int,
    active_s: float,
    now: float,
    estimate: Estimate,
    filling: Filling | None = None,
) -> Progress:
    """Tell how far a print has come.

    Parameters
    ----------
    table : JobTable
    executed : int
        Commands of the job whose motion has been made.
    active_s : float, s
        Real time so far, pauses left out.
    now : float
        Wall-clock time, s since 1970.
    estimate : Estimate
    filling : Filling, optional
    """
    k = min(max(executed, 0), len(table))
    total_s = float(table.time_s[-1])
    done_s = float(table.time_s[k])
    return Progress(
        commands=k,
        commands_total=len(table),
        file_line=int(table.file_line[k]),
        share=done_s / total_s if total_s > 0 else float(k == len(table)),
        predicted_s=done_s,
        predicted_total_s=total_s,
        active_s=active_s,
        remaining_s=estimate.remaining_s,
        remaining_error_s=estimate.error_s,
        ratio=estimate.ratio,
        ends_at=now + estimate.remaining_s,
        layer=int(table.layer[k]) + 1,
        layers=int(table.layer_count),
        layers_done=int(table.layers_done[k]),
        passes=bool(table.passes),
        vessel=int(table.vessel[k]) + 1,
        vessels=int(table.vessel_count),
        vessels_done=int(table.vessels_done[k]),
        ink_ul=float(table.ink_ul[k]),
        ink_total_ul=float(table.ink_ul[-1]),
        ink_left_ul=ink_left_ul(table, k, filling),
        tip_mm=_tip(table, k),
    )


def _tip(table: JobTable, executed: int) -> tuple[float, float, float]:
    x, y, z = table.tip_mm[executed].tolist()
    return x, y, z


def ink_left_ul(table: JobTable, executed: int, filling: Filling | None) -> float | None:
    """What the syringe in use still holds, µL; None where nobody knows."""
    if filling is None or filling.left_mm is None or math.isinf(filling.left_mm):
        return None
    start = min(max(filling.command, 0), len(table))
    used = float(table.plunger_mm[executed] - table.plunger_mm[start])
    return max(filling.left_mm - used, 0.0) * filling.ul_per_mm
