"""Dry-run a mend's inserted lines: check lumens entered, ink crossed, limits, end position.

What the lines do is taken from the dry run, not from the plan.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from gcode.dry_run.run import DryRun, dry_run
from gcode.program.gcode import Program
from gcode.program.modal import MOVE
from gcode.reading.file import read_file
from kernels.arrays import FloatArray, IntArray
from printctl.checks.gate import refused_lines
from printctl.machine.job.coordinates import modal_state
from printctl.observe.mending.held_print import WAY_MM, HeldPrint, WrittenPath, written_paths
from printctl.observe.mending.laid_ink import Gap, LaidInk, laid_ink, section_mm2, width_with_more
from printctl.observe.mending.obstacles import (
    NeedleRows,
    Voids,
    ink_in_voids_mm,
    open_voids,
    shaft_contacts,
    under_higher_ink,
)
from printctl.observe.mending.patches import VOID_TOLERANCE_MM

_RETURN_TOLERANCE_MM: Final = 1e-4
"""Distance below which the insert returns to the held position."""
_ON_AXIS_TOLERANCE_MM: Final = 0.015
"""Beside an axis, rounding of text and motor steps included, that counts as on it."""
_MAX_STATION_SPACING_MM: Final = 0.05
"""Largest distance of the places of a block that are checked against voids."""
_PLACES_PER_BLOCK: Final = 5
"""Places of a block that are checked for crossings."""


@dataclass(frozen=True)
class MendCheck:
    """Effects of a mend's inserted lines.

    Attributes
    ----------
    lumens_entered : int
        Pieces of ink that reach into a void by more than the tolerance.
    deepest_mm : float, mm
        Deepest that ink reaches into a void; below 0 for none, -inf without voids nearby.
    ink_crossed : int
        Moves of the needle through written ink.
    off_mm : float, mm
        Between tip and plunger's count at the end, and where the print is held.
    outside_mm : float, mm
        Farthest that a line's axis lies beside the job's own paths.
    covered : float
        Share of the gaps' length that is written again.
    refused : tuple of str
        Lines that the gate refuses, with the reason.
    beyond_limits : tuple of str
        What the dry run finds in the grown job, and not in the job.
    same_modes : bool
        Whether feed and plunger's count are those before it.
    duration_s : float, s
    """

    lumens_entered: int
    deepest_mm: float
    ink_crossed: int
    off_mm: float
    outside_mm: float
    covered: float
    refused: tuple[str, ...]
    beyond_limits: tuple[str, ...]
    same_modes: bool
    duration_s: float

    @property
    def passed(self) -> bool:
        """Whether the insert may be sent."""
        return not self.failures

    @property
    def failures(self) -> str:
        """Failed checks in words; empty for none."""
        returns = self.off_mm < _RETURN_TOLERANCE_MM and self.same_modes
        failures = [
            f"{self.lumens_entered} pieces of ink in lumens" if self.lumens_entered else "",
            f"{self.ink_crossed} moves through written ink" if self.ink_crossed else "",
            "" if returns else f"it ends {self.off_mm:.4f} mm off, or at another feed",
            *self.refused,
            *self.beyond_limits,
        ]
        return "; ".join(one for one in failures if one)


@dataclass(frozen=True, eq=False)
class _InsertRun:
    """Executed blocks of the inserted lines.

    Attributes
    ----------
    run : DryRun
        Of the whole grown job.
    block : (k,) int64
        Of the executed motion.
    area_mm2 : (k,) float64, mm²
        Cross-section of what each block lays; 0 for travels.
    start, end : (k, 3) float64, mm
    """

    run: DryRun
    block: IntArray
    area_mm2: FloatArray
    start: FloatArray
    end: FloatArray

    @staticmethod
    def from_lines(held_print: HeldPrint, lines: Sequence[bytes]) -> _InsertRun:
        """Dry-run the job with the inserted lines."""
        text = (
            b"\n".join(
                [*held_print.lines[: held_print.done], *lines, *held_print.lines[held_print.done :]]
            )
            + b"\n"
        )
        run = dry_run(text, held_print.printer, held_print.start_mm, cold_extrusion=True)
        executed, program, done = run.executed, run.program, held_print.done
        block = np.flatnonzero((executed.line >= done) & (executed.line < done + len(lines)))
        way = np.linalg.norm(program.target[:, :3] - program.before[:, :3], axis=1)
        writes = (program.kind == MOVE) & (program.pushed > 0) & (way > WAY_MM)
        area = np.where(writes, program.pushed * held_print.ul_per_e / np.maximum(way, WAY_MM), 0.0)
        row = np.searchsorted(program.command, executed.line[block])
        return _InsertRun(run, block, area[row], executed.start[block], executed.end[block])

    def written(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return begin and end (m, 3), mm, and section (m,), mm², of each block that lays ink."""
        rows = self.area_mm2 > 0
        return self.start[rows], self.end[rows], self.area_mm2[rows]

    def duration_s(self, done: int) -> float:
        """Return the time from the last block before the insert to its own last one, s."""
        executed = self.run.executed
        before = executed.time_end[executed.line < done].max(initial=0.0)
        return float(executed.time_end[self.block].max(initial=before) - before)


