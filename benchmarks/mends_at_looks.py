"""Mends of a print at its looks: breaks planted in an embedded job, each mended where first seen.

The job is gone through look by look (`every: vessel`: ends of passes, and marks within them). What
was written since the last look is seen, mended at once, and the insert stays in the job for what
follows. `checkers.mended_ink` judges each insert. Parts of breaks that are shorter than the
observer's tolerance aren't seen.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from benchmarks.checkers.mended_ink import (
    Case,
    Judged,
    Stroke,
    judge_all,
    lengths,
    place_on,
    strokes_of,
)
from benchmarks.checkers.read_gcode import Moves, read_moves
from firmware_profiles import Ink, Needle, Printer, Syringe
from printctl.machine.link.job import Job
from printctl.machine.link.marks import MarkKind
from printctl.observe.mending import HeldPrint, Voids, gap_between, plan_mend, written_paths

Span = tuple[float, float]
SEEN_MM = 0.2
"""Shorter gaps are let pass (`observe: tolerance: gap_mm`)."""
APART_MM = 1.0
"""Between breaks of one stroke."""


@dataclass
class Break:
    """A planted break: the stroke, where along it, how much of it was covered, mm."""

    stroke: Stroke
    span: Span
    covered_mm: float = 0.0

    @property
    def share(self) -> float:
        """Of its length that was covered, from 0 to 1."""
        return self.covered_mm / (self.span[1] - self.span[0])


@dataclass(frozen=True)
class ObservedPrint:
    """A job, what is mounted, and the printer's place before it."""

    job: Job
    printer: Printer
    syringe: Syringe
    ink: Ink
    needle: Needle

    def held(self, lines: Sequence[bytes], done: int) -> HeldPrint:
        """The job, grown by inserts, held after so many lines."""
        return HeldPrint(lines, done, self.printer, self.syringe, self.ink, self.needle, "embedded")

    def looks(self, *, within: bool) -> list[int]:
        """Lines before each look; with those within vessels or without."""
        kinds = (MarkKind.VESSEL, MarkKind.PART) if within else (MarkKind.VESSEL,)
        return sorted({mark.index for kind in kinds for mark in self.job.marks.of(kind)})


def planted(
    moves: Moves,
    count: int,
    rng: np.random.Generator,
    gap: Callable[[Sequence[Stroke], np.random.Generator], tuple[Stroke, float, float]],
) -> list[Break]:
    """So many breaks at random, `APART_MM` apart."""
    strokes, found = strokes_of(moves), list[Break]()
    while len(found) < count:
        stroke, low, high = gap(strokes, rng)
        own = [one.span for one in found if one.stroke is stroke]
        if all(high + APART_MM < a or low > b + APART_MM for a, b in own):
            found.append(Break(stroke, (low, high)))
    return found


def mended_at_looks(
    seen: ObservedPrint, breaks: Sequence[Break], looks: Sequence[int], edge_mm: float
) -> list[Judged]:
    """Print, look, and mend; tell each break what was covered. What each mend did, a row a gap."""
    lines, done_moves, judged = list(seen.job.lines), 0, list[Judged]()
    grown, grown_moves = 0, 0
    for index in looks:
        moves_then = _moves(seen.job.lines[:index])
        parts = [(one, _part(one, done_moves, moves_then)) for one in breaks]
        found = [(one, span) for one, span in parts if span[1] - span[0] >= SEEN_MM]
        done_moves = moves_then
        if not found:
            continue
        insert, own = _mended(seen, lines, index + grown, found, grown_moves, edge_mm)
        judged += own
        lines[index + grown : index + grown] = insert
        grown, grown_moves = grown + len(insert), grown_moves + _moves(insert)
    return judged


def _moves(lines: Sequence[bytes]) -> int:
    return sum(line.startswith((b"G0 ", b"G1 ")) for line in lines)


def _part(one: Break, first: int, last: int) -> Span:
    """What was written of a break by some of the job's moves, along its stroke."""
    low, high = np.searchsorted(one.stroke.moves, [first, last])
    begin, end = (float(one.stroke.arc[k]) for k in (low, high))
    return max(begin, one.span[0]), min(end, one.span[1])


def _mended(
    seen: ObservedPrint,
    lines: Sequence[bytes],
    done: int,
    found: Sequence[tuple[Break, Span]],
    shift: int,
    edge_mm: float,
) -> tuple[list[bytes], list[Judged]]:
    """Plan and judge the insert of one look."""
    held = seen.held(lines, done)
    text = [line.decode() for line in lines[:done]]
    moves = read_moves("\n".join(text), held.start_mm)
    placed = [_placed(one, span, moves, shift) for one, span in found]
    paths = written_paths(held)
    gaps = [
        gap_between(paths, [place_on(stroke, moves, at) for at in np.linspace(*span, 5)])
        for stroke, span in placed
    ]
    mend = plan_mend(held, gaps, Voids.none())
    if not mend.lines:
        return [], []
    case = Case(
        text,
        [line.decode() for line in mend.lines],
        held.start_mm,
        seen.syringe.area_mm2 * seen.ink.flow_factor,
        None,
        seen.needle.outer_mm,
        edge_mm,
    )
    none = np.zeros((0, 3)), np.zeros((0, 3)), np.zeros((0, 2))
    judged = judge_all(case, placed, none)
    for (one, span), own in zip(found, judged, strict=True):
        one.covered_mm += own.covered * (span[1] - span[0])
    return list(mend.lines), judged


def _placed(one: Break, span: Span, moves: Moves, shift: int) -> tuple[Stroke, Span]:
    """The stroke of a grown job that a part of a break lies in, and where along it."""
    k = int(np.searchsorted(one.stroke.arc, span[0], side="right")) - 1
    row = int(one.stroke.moves[k]) + shift
    stroke = next(own for own in strokes_of(moves) if row in own.moves)
    at = int(np.flatnonzero(stroke.moves == row)[0])
    off = float(stroke.arc[at] - one.stroke.arc[k])
    assert abs(lengths(moves)[row] - np.diff(one.stroke.arc)[k]) < 1e-6
    return stroke, (span[0] + off, span[1] + off)
