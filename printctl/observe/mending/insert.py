"""Write a mend as G-code lines, and dry-run the job with them inserted."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from design.toolpath.gcode.numbers import decimals_for, dialect_of
from design.toolpath.priming import Purge
from kernels.arrays import BoolArray, FloatArray, IntArray
from printctl.observe.mending.held_print import WAY_MM, HeldPrint, WrittenPath
from printctl.observe.mending.laid_ink import laid_ink, nearest_pieces
from printctl.observe.mending.mend import Patch
from printctl.observe.mending.needle_way import NeedleRows
from sim.gcode.dry_run.run import DryRun, dry_run
from sim.gcode.program.modal import MOVE

_NOTHING_E = 1e-6


class InsertWriter:
    """Collects the lines of an insert.

    Parameters
    ----------
    held : HeldPrint
    high_mm : float, mm
        Height of travels.

    Attributes
    ----------
    lines : list of bytes
    """

    def __init__(self, held: HeldPrint, high_mm: float) -> None:
        self.lines: list[bytes] = []
        self._held, self._high = held, high_mm
        self._digits = decimals_for(held.printer)
        self._dialect = dialect_of(held.printer)
        self._at, self._e = held.at_mm.copy(), held.e_mm
        self._relieved = held.relieved_e
        self._feed: str | None = None

    def begin(self) -> None:
        """Relieve the plunger and rise above all ink."""
        self._relieve_to(max(self._held.relief_e, self._relieved))
        self._rise()

    def purge(self, purge: Purge, top_mm: float) -> None:
        """Push ink out over a place outside the part, and wipe, going there as high as the job."""
        self._go_z(max(top_mm, self._at[2]))
        over = np.asarray(purge.place_mm, dtype=np.float64)
        self._go_xy(over)
        self._go_z(float(over[2]))
        relief = self._relieved
        self._push(relief + purge.volume_ul / self._held.ul_per_e)
        self._relieved = 0.0
        self._relieve_to(relief)
        if purge.wipe_mm is not None:
            self._go_xy(np.asarray(purge.wipe_mm, dtype=np.float64))
        self._go_z(top_mm)

    def patch(self, patch: Patch, wipe: FloatArray | None) -> tuple[int, int]:
        """Write a patch; return the first of its lines that writes, and the one behind the last.

        Parameters
        ----------
        patch : Patch
        wipe : (k, 3) float64, mm, or None
            Way on after it, with the plunger relieved.
        """
        points, e, feed = patch.moves()
        lag = self._held.lag_s
        length = np.linalg.norm(np.diff(points, axis=0), axis=1)
        pressure = lag * e * feed / length
        relief = self._relieved
        self._go_xy(points[0])
        self._go_z(float(points[0, 2]))
        self._push(relief + float(pressure[0]))
        first = len(self.lines)
        for place, more, speed in zip(points[1:], e, feed, strict=True):
            self._e += float(more)
            self._move(1, place, self._e, float(speed))
        last = len(self.lines)
        self._relieved = 0.0
        self._relieve_to(relief + float(pressure[-1]))
        self._relieved = relief
        for place in () if wipe is None else wipe:
            self._move(1, place, None, float(feed[-1]))
        self._rise()
        return first, last

    def end(self) -> None:
        """Come back to where the print is held, with plunger, count and feed as they were."""
        held = self._held
        self._go_xy(held.at_mm)
        self._go_z(float(held.at_mm[2]))
        self._push(self._relieved - held.relieved_e)
        self.lines.append(b"G92 E%b" % self._number(held.e_mm, self._digits.e))
        if held.place.f is not None:
            self.lines.append(b"G1 F%b" % f"{held.place.f:.10g}".encode())

    def _rise(self) -> None:
        self._go_z(max(self._high, self._at[2]))

    def _go_xy(self, place: FloatArray) -> None:
        """Go across to a place at the height that the tip has."""
        target = np.array([place[0], place[1], self._at[2]])
        self._move(0, target, None, self._held.travel_mm_s)

    def _go_z(self, z_mm: float) -> None:
        target = np.array([self._at[0], self._at[1], z_mm])
        self._move(0, target, None, self._held.lift_mm_s)

    def _relieve_to(self, relief_e: float) -> None:
        """Draw the plunger back until it is relieved by so much E."""
        self._push(self._relieved - relief_e)
        self._relieved = relief_e

    def _push(self, e_mm: float) -> None:
        """Move the plunger while the needle stands; back where it is below 0."""
        if abs(e_mm) > _NOTHING_E:
            self._e += e_mm
            self._say(1, b"E%b" % self._number(self._e, self._digits.e), self._held.plunger_mm_s)

    def _move(self, code: int, place: FloatArray, e: float | None, speed: float) -> None:
        """Move along the axes that change; nothing where none does."""
        digits = (self._digits.x, self._digits.y, self._digits.z)
        words = [
            axis + self._number(float(to), places)
            for axis, to, now, places in zip(
                (b"X", b"Y", b"Z"), place, self._at, digits, strict=True
            )
            if abs(to - now) > WAY_MM
        ]
        if not words and e is None:
            return
        if e is not None:
            words.append(b"E" + self._number(e, self._digits.e))
        self._at = np.asarray(place, dtype=np.float64).copy()
        self._say(code, b" ".join(words), speed)

    def _say(self, code: int, words: bytes, speed: float) -> None:
        feed = self._rounded_down(speed * self._dialect.feed_s)
        told = b"" if feed == self._feed else b" F" + feed.encode()
        self._feed = feed
        self.lines.append(b"G%d %b%b" % (code, words, told))

    def _rounded_down(self, feed: float) -> str:
        """Text of a feed, never above a limit by its last digit."""
        places = self._dialect.feed_decimals
        whole = math.floor(feed * 10**places + 1e-6)
        return f"{whole / 10**places:.{places}f}".rstrip("0").rstrip(".")

    @staticmethod
    def _number(value: float, places: int) -> bytes:
        text = f"{value:.{places}f}"
        if places:
            text = text.rstrip("0").rstrip(".")
        return b"0" if text in ("-0", "") else text.encode()


# Dry-run a job with inserted lines; extract the inserted moves, their ink and widths.


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