def check_mend(
    held_print: HeldPrint,
    lines: Sequence[bytes],
    gaps: Sequence[Gap] = (),
    voids: Voids | None = None,
) -> MendCheck:
    """Run the grown job dry and judge what its inserted lines do.

    Parameters
    ----------
    held_print : HeldPrint
        The job before it grows.
    lines : sequence of bytes
        Of the insert.
    gaps : sequence of Gap
        Where no ink lies; all that was written lies there elsewhere.
    voids : Voids, optional
    """
    paths, behind = written_paths(held_print), held_print.done + len(lines)
    inserted, sound = _InsertRun.from_lines(held_print, lines), laid_ink(paths)
    depth = _void_depths(
        inserted, voids or Voids.none(), sound, held_print, _overlap_ink(paths, gaps)
    )
    start, end, _ = inserted.written()
    program = inserted.run.program
    reached = program.target[int(np.searchsorted(program.command, behind)) - 1]
    read = read_file(b"\n".join(lines), held_print.printer).others
    refused = refused_lines(read, held_print.printer)
    return MendCheck(
        lumens_entered=int((depth > VOID_TOLERANCE_MM).sum()),
        deepest_mm=float(depth.max(initial=-np.inf)),
        ink_crossed=_count_crossings(inserted, held_print, len(lines), paths, gaps),
        off_mm=float(np.abs(reached - np.append(held_print.at_mm, held_print.e_mm)).max()),
        outside_mm=float(sound.nearest((start + end) / 2)[1].max(initial=0.0)),
        covered=_covered_share(start, end, gaps, paths),
        refused=tuple(f"line {number}: {why}" for number, _, why in refused),
        beyond_limits=_new_findings(inserted.run, held_print),
        same_modes=modal_state([*held_print.lines[: held_print.done], *lines], behind).f
        == held_print.place.f,
        duration_s=inserted.duration_s(held_print.done),
    )


def _overlap_ink(paths: Sequence[WrittenPath], gaps: Sequence[Gap]) -> LaidInk:
    """Return the sound ink that patches overlap with.

    Gaps count a little longer, so that what ends at sound ink isn't taken for lying on it. Of a
    thin stretch the second pass alone counts: with what is there it is as wide as the job's.
    """
    wider = [
        replace(
            gap,
            missing=1.0,
            from_mm=gap.from_mm - 2 * _ON_AXIS_TOLERANCE_MM,
            to_mm=gap.to_mm + 2 * _ON_AXIS_TOLERANCE_MM,
        )
        for gap in gaps
    ]
    return laid_ink(paths, wider)


