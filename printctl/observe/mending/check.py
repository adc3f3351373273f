"""Dry-run a mend's inserted lines: check lumens entered, ink crossed, limits, end position.

What the lines do is taken from the dry run, not from the plan.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from kernels.arrays import FloatArray
from printctl.checks.gate import refused_lines
from printctl.machine.job.coordinates import modal_state
from printctl.observe.mending.gap import Gap
from printctl.observe.mending.held_print import HeldPrint, WrittenPath, written_paths
from printctl.observe.mending.insert import InsertRun, needle_rows, run_insert, sections
from printctl.observe.mending.laid_ink import (
    LaidInk,
    laid_ink,
    nearest_pieces,
    section_mm2,
    width_with_more,
)
from printctl.observe.mending.mend import MendOptions
from printctl.observe.mending.needle_way import shaft_contacts, under_higher_ink
from printctl.observe.mending.voids import Voids, ink_in_voids_mm, open_voids
from sim.gcode.dry_run.run import DryRun, dry_run
from sim.gcode.reading.file import other_lines

_SAME_MM = 1e-4
"""Places that the text gives alike."""
_ON_MM = 0.015
"""Beside an axis, rounding of text and motor steps included, that counts as on it."""
_STATION_MM = 0.05
"""Between places of a block at which its ink is held against voids."""
_SHARES = 5
"""Places of a block that are looked at."""


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
        return clean and self.returns

    @property
    def returns(self) -> bool:
        """Whether place, plunger's count and feed at its end are those of its begin."""
        return self.off_mm < _SAME_MM and self.same_modes

    def as_dict(self) -> dict[str, Any]:
        """Return it JSON-ready, ``passed`` included."""
        facts = {**asdict(self), "passed": self.passed}
        return {
            key: None if isinstance(value, float) and not np.isfinite(value) else value
            for key, value in facts.items()
        }


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
    inserted, sound = run_insert(held, lines), laid_ink(paths)
    depth = _depths(inserted, voids, sound, held, _sound(paths, gaps))
    feed = modal_state([*held.lines[: held.done], *lines], held.done + len(lines)).f
    start, end = inserted.written()
    return MendCheck(
        int((depth > options.void_tolerance_mm).sum()),
        float(depth.max(initial=-np.inf)),
        _crossed(inserted, held, paths, gaps),
        float(np.abs(inserted.reached() - np.append(held.at_mm, held.e_mm)).max()),
        float(nearest_pieces((start + end) / 2, sound)[1].max(initial=0.0)),
        _covered(inserted, gaps, paths),
        _refused(lines, held),
        _beyond(inserted.run, held),
        feed == held.place.f,
        inserted.volume_ul,
        inserted.duration_s,
    )


def _sound(paths: Sequence[WrittenPath], gaps: Sequence[Gap]) -> LaidInk:
    """Ink that patches overlap with.

    Gaps count a little longer, so that what ends at sound ink isn't taken for lying on it. Of a
    thin stretch the second pass alone counts: with what is there it is as wide as the job's.
    """
    wider = [
        replace(gap, missing=1.0, from_mm=gap.from_mm - 2 * _ON_MM, to_mm=gap.to_mm + 2 * _ON_MM)
        for gap in gaps
    ]
    return laid_ink(paths, wider)


def _depths(
    inserted: InsertRun, voids: Voids, planned: LaidInk, held: HeldPrint, sound: LaidInk
) -> FloatArray:
    """How deep each written block reaches into a void, (k,), mm.

    With the sound ink of its own path that it lies on; what other paths lay, the job, too, writes
    onto.
    """
    start, end = inserted.written()
    if not len(start) or not len(voids):
        return np.full(len(start), -np.inf)
    wide = float(planned.width_mm.max(initial=0.0))
    voids = open_voids(voids, held, np.concatenate([start, end]), wide)
    height = np.ones(len(inserted.block))
    nearest = nearest_pieces((start + end) / 2, planned)[0]
    height[inserted.writes] = planned.height_mm[nearest]
    width, high = (each[inserted.writes] for each in sections(inserted, held, height))
    layered, depths = held.style == "layered", np.full(len(start), -np.inf)
    area = inserted.area_mm2[inserted.writes]
    for k, (a, b) in enumerate(zip(start, end, strict=True)):
        count = max(2, int(np.ceil(np.linalg.norm(b - a) / _STATION_MM)) + 1)
        places = np.linspace(a, b, count)
        alone, tall = np.full(count, width[k]), np.full(count, high[k])
        own = sound.where(sound.path == planned.path[nearest[k]])
        piece, away = nearest_pieces(places, own)
        times = np.ones(count)
        on = away < _ON_MM
        times[on] += section_mm2(own.width_mm, own.height_mm, held)[piece[on]] / area[k]
        both = width_with_more(alone, tall, times, held)
        depths[k] = ink_in_voids_mm(voids, places, both, tall, layered=layered).max()
    return depths


def _crossed(
    inserted: InsertRun, held: HeldPrint, paths: Sequence[WrittenPath], gaps: Sequence[Gap]
) -> int:
    """Moves of the needle through ink that was written, or that the insert has written before."""
    ink = laid_ink(paths, gaps)
    if held.style == "embedded":
        rows = needle_rows(inserted, held, paths)
        return len(shaft_contacts(rows, ink, paths, held.needle, 0.0, held.at_mm))
    start, end = inserted.tips()
    ink, crossed = _but_held(ink, held), np.zeros(len(start), dtype=bool)
    for share in np.linspace(0.0, 1.0, _SHARES):
        crossed |= under_higher_ink(start + share * (end - start), ink, held.needle, 0.0)
    return int(crossed.sum())


def _but_held(ink: LaidInk, held: HeldPrint) -> LaidInk:
    """Ink without what the job itself has the needle stand in, where it is held."""
    stands = under_higher_ink(held.at_mm[None], ink, held.needle, 0.0)[0]
    if not stands:
        return ink
    away = np.linalg.norm((ink.start + ink.end)[:, :2] / 2 - held.at_mm[:2], axis=1)
    return ink.where(away > ink.length_mm / 2 + ink.width_mm + held.needle.outer_mm)


def _covered(inserted: InsertRun, gaps: Sequence[Gap], paths: Sequence[WrittenPath]) -> float:
    """Share of the gaps' length over which a written block goes."""
    start, end = inserted.written()
    none = np.zeros(len(start))
    laid = LaidInk(start, end, none, none, none.astype(np.int64))
    covered = [np.ones(1, dtype=bool)] if not gaps else []
    for gap in gaps:
        path = paths[gap.path]
        along = np.linspace(gap.from_mm, gap.to_mm, max(5, int(gap.length_mm / 0.05)))
        covered.append(nearest_pieces(path.at(along), laid)[1] < path.width_mm.min() / 2)
    return float(np.concatenate(covered).mean())


def _refused(lines: Sequence[bytes], held: HeldPrint) -> tuple[str, ...]:
    """What the gate refuses of the insert, each with its line."""
    read = other_lines(b"\n".join(lines) + b"\n", held.printer)
    return tuple(f"line {number}: {why}" for number, _, why in refused_lines(read, held.printer))


def _beyond(run: DryRun, held: HeldPrint) -> tuple[str, ...]:
    """What is wrong with the grown job and not with the job."""
    alone = dry_run(held.text, held.printer, held.start_mm, cold_extrusion=True)
    known = {finding.code: finding.count for finding in alone.findings}
    return tuple(one.message for one in run.findings if one.count > known.get(one.code, 0))
