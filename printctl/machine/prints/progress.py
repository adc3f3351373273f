"""Progress of a print: time, layer, vessel and ink, by its job's dry run and its journal.

Remaining time is the simulated time, corrected by the time taken so far. What is printed is cut
into stretches of equal time in the dry run, at the journal's checkpoints. Of each the ratio of real
to predicted time is kept, pauses left out; what remains is taken to go on like their mean. Were the
stretches' ratios independent, of standard deviation s over n stretches, the time of the m
stretches still to come would be known to c s sqrt(m + m²/n), c being a stretch's time: the spread
of those m, and that of the mean. Twice that is the error reported (about 95 of 100).
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, NamedTuple

from design.files import atomic_replacement
from printctl.machine.job.job import Insert, file_count
from printctl.machine.job.marks import Position
from printctl.machine.job.syringes import Filling
from printctl.machine.prints.mends import pushed_mm
from printctl.machine.records.replay import JournalledPrint
from printctl.machine.records.states import Status

if TYPE_CHECKING:
    from kernels.arrays import FloatArray, IntArray

NONE: Final = -1
"""In a table: no layer or vessel."""
_STRETCHES: Final = 100
"""Of a whole print; a stretch lasts two seconds at least, in the dry run's time."""
_MIN_STRETCH_S: Final = 2.0
_MIN_STRETCHES: Final = 3
"""Before the dry run's own time is corrected."""


@dataclass(frozen=True, eq=False)
class JobTable:
    """How things stand when k commands of the job's file have been executed, in row k.

    Attributes
    ----------
    time_s : (n + 1,) float64, s
        Of the dry run; waits for heat count as nothing.
    ink_ul : (n + 1,) float64, µL
        Written so far, by all heads.
    plunger_mm : (n + 1,) float64, mm
        Travel of the plunger since the start, new syringes not counted.
    file_line : (n + 1,) int64
        Of the last command executed; 0 before the first.
    layer, vessel : (n + 1,) int64
        Which is being written, from 0; `NONE` for none. Of a job without levels a layer is a pass.
    layers_done, vessels_done : (n + 1,) int64
        How many have nothing left to be written.
    tip_mm : (n + 1, 3) float64, mm
        Where the tip stands, as the firmware counts.
    layer_count, vessel_count : () int64
    passes : () bool
        Whether layers are passes.
    """

    time_s: FloatArray
    ink_ul: FloatArray
    plunger_mm: FloatArray
    file_line: IntArray
    layer: IntArray
    vessel: IntArray
    layers_done: IntArray
    vessels_done: IntArray
    tip_mm: FloatArray
    layer_count: int = 0
    vessel_count: int = 0
    passes: bool = False

    def __len__(self) -> int:
        """Commands of the job."""
        return len(self.time_s) - 1

    def save(self, path: Path) -> None:
        """Write it as ``.npz``."""
        import numpy as np

        with atomic_replacement(path) as draft:
            np.savez(draft, **{one.name: getattr(self, one.name) for one in fields(self)})

    @staticmethod
    def load(path: Path) -> JobTable:
        """Read what `save` wrote."""
        import numpy as np  # most prints have no table, and their status needs none of it

        with np.load(path, allow_pickle=False) as arrays_file:
            rows = {one.name: arrays_file[one.name] for one in fields(JobTable)}
        return JobTable(**{k: row if row.ndim else row.item() for k, row in rows.items()})


class Supply(NamedTuple):
    """Syringe with which a print of one head began, and its ink per travel, µL/mm."""

    filling: Filling
    ul_per_mm: float


class Estimate(NamedTuple):
    """Remaining time, and twice its standard deviation, s; None while too little is printed.

    ``ratio`` is the real time over the dry run's, so far.
    """

    remaining_s: float
    error_s: float | None
    ratio: float


