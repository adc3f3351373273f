"""Dry-run a job with inserted lines; extract the inserted moves, their ink and widths."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from kernels.arrays import BoolArray, FloatArray, IntArray
from printctl.observe.mending.held_print import WAY_MM, HeldPrint
from printctl.observe.mending.laid_ink import laid_ink, nearest_pieces
from printctl.observe.mending.needle_way import NeedleRows
from printctl.observe.mending.written_paths import WrittenPath
from sim.gcode.dry_run.run import DryRun, dry_run
from sim.gcode.program.modal import MOVE


@dataclass(frozen=True, eq=False)
class InsertRun:
    """Executed blocks of the inserted lines.

    Attributes
    ----------
    run : DryRun
        Of the whole grown job.
    done, count : int
        Lines before the insert, and its own.
    block : (k,) int64
        Of the executed motion.
    area_mm2 : (k,) float64, mm²
        Cross-section of what each block lays; 0 for travels.
    """

    run: DryRun
    done: int
    count: int
    block: IntArray
    area_mm2: FloatArray

    @property
    def writes(self) -> BoolArray:
        """Blocks that lay ink, (k,)."""
        return self.area_mm2 > 0

    @property
    def volume_ul(self) -> float:
        """Laid along ways, µL."""
        start, end = self.tips()
        return float((np.linalg.norm(end - start, axis=1) * self.area_mm2).sum())

    @property
    def duration_s(self) -> float:
        """From the last block before the insert to its own last one, s."""
        executed = self.run.executed
        before = executed.time_end[executed.line < self.done].max(initial=0.0)
        return float(executed.time_end[self.block].max(initial=before) - before)

    def tips(self) -> tuple[FloatArray, FloatArray]:
        """Begin and end of each block, (k, 3), mm."""
        executed = self.run.executed
        return executed.start[self.block], executed.end[self.block]

    def written(self) -> tuple[FloatArray, FloatArray]:
        """Begin and end of each block that lays ink, (m, 3), mm."""
        start, end = self.tips()
        return start[self.writes], end[self.writes]

    def reached(self) -> FloatArray:
        """Place of the tip and plunger's count behind the insert, (4,), mm."""
        program = self.run.program
        row = int(np.searchsorted(program.command, self.done + self.count)) - 1
        return np.asarray(program.target[row])


def run_insert(held: HeldPrint, lines: Sequence[bytes]) -> InsertRun:
    """Run the job that lines are inserted into dry."""
    grown = [*held.lines[: held.done], *lines, *held.lines[held.done :]]
    text = b"\n".join(grown) + b"\n"
    run = dry_run(text, held.printer, held.start_mm, cold_extrusion=True)
    executed, program, done = run.executed, run.program, held.done
    block = np.flatnonzero((executed.line >= done) & (executed.line < done + len(lines)))
    way = np.linalg.norm(program.target[:, :3] - program.before[:, :3], axis=1)
    writes = (program.kind == MOVE) & (program.pushed > 0) & (way > WAY_MM)
    area = np.where(writes, program.pushed * held.ul_per_e / np.maximum(way, WAY_MM), 0.0)
    row = np.searchsorted(program.command, executed.line[block])
    return InsertRun(run, done, len(lines), block, area[row])


def sections(
    inserted: InsertRun, held: HeldPrint, height: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return width and height of what each block lays, (k,), mm; a filament's diameter twice."""
    if held.style == "embedded":
        wide = np.sqrt(4 / np.pi * inserted.area_mm2) * (held.ink.swell_factor or 1.0)
        return wide, wide
    return held.ink.bead_section.width(inserted.area_mm2, height), height


def needle_rows(inserted: InsertRun, held: HeldPrint, paths: Sequence[WrittenPath]) -> NeedleRows:
    """Return the inserted lines as the needle's moves, each written one on the nearest path."""
    program, done = inserted.run.program, inserted.done
    own = (program.command >= done) & (program.command < done + inserted.count)
    rows = np.flatnonzero(own)
    tips = np.vstack([held.at_mm, program.target[rows, :3]])
    way = np.linalg.norm(np.diff(tips, axis=0), axis=1)
    volume = np.where(way > WAY_MM, np.maximum(program.pushed[rows], 0.0) * held.ul_per_e, 0.0)
    path = np.full(len(rows), -1, dtype=np.int64)
    writes = np.flatnonzero(volume > 0)
    sound = laid_ink(paths)
    middles = ((tips[1:] + tips[:-1]) / 2)[writes]
    path[writes] = sound.path[nearest_pieces(middles, sound)[0]]
    return NeedleRows(tips, volume, path)
