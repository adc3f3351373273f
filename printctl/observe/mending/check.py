"""Check a mend by the executed motion of its lines: lumens, written ink, limits, place at its end.

The grown job is run dry, and what its inserted lines do is taken from there, not from the plan.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from printctl.gate import refused_lines
from printctl.link.modal import modal_state
from printctl.observe.mending.gap import Gap
from printctl.observe.mending.held_print import WAY_MM, HeldPrint
from printctl.observe.mending.laid_ink import LaidInk, laid_ink, nearest_pieces
from printctl.observe.mending.needle_way import NeedleRows, shaft_contacts, under_higher_ink
from printctl.observe.mending.options import MendOptions
from printctl.observe.mending.voids import Voids, ink_in_voids_mm
from printctl.observe.mending.written_paths import WrittenPath, written_paths
from sim.dry_run.run import DryRun, dry_run
from sim.program.modal import MOVE
from sim.reading.other_lines import other_lines

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

_SAME_MM = 1e-4
"""Places that the text gives alike."""


@dataclass(frozen=True)
class MendCheck:
    """What the inserted lines do.

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
    volume_ul : float, µL
        Written along ways.
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
    volume_ul: float
    duration_s: float

    @property
    def passed(self) -> bool:
        """Whether the insert may be sent."""
        clean = not (self.lumens_entered or self.ink_crossed or self.refused or self.beyond_limits)
        return clean and self.off_mm < _SAME_MM and self.same_modes

    def as_dict(self) -> dict[str, Any]:
        """Return it JSON-ready, ``passed`` included."""
        found = {**asdict(self), "passed": self.passed}
        return {
            key: None if isinstance(value, float) and not np.isfinite(value) else value
            for key, value in found.items()
        }


@dataclass(frozen=True, eq=False)
class _Run:
    """Executed blocks of the inserted lines."""

    run: DryRun
    block: IntArray
    row: IntArray
    area_mm2: FloatArray

    @property
    def writes(self) -> NDArray[np.bool_]:
        return self.area_mm2 > 0

    @property
    def volume_ul(self) -> float:
        start, end = self.tips()
        return float((np.linalg.norm(end - start, axis=1) * self.area_mm2).sum())

    def tips(self) -> tuple[FloatArray, FloatArray]:
        executed = self.run.executed
        return executed.start[self.block], executed.end[self.block]


def check_mend(
    held: HeldPrint,
    lines: Sequence[bytes],
    gaps: Sequence[Gap] = (),
    voids: Voids | None = None,
    options: MendOptions | None = None,
) -> MendCheck:
    """Run the grown job dry and judge what its inserted lines do.

    Parameters
    ----------
    held : HeldPrint
        The job before it grows.
    lines : sequence of bytes
        Of the insert.
    gaps : sequence of Gap
        Where no ink lies; all that was written lies there elsewhere.
    voids : Voids, optional
    options : MendOptions, optional
        Tolerance and clearance.
    """
    options, voids = options or MendOptions(), voids or Voids.none()
    paths = written_paths(held)
    text = _text([*held.lines[: held.done], *lines, *held.lines[held.done :]])
    run = dry_run(text, held.printer, held.start_mm, cold_extrusion=True)
    inserted = _inserted(run, held, len(lines))
    sound = laid_ink(paths)
    depth = _depths(inserted, voids, sound, held)
    feed = modal_state([*held.lines[: held.done], *lines], held.done + len(lines)).f
    row = int(np.searchsorted(run.program.command, held.done + len(lines))) - 1
    reached = run.program.target[row] - np.append(held.at_mm, held.e_mm)
    written = [each[inserted.writes] for each in inserted.tips()]
    middles = (written[0] + written[1]) / 2
    return MendCheck(
        int((depth > options.void_tolerance_mm).sum()),
        float(depth.max(initial=-np.inf)),
        _crossed(inserted, held, paths, gaps, options),
        float(np.abs(reached).max()),
        float(nearest_pieces(middles, sound)[1].max(initial=0.0)),
        _covered(inserted, gaps, paths),
        _refused(lines, held),
        _beyond(run, held),
        feed == held.place.f,
        inserted.volume_ul,
        _lasts(run, held.done, len(lines)),
    )


def _text(lines: Sequence[bytes]) -> bytes:
    return b"\n".join(lines) + b"\n"


def _inserted(run: DryRun, held: HeldPrint, count: int) -> _Run:
    executed, program = run.executed, run.program
    block = np.flatnonzero((executed.line >= held.done) & (executed.line < held.done + count))
    row = np.searchsorted(program.command, executed.line[block])
    way = np.linalg.norm(program.target[:, :3] - program.before[:, :3], axis=1)
    writes = (program.kind == MOVE) & (program.pushed > 0) & (way > WAY_MM)
    area = np.where(writes, program.pushed * held.ul_per_e / np.maximum(way, WAY_MM), 0.0)
    return _Run(run, block, row, area[row])