@dataclass(frozen=True)
class Progress:
    """How far a print has come.

    Attributes
    ----------
    commands, commands_total : int
        Executed, and in the job.
    share : float
        Of the dry run's time, 0 to 1; that is ``predicted_s``.
    active_s : float, s
        Real time so far, pauses left out.
    remaining_s, remaining_error_s, ratio
        As `Estimate`.
    ends_at : float
        Wall-clock time, s since 1970, if nothing holds the print any more.
    layer, layers, layers_done : int
        Layer being written, from 1 (0 for none), how many there are, how many are whole; so of
        vessels.
    passes : bool
        Whether these are passes of an embedded print.
    ink_left_ul : float or None, µL
        In the syringe, but for its dead volume; None where that is unknown.
    tip_mm : (x, y, z), mm
        Where the executed lines lead; a pause or a stop has raised the tip from there.
    speed_mm_s, flow_ul_s : float or None, mm/s and µL/s
        Of the next command by the dry run, averaged over it; None once the print has ended.
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
    speed_mm_s: float | None = None
    flow_ul_s: float | None = None

    def to_dict(self) -> dict[str, Any]:
        """As a JSON object."""
        return asdict(self)


def progress(
    table: JobTable, status: Status, journal: JournalledPrint, now: float, supply: Supply | None
) -> Progress:
    """Compute how far a print has come at ``now`` (s since 1970).

    All that status tells of counts the grown job's lines, a table's rows the file's commands.
    """
    executed = status.lines_executed
    k = _row(table, file_count(executed, status.inserted))
    total_s, done_s = float(table.time_s[-1]), float(table.time_s[k])
    active_s = journal.active_until(journal.last_at if status.ended else now)
    paces = [
        (float(table.time_s[_row(table, file_count(done, journal.positions))]), pace_s, stretch)
        for done, pace_s, stretch in journal.paces
    ]
    estimate = remaining_time(total_s, paces, done_s)
    x, y, z = table.tip_mm[k].tolist()
    speed_mm_s, flow_ul_s = (None, None) if status.ended else _rates(table, k)
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
        ink_left_ul=ink_left_ul(table, journal, executed, supply),
        tip_mm=(x, y, z),
        speed_mm_s=speed_mm_s,
        flow_ul_s=flow_ul_s,
    )


def _rates(table: JobTable, k: int) -> tuple[float | None, float | None]:
    """Return speed, mm/s, and flow, µL/s, of the command after the first ``k``."""
    if k >= len(table) or (seconds := float(table.time_s[k + 1] - table.time_s[k])) <= 0:
        return None, None
    way_mm = math.dist(table.tip_mm[k].tolist(), table.tip_mm[k + 1].tolist())
    return way_mm / seconds, float(table.ink_ul[k + 1] - table.ink_ul[k]) / seconds


def _row(table: JobTable, commands: int) -> int:
    return min(max(commands, 0), len(table))


def remaining_time(
    total_s: float, paces: Iterable[tuple[float, float, int]], predicted_s: float
) -> Estimate:
    """Estimate what is left of a print.

    ``total_s`` is the dry run's time of the whole, ``predicted_s`` of what has been executed now;
    ``paces`` are points that the print has come to: the dry run's time, the real time without
    pauses, s, and the number of the stretch without a pause: nothing is compared across two.
    """
    ratios: list[float] = []
    printed = took = 0.0
    begin = last = None
    for here in paces:
        if begin is None or last is None or here[2] != begin[2]:
            begin = last = here
        elif here[0] >= last[0] and here[1] >= last[1]:  # else a line was taken back
            last = here
            length = here[0] - begin[0]
            if length >= max(total_s / _STRETCHES, _MIN_STRETCH_S):
                ratios.append((here[1] - begin[1]) / length)
                printed, took = printed + length, took + here[1] - begin[1]
                begin = here
    left, count = max(total_s - predicted_s, 0.0), len(ratios)
    if count < _MIN_STRETCHES:
        return Estimate(left, None, 1.0)
    ratio = took / printed
    mean = math.fsum(ratios) / count
    spread = math.sqrt(math.fsum((one - mean) ** 2 for one in ratios) / (count - 1))
    each = printed / count
    ahead = left / each
    error = 2.0 * each * spread * math.sqrt(ahead + ahead * ahead / count)
    return Estimate(left * ratio, error, ratio)


def ink_left_ul(
    table: JobTable, journal: JournalledPrint, executed: int, supply: Supply | None
) -> float | None:
    """Return the ink left in the syringe when so many lines are made, µL; None where unknown."""
    if supply is None:
        return None
    filling = journal.last_filling or supply.filling
    capacity_mm = filling.capacity_mm or supply.filling.capacity_mm
    places = min(filling.done, executed), executed
    begin, end = (_plunger_mm(table, journal.inserts, k, supply.ul_per_mm) for k in places)
    if math.isinf(capacity_mm):
        return None
    return max(capacity_mm - filling.used_mm - (end - begin), 0.0) * supply.ul_per_mm


def _plunger_mm(table: JobTable, inserts: Sequence[Insert], done: int, ul_per_mm: float) -> float:
    """Return the plunger's travel after so many lines of the grown job, mm.

    What the job writes behind an insert pushes ``flow`` times what its file says.
    """
    here = _row(table, file_count(done, [(one.after, len(one.lines)) for one in inserts]))
    extra_ul, positions = 0.0, list[Position]()
    for one, following in zip(inserts, [*inserts[1:], None], strict=False):
        begin = _row(table, file_count(one.after, positions))
        positions.append((one.after, len(one.lines)))
        end = here if following is None else _row(table, file_count(following.after, positions))
        written_ul = float(table.ink_ul[min(end, here)] - table.ink_ul[min(begin, here)])
        extra_ul += (one.flow - 1.0) * written_ul
    return float(table.plunger_mm[here]) + extra_ul / ul_per_mm + pushed_mm(inserts, done)