def _void_depths(
    inserted: _InsertRun, voids: Voids, planned: LaidInk, held_print: HeldPrint, sound: LaidInk
) -> FloatArray:
    """Return how deep each written block reaches into a void, (k,), mm.

    Includes the sound ink of its own path beneath it; the job itself writes onto other paths.
    """
    start, end, area = inserted.written()
    depths = np.full(len(start), -np.inf)
    if not len(start) or not len(voids):
        return depths
    wide = float(planned.width_mm.max(initial=0.0))
    voids = open_voids(voids, held_print, np.concatenate([start, end]), wide)
    nearest = planned.nearest((start + end) / 2)[0]
    high = planned.height_mm[nearest]
    if held_print.layered:
        width = held_print.ink.bead_section.width(area, high)
    else:
        width = high = np.sqrt(4 / np.pi * area) * (held_print.ink.swell_factor or 1.0)
    for k, (a, b) in enumerate(zip(start, end, strict=True)):
        count = max(2, int(np.ceil(np.linalg.norm(b - a) / _MAX_STATION_SPACING_MM)) + 1)
        places = np.linspace(a, b, count)
        alone, tall = np.full(count, width[k]), np.full(count, high[k])
        own = sound.where(sound.path == planned.path[nearest[k]])
        piece, away = own.nearest(places)
        times = np.ones(count)
        on = away < _ON_AXIS_TOLERANCE_MM
        times[on] += section_mm2(own.width_mm, own.height_mm, held_print)[piece[on]] / area[k]
        both = width_with_more(alone, tall, times, held_print)
        depths[k] = ink_in_voids_mm(voids, places, both, tall, layered=held_print.layered).max()
    return depths


def _count_crossings(
    inserted: _InsertRun,
    held_print: HeldPrint,
    count: int,
    paths: Sequence[WrittenPath],
    gaps: Sequence[Gap],
) -> int:
    """Count needle moves through written ink, or through ink of the insert itself."""
    ink = laid_ink(paths, gaps)
    if not held_print.layered:
        rows = needle_rows(inserted.run.program, held_print, count, paths)
        return len(shaft_contacts(rows, ink, paths, held_print.needle, 0.0, held_print.at_mm))
    if under_higher_ink(held_print.at_mm[None], ink, held_print.needle, 0.0)[0]:
        # The job itself has the needle stand in that ink.
        away = np.linalg.norm((ink.start + ink.end)[:, :2] / 2 - held_print.at_mm[:2], axis=1)
        ink = ink.where(away > ink.length_mm / 2 + ink.width_mm + held_print.needle.outer_mm)
    crossed = np.zeros(len(inserted.block), dtype=bool)
    for share in np.linspace(0.0, 1.0, _PLACES_PER_BLOCK):
        place = inserted.start + share * (inserted.end - inserted.start)
        crossed |= under_higher_ink(place, ink, held_print.needle, 0.0)
    return int(crossed.sum())


def needle_rows(
    program: Program, held_print: HeldPrint, count: int, paths: Sequence[WrittenPath]
) -> NeedleRows:
    """Return so many lines of an insert as moves, each written one on the nearest path.

    Parameters
    ----------
    program : Program
        Of the job with the insert, or up to its end.
    held_print : HeldPrint
    count : int
    paths : sequence of WrittenPath
    """
    done = held_print.done
    rows = np.flatnonzero((program.command >= done) & (program.command < done + count))
    tips = np.vstack([held_print.at_mm, program.target[rows, :3]])
    way = np.linalg.norm(np.diff(tips, axis=0), axis=1)
    volume = np.where(
        way > WAY_MM, np.maximum(program.pushed[rows], 0.0) * held_print.ul_per_e, 0.0
    )
    path = np.full(len(rows), -1, dtype=np.int64)
    writes, sound = np.flatnonzero(volume > 0), laid_ink(paths)
    path[writes] = sound.path[sound.nearest(((tips[1:] + tips[:-1]) / 2)[writes])[0]]
    return NeedleRows(tips, volume, path)


def _covered_share(
    start: FloatArray, end: FloatArray, gaps: Sequence[Gap], paths: Sequence[WrittenPath]
) -> float:
    """Return the share of the gaps' length that written blocks, (m, 3) mm, cover."""
    none = np.zeros(len(start))
    laid = LaidInk(start, end, none, none, none.astype(np.int64))
    covered = [np.ones(1, dtype=bool)] if not gaps else []
    for gap in gaps:
        path = paths[gap.path]
        along = np.linspace(gap.from_mm, gap.to_mm, max(5, int(gap.length_mm / 0.05)))
        covered.append(laid.nearest(path.at(along))[1] < path.width_mm.min() / 2)
    return float(np.concatenate(covered).mean())


def _new_findings(run: DryRun, held_print: HeldPrint) -> tuple[str, ...]:
    """Return the dry run's findings in the grown job that the job lacks."""
    alone = dry_run(held_print.text, held_print.printer, held_print.start_mm, cold_extrusion=True)
    known = {finding.code: finding.count for finding in alone.findings}
    return tuple(one.message for one in run.findings if one.count > known.get(one.code, 0))