def _sections(inserted: _Run, held: HeldPrint, height: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Width and height of what each block lays, mm; a filament's diameter twice."""
    if held.style == "embedded":
        wide = np.sqrt(4 / np.pi * inserted.area_mm2) * (held.ink.swell_factor or 1.0)
        return wide, wide
    return held.ink.bead_section.width(inserted.area_mm2, height), height


def _depths(inserted: _Run, voids: Voids, sound: LaidInk, held: HeldPrint) -> FloatArray:
    """How deep each written block reaches into a void, (k,), mm."""
    start, end = (each[inserted.writes] for each in inserted.tips())
    if not len(start) or not len(voids):
        return np.full(len(start), -np.inf)
    height = np.ones(len(inserted.block))
    height[inserted.writes] = sound.height_mm[nearest_pieces((start + end) / 2, sound)[0]]
    width, high = (each[inserted.writes] for each in _sections(inserted, held, height))
    shares = np.linspace(0.0, 1.0, 5)
    places = [start + share * (end - start) for share in shares]
    layered = held.style == "layered"
    found = [ink_in_voids_mm(voids, each, width, high, layered=layered) for each in places]
    return np.asarray(np.max(found, axis=0))


def _crossed(
    inserted: _Run,
    held: HeldPrint,
    paths: Sequence[WrittenPath],
    gaps: Sequence[Gap],
    options: MendOptions,
) -> int:
    ink = laid_ink(paths, gaps)
    if held.style == "embedded":
        return len(
            shaft_contacts(_needle_rows(inserted, held, paths), ink, paths, held.needle, 0.0)
        )
    start, end = inserted.tips()
    crossed = np.zeros(len(start), dtype=bool)
    for share in (0.0, 0.25, 0.5, 0.75, 1.0):
        places = start + share * (end - start)
        crossed |= under_higher_ink(places, _but_held(ink, held), held.needle, 0.0)
    return int(crossed.sum())


def _but_held(ink: LaidInk, held: HeldPrint) -> LaidInk:
    """Ink without what the job itself has the needle stand in, where it is held."""
    stands = under_higher_ink(held.at_mm[None], ink, held.needle, 0.0)[0]
    if not stands:
        return ink
    away = np.linalg.norm((ink.start + ink.end)[:, :2] / 2 - held.at_mm[:2], axis=1)
    return ink.where(away > ink.length_mm / 2 + ink.width_mm + held.needle.outer_mm)


def _needle_rows(inserted: _Run, held: HeldPrint, paths: Sequence[WrittenPath]) -> NeedleRows:
    """Rows of the program's inserted lines, each written one on the path nearest to it."""
    program = inserted.run.program
    last = held.done + int(inserted.run.executed.line[inserted.block].max(initial=held.done))
    rows = np.unique(inserted.row)
    rows = np.arange(rows[0], rows[-1] + 1) if len(rows) else np.zeros(0, np.int64)
    rows = rows[program.command[rows] <= last]
    tips = np.vstack([held.at_mm, program.target[rows, :3]])
    way = np.linalg.norm(np.diff(tips, axis=0), axis=1)
    volume = np.where(way > WAY_MM, np.maximum(program.pushed[rows], 0.0) * held.ul_per_e, 0.0)
    path = np.full(len(volume), -1, dtype=np.int64)
    rows = np.flatnonzero(volume > 0)
    sound = laid_ink(paths)
    path[rows] = sound.path[nearest_pieces(((tips[1:] + tips[:-1]) / 2)[rows], sound)[0]]
    return NeedleRows(tips, volume, path)


def _covered(inserted: _Run, gaps: Sequence[Gap], paths: Sequence[WrittenPath]) -> float:
    """Share of the gaps' length over which a written block goes."""
    start, end = (each[inserted.writes] for each in inserted.tips())
    none = np.zeros(len(start))
    laid = LaidInk(start, end, none, none, none.astype(np.int64))
    found = [np.ones(1, dtype=bool)] if not gaps else []
    for gap in gaps:
        path = paths[gap.path]
        along = np.linspace(gap.from_mm, gap.to_mm, max(5, int(gap.length_mm / 0.05)))
        found.append(nearest_pieces(path.at(along), laid)[1] < path.width_mm.min() / 2)
    return float(np.concatenate(found).mean())


def _refused(lines: Sequence[bytes], held: HeldPrint) -> tuple[str, ...]:
    """What the gate refuses of the insert, each with its line."""
    read = other_lines(_text(lines), held.printer)
    return tuple(f"line {number}: {why}" for number, _, why in refused_lines(read, held.printer))


def _beyond(run: DryRun, held: HeldPrint) -> tuple[str, ...]:
    """What is wrong with the grown job and not with the job."""
    alone = dry_run(held.text, held.printer, held.start_mm, cold_extrusion=True)
    known = {finding.code for finding in alone.findings}
    return tuple(one.message for one in run.findings if one.code not in known)


def _lasts(run: DryRun, done: int, count: int) -> float:
    executed = run.executed
    before = executed.time_end[executed.line < done].max(initial=0.0)
    own = (executed.line >= done) & (executed.line < done + count)
    return float(executed.time_end[own].max(initial=before) - before)
