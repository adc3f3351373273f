"""Tip motion of every needle by G-code row, and the rows that write, from a dry run."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from gcode.clearance.arrays import Ink, Tips
from gcode.clearance.network import WrittenNetwork
from gcode.dry_run.run import DryRun
from gcode.errors import ClearanceError
from gcode.motion.executed import window_sums
from gcode.program.modal import MOVE
from kernels.arrays import FloatArray, IntArray, split_rows

NONE = -1


@dataclass(frozen=True)
class LineSources:
    """What a job's map says of its lines.

    Attributes
    ----------
    vessel : (lines,) int64
        Which vessel each line is for; -1 for none.
    writes : (lines,) bool or None
        Whether a line is there to write; None where the map doesn't say, so that the ink tells.
    """

    vessel: IntArray
    writes: NDArray[np.bool_] | None = None


_ROUNDING_MM: Final = 1e-9


@dataclass(frozen=True)
class NeedleMotion:
    """Rows in the order of time, in the printer's frame.

    Attributes
    ----------
    tips : (heads, n, 2, 3) float64, mm
        Each head's tip before and after each row; a raised one where it stands raised.
    tool : (n,) int64
        The head in use.
    line : (n,) int64
        Of the file, from 1.
    volume_ul : (n,) float64, µL
        What comes out of the head in use.
    writes : (n,) bool
        Whether the row is of a pass: the tip moves and writes.
    vessel : (n,) int64
        What the row is for; -1 for none.
    """

    tips: FloatArray
    tool: IntArray
    line: IntArray
    volume_ul: FloatArray
    writes: NDArray[np.bool_]
    vessel: IntArray

    @property
    def length_mm(self) -> FloatArray:
        """Way of the carriage, or of a head with a longer way, in each row, (n,), mm."""
        way = np.linalg.norm(self.tips[:, :, 1] - self.tips[:, :, 0], axis=2)
        longest = way.max(axis=0)
        return np.where(longest - way[0] > _ROUNDING_MM, longest, way[0])


def motion_of(run: DryRun, sources: LineSources, volume_ul: FloatArray) -> NeedleMotion:
    """What a file's needles do, as the simulator's reader executes it.

    Places are those of the text; a printer's lie within half a motor step of them. A line for
    writing without ink (a coast at a pass's end) is of its pass, but leaves nothing.

    Parameters
    ----------
    volume_ul : (rows,) float64, µL
        What comes out of the head in use in each row of the program.

    Raises
    ------
    ClearanceError
        When the map is of another file.
    """
    program = run.program
    if len(program) and int(program.line.max()) > len(sources.vessel):
        raise ClearanceError(
            f"the map is of {len(sources.vessel)} lines, and the G-code has "
            f"{int(program.line.max())}: it belongs to another file; write both anew"
        )
    tips = np.stack([run.heads.tips(program, k) for k in range(len(run.heads.lift_mm))])
    moves = program.kind == MOVE
    moved = moves & (np.abs(tips[:, :, 1] - tips[:, :, 0]).max(axis=(0, 2), initial=0.0) > 0)
    flows = moved & (volume_ul > 0)
    writes = flows
    if sources.writes is not None:
        writes = moved & (sources.writes[program.line - 1] | flows)
    vessel = sources.vessel[program.line - 1].astype(np.int64)
    return NeedleMotion(
        tips, program.tool, program.line, np.where(moved, volume_ul, 0.0), writes, vessel
    )


PIECE_MM: Final = 0.5
"""No piece is longer, so that squares of the plan may be small."""


@dataclass(frozen=True)
class Pieces:
    """Rows cut up, the same for all heads.

    Attributes
    ----------
    row : (k,) int64
    low, high : (k,) float64
        Shares of the row at which the piece begins and ends.
    """

    row: IntArray
    low: FloatArray
    high: FloatArray

    @staticmethod
    def of(length_mm: FloatArray) -> Pieces:
        """Cut rows of such lengths; one that stands is one piece."""
        count = np.maximum(np.ceil(length_mm / PIECE_MM), 1).astype(np.int64)
        row, number = split_rows(count)
        return Pieces(row, number / count[row], (number + 1) / count[row])

    def of_rows(self, chosen: IntArray) -> Pieces:
        """Some of them, by their numbers."""
        return Pieces(self.row[chosen], self.low[chosen], self.high[chosen])

    def places(self, tips: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Both ends of each piece, (k, 3) mm, of rows' tips (n, 2, 3)."""
        start, step = tips[self.row, 0], (tips[:, 1] - tips[:, 0])[self.row]
        return start + self.low[:, None] * step, start + self.high[:, None] * step

    def values(self, pair: FloatArray) -> FloatArray:
        """A value at rows' ends, (n, 2), at both ends of each piece; inf stays inf."""
        known = np.isfinite(pair[:, 0]) & np.isfinite(pair[:, 1])
        low, high = np.where(known[:, None], pair, 0.0)[self.row].T
        values = np.column_stack([low + self.low * (high - low), low + self.high * (high - low)])
        values[~known[self.row]] = np.inf
        return values


@dataclass(frozen=True)
class Passes:
    """Of each row of one head.

    Attributes
    ----------
    run : (n,) int64
        Pass that the row writes, or the last one before it; -1 for none.
    arc : (n, 2) float64, mm
        Path before the row's two ends since the pass began, and on from its end.
    last, next : (n,) int64
        Last written row at or before, and first at or after; -1 for none.
    since : (n, 2) float64, mm
        Way from the last pass's end to both ends of the row; 0 in a pass, inf before the first.
    until : (n, 2) float64, mm
        From both ends to the next pass's start; 0 in a pass, inf behind the last.
    """

    run: IntArray
    arc: FloatArray
    last: IntArray
    next: IntArray
    since: FloatArray
    until: FloatArray


def passes_of(tips: FloatArray, writes: NDArray[np.bool_]) -> Passes:
    """Find a head's passes: rows that write, with no motion between them that doesn't.

    A rise out of a pass's end and a descent to a start count by what they go in the plan alone: a
    needle that rises stands in the same ink as before.

    Parameters
    ----------
    tips : (n, 2, 3) float64, mm
        Before and after each row.
    writes : (n,) bool
    """
    step = tips[:, 1] - tips[:, 0]
    length = np.linalg.norm(step, axis=1)
    flat = np.hypot(step[:, 0], step[:, 1])
    rows = np.arange(len(tips))
    travels = ~writes & (length > 0)
    last = np.maximum.accumulate(np.where(writes, rows, -1)) if len(rows) else rows
    following = np.where(writes, rows, len(rows))
    following = np.minimum.accumulate(following[::-1])[::-1] if len(rows) else rows
    before = np.concatenate([[0], np.cumsum(travels)[:-1]])[: len(rows)]
    begins = writes.copy()
    previous = np.concatenate([[-1], last[:-1]])[: len(rows)]
    begins &= (previous < 0) | (before > before[np.maximum(previous, 0)])
    run = np.cumsum(begins) - 1
    written = np.concatenate([[0.0], np.cumsum(np.where(writes, length, 0.0))])
    begin = np.flatnonzero(begins)
    base = written[begin][np.maximum(run, 0)] if len(begin) else np.zeros(len(rows))
    away = np.where(writes, 0.0, np.where(step[:, 2] >= 0, flat, length))
    back = np.where(writes, 0.0, np.where(step[:, 2] <= 0, flat, length))
    since = _since(away, last)
    until = _since(back[::-1], np.where(following < len(rows), len(rows) - 1 - following, -1)[::-1])
    arc = np.column_stack([written[:-1] - base, written[1:] - base])
    left = np.where(np.isfinite(since), since, 0.0)
    return Passes(
        run,
        arc + left,
        last,
        np.where(following < len(rows), following, -1),
        since,
        until[::-1, ::-1],
    )


def _since(cost: FloatArray, last: IntArray) -> FloatArray:
    """Cost gathered since the last written row before each row's two ends; inf without one."""
    whole = np.concatenate([[0.0], np.cumsum(cost)])
    base = whole[np.maximum(last, 0) + 1] if len(last) else whole[1:]
    costs = np.column_stack([whole[:-1] - base, whole[1:] - base])
    costs[last < 0] = np.inf
    return np.maximum(costs, 0.0)


WRITE, TRAVEL, LIFT, DESCENT, HEAD_CHANGE = range(5)
KINDS: Final = ("write", "travel", "lift", "descent", "head change")


@dataclass(frozen=True)
class Head:
    """Rows of one head.

    Attributes
    ----------
    tips : (n, 2, 3) float64, mm
    along : (n, 2) float64, mm
        Of a written row's ends, along its vessel.
    """

    tips: FloatArray
    passes: Passes
    along: FloatArray


def heads_of(motion: NeedleMotion, network: WrittenNetwork) -> list[Head]:
    """Passes of every head, and where along its vessel each written row lies."""
    heads = []
    for k, tips in enumerate(motion.tips):
        writes = motion.writes & (motion.tool == k)
        along = np.zeros((len(tips), 2))
        rows = np.flatnonzero(writes)
        along[rows] = network.spans(motion.vessel[rows], tips[rows, 0], tips[rows, 1])[0]
        heads.append(Head(tips, passes_of(tips, writes), along))
    return heads


def kinds_of(tips: FloatArray, writes: NDArray[np.bool_]) -> IntArray:
    """What one head's rows are, (n,): indices of `KINDS`."""
    step = tips[:, 1] - tips[:, 0]
    upright = np.hypot(step[:, 0], step[:, 1]) < 1e-6
    kind = np.full(len(tips), TRAVEL)
    kind[upright & (step[:, 2] > 0)] = LIFT
    kind[upright & (step[:, 2] < 0)] = DESCENT
    kind[(step == 0).all(axis=1)] = HEAD_CHANGE
    kind[writes] = WRITE
    return kind


def tips_of(
    motion: NeedleMotion, heads: list[Head], pieces: Pieces, radius: FloatArray
) -> tuple[Tips, IntArray, IntArray]:
    """Every head's motion, with the rows and heads that its moves are of.

    Returns
    -------
    Tips
    row, head : (moves,) int64
    """
    parts, rows, numbers = [], [], []
    runs = moves = 0
    for k, head in enumerate(heads):
        kept = _kept(head.tips)
        chosen = np.flatnonzero(kept[pieces.row])
        parts.append(_fields(motion, k, head, pieces.of_rows(chosen), radius))
        move = np.cumsum(kept) - 1 + moves
        parts[-1] |= {"move": move[pieces.row[chosen]], "when": chosen}
        parts[-1]["run"][parts[-1]["run"] >= 0] += runs
        rows.append(np.flatnonzero(kept))
        numbers.append(np.full(len(rows[-1]), k))
        runs += int(head.passes.run.max(initial=-1)) + 1
        moves += len(rows[-1])
    columns = ([part[name] for part in parts] for name in Tips._fields)
    tips = Tips(*(np.ascontiguousarray(np.concatenate(column)) for column in columns))
    return tips, np.concatenate(rows), np.concatenate(numbers)


def _fields(
    motion: NeedleMotion, k: int, head: Head, part: Pieces, radius: FloatArray
) -> dict[str, NDArray[Any]]:
    """Of `Tips`, what one head alone says."""
    row, passes = part.row, head.passes
    start, end = part.places(head.tips)
    vessel, thick, along = _roles(motion, head, radius)
    along_of = np.repeat(along[row][:, :, None], 2, axis=2)
    written = (motion.writes & (motion.tool == k))[row]
    along_of[written, 0] = part.values(head.along)[written]
    return {
        "start": start,
        "end": end,
        "needle": np.full(len(row), k),
        "run": passes.run[row],
        "arc": part.values(passes.arc),
        "vessel": vessel[row],
        "radius": thick[row],
        "along": along_of,
        "since": np.stack([part.values(passes.since), part.values(passes.until)], axis=1),
    }


def _kept(tips: FloatArray) -> NDArray[np.bool_]:
    """Rows in which a tip moves, or stands elsewhere than before: a head that was lowered."""
    if not len(tips):
        return np.zeros(0, np.bool_)
    jumped = np.append(True, np.abs(tips[1:, 0] - tips[:-1, 1]).max(axis=1) > 0)
    return np.asarray(jumped | (np.abs(tips[:, 1] - tips[:, 0]).max(axis=1) > 0))


def _roles(
    motion: NeedleMotion, head: Head, radius: FloatArray
) -> tuple[IntArray, FloatArray, FloatArray]:
    """Vessel, filament's radius and place along it, (n, 2) each: left (or written), and gone to."""
    last, following = head.passes.last, head.passes.next
    written = (last >= 0) & (last == following)
    following = np.where(written, NONE, following)
    vessel = np.column_stack(
        [np.where(rows >= 0, motion.vessel[rows], NONE) for rows in (last, following)]
    )
    thick = np.column_stack([radius[last], radius[following]])
    along = np.column_stack([head.along[last, 1], head.along[following, 0]])
    return vessel, thick, along


WINDOW_MM: Final = 0.5
"""Volume over length is taken over at least so much of a pass: E's digits are coarse in a short
move."""


def ink_of(
    motion: NeedleMotion, network: WrittenNetwork, heads: list[Head], pieces: Pieces
) -> tuple[Ink, FloatArray]:
    """Return the written ink as filaments, and the radius that each row writes, (n,), mm.

    The network says how a vessel tapers, r_n(x), and the plunger how thick it is: r = r_n sqrt(V /
    V_n), V being pushed over `WINDOW_MM` of its pass, and V_n what the network has there.
    """
    chosen = np.flatnonzero(motion.writes[pieces.row])
    row = pieces.row[chosen]
    part = pieces.of_rows(chosen)
    start, end, run, arc = _written(motion, heads, part)
    vessel = motion.vessel[row]
    along, design = network.spans(vessel, start, end)
    share = _share(motion, part, run, vessel, design)
    radius = design * np.sqrt(share)[:, None]
    of_row = np.zeros(len(motion.line))
    np.maximum.at(of_row, row, radius.max(axis=1, initial=0.0))
    ink = Ink(start, end, radius, chosen.astype(np.int64), run, vessel, arc, along)
    left = np.flatnonzero(share > 0)
    columns: list[Any] = [column[left] for column in ink]
    return Ink(*columns), of_row


def _written(
    motion: NeedleMotion, heads: list[Head], part: Pieces
) -> tuple[FloatArray, FloatArray, IntArray, FloatArray]:
    """Ends of written pieces, the passes that they are of, and the way written in them before."""
    row = part.row
    start, end = np.zeros((len(row), 3)), np.zeros((len(row), 3))
    run, arc = np.zeros(len(row), np.int64), np.zeros((len(row), 2))
    begun = 0
    for k, head in enumerate(heads):
        own = motion.tool[row] == k
        a, b = part.places(head.tips)
        start[own], end[own] = a[own], b[own]
        run[own] = head.passes.run[row[own]] + begun
        arc[own] = part.values(head.passes.arc)[own]
        begun += int(head.passes.run.max(initial=-1)) + 1
    return start, end, run, arc


def _share(
    motion: NeedleMotion, part: Pieces, run: IntArray, vessel: IntArray, design: FloatArray
) -> FloatArray:
    """What is pushed, by what the network has there, (k,), over a window that stays in its pass."""
    length = (part.high - part.low) * motion.length_mm[part.row]
    volume = (part.high - part.low) * motion.volume_ul[part.row]
    r0, r1 = design.T
    meant = np.pi / 3 * length * (r0**2 + r0 * r1 + r1**2)
    changes = np.append(True, (np.diff(run) != 0) | (np.diff(vessel < 0) != 0))[: len(run)]
    (taken, known), _ = window_sums(np.cumsum(changes), length, WINDOW_MM, volume, meant)
    return np.asarray(np.maximum(taken, 0.0) / np.maximum(known, 1e-12))
