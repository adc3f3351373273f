"""Benchmark of embedded prints seen by a camera: clogs found, asked about, missed; false findings.

Lone vessels, trees and rows in baths of four textures by `checkers.bath_painter`, seen from above
or up to 35 degrees aslant, with a picture before; a whole vessel, half of one, or 1 to 5 mm of it
is missing. Two pictures go through seeing, evidence and decision as an observer's. A stretch counts
as missing between the tips of its round ends.
"""

from __future__ import annotations

import os
import time
from collections import Counter
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, NamedTuple, cast

import numpy as np

from benchmarks.checkers import bath_painter as painter
from benchmarks.common import Row, limited, row
from firmware_profiles.materials.bead import BeadSection
from printctl.inspection import ExpectedLines, Gap, LayerFindings, SeeingOptions, see_layer
from printctl.machine.job.marks import Marks
from printctl.observe.deciding import Decider, Decision, DecisionKind, Limits
from printctl.observe.deciding.evidence import Evidence
from printctl.observe.looks.expected_ink import ExpectedInk, LayerInk
from printctl.observe.looks.look_context import LookContext, unseen_stretches
from printctl.observe.looks.look_evidence import build_evidence
from printctl.observe.mending import WrittenPath
from registration.errors import PictureError

FAULTS = ("whole", "half", "1", "1.5", "2", "3", "5")
KINDS = ("lone", "tree", "rows")
CONTRASTS = (0.03, 0.05, 0.08, 0.13, 0.2, 0.4)
"""Logarithms of ink over bath: 0.03 is hardly seen by eye."""
FIRST_FAULTY = 1_000_000
_END_MM = 0.3
"""A planted gap begins and ends so far from the vessel's ends."""
_MOST_TILT = 35.0


@dataclass(frozen=True)
class Case:
    """A print with at most one fault: vessels, which of them lay there before, what is missing."""

    canvas: painter.Canvas
    older: set[int]
    gaps: list[painter.Gap]

    @property
    def bare(self) -> painter.Gap | None:
        """What is missing, from tip to tip of the round ends beside it."""
        if not self.gaps:
            return None
        stroke, begin, end = self.gaps[0]
        vessel = self.canvas.vessels[stroke]
        half = 0.5 * vessel.diameter
        low = begin + half if begin > 0 else 0.0
        return stroke, low, end - half if end < vessel.length else vessel.length

    def picture(self, number: int) -> np.ndarray:
        """Picture of all that lies there; 0 of what lay there before."""
        written = set(range(len(self.canvas.vessels))) if number else self.older
        return self.canvas.picture(number, self.gaps if number else [], written)


def random_case(seed: int, fault: str | None) -> Case:
    """Bath, contrast and layout in turn; the rest by chance."""
    rng = np.random.default_rng([seed, 77])
    kind, bath = KINDS[seed % 3], painter.BATHS[(seed // 3) % 4]
    contrast = CONTRASTS[(seed // 12) % 6]
    vessels = painter.random_vessels(kind, rng)
    scene = painter.random_scene(bath, contrast, _MOST_TILT, rng)
    older = set[int]()
    if len(vessels) > 1 and rng.random() < 0.5:
        older = set(range(int(rng.integers(1, len(vessels)))))
    gaps: list[painter.Gap] = []
    if fault is not None:
        fresh = [k for k in range(len(vessels)) if k not in older]
        stroke = int(rng.choice(fresh))
        gaps = [(stroke, *_stretch(fault, vessels[stroke].length, rng))]
    return Case(painter.Canvas(vessels, scene, seed), older, gaps)


def _stretch(fault: str, length: float, rng: np.random.Generator) -> tuple[float, float]:
    """From and to of what is missing, mm; longer gaps than the vessel has room for are cut."""
    if fault == "whole":
        return -1.0, length + 1.0
    if fault == "half":
        return (length / 2, length + 1.0) if rng.random() < 0.7 else (-1.0, length / 2)
    gap = min(float(fault), length - 2 * _END_MM)
    begin = float(rng.uniform(_END_MM, max(_END_MM, length - gap - _END_MM)))
    return begin, begin + gap


def expected(case: Case) -> tuple[ExpectedLines, ExpectedInk]:
    """All vessels as the product takes them, and as written ink."""
    paths = tuple(_path(number, one) for number, one in enumerate(case.canvas.vessels))
    start = np.vstack([one.points[:-1] for one in paths])
    end = np.vstack([one.points[1:] for one in paths])
    width = np.concatenate([one.width_mm for one in paths])
    stroke = np.concatenate([np.full(len(one.width_mm), one.number) for one in paths])
    count = np.arange(len(stroke))
    fresh = ~np.isin(stroke, list(case.older))
    one = np.ones(len(count))
    area: np.ndarray[Any, np.dtype[np.float64]] = np.pi / 4 * width**2
    ink = ExpectedInk(
        paths, start, end, width, width, area, count, stroke,
        0.1 * one * count, one, "embedded", np.zeros(len(count), dtype=np.bool_),
    )  # fmt: skip
    return ExpectedLines(start, end, width, count, stroke, fresh), ink


def _path(number: int, vessel: painter.Vessel) -> WrittenPath:
    count = len(vessel.points) - 1
    width, one = np.full(count, vessel.diameter), np.ones(count)
    command = np.arange(count, dtype=np.int64)
    return WrittenPath(number, vessel.points, one, one, command, width, width)


def look(case: Case) -> tuple[Decision, Evidence]:
    """Decide as an observer that mends unasked; a second picture is taken as it would."""
    lines, ink = expected(case)
    before, limits = case.picture(0), Limits(mend="mend")
    options = SeeingOptions(gap_mm=limits.gap.least_mm, shift_mm=0.5)
    see = partial(see_layer, frame=case.canvas.frame, lines=lines, before=before, options=options)
    held = LookContext(
        cast(Any, None), cast(Any, None), 1.0, ink, LayerInk(lines, np.arange(len(lines))), (),
        Marks([]),
    )  # fmt: skip

    def judged(each: list[LayerFindings]) -> Evidence:
        evidence = build_evidence(
            held.layer, ink, each[0], each[1] if len(each) > 1 else None,
            section=BeadSection(), least_gap_mm=limits.gap.least_mm, left_ul=None,
        )  # fmt: skip
        return replace(evidence, unseen=unseen_stretches(held, each, limits.unseen_mm))

    each = [see(case.picture(1))]
    evidence = judged(each)
    if evidence.unseen or any(limits.gap.significant(g, evidence.places) for g in evidence.gaps):
        each.append(see(case.picture(2)))
        evidence = judged(each)
    return Decider(limits).decide(evidence), evidence


class Outcome(NamedTuple):
    """What came of one print; a fault of None is none."""

    seed: int
    fault: str | None
    result: str
    false_mm: float
    cpu_s: float


def outcome(seed: int, fault: str | None) -> Outcome:
    """Judge one print: found, asked, paused or missed; a sound one sound, repair, asked, paused."""
    begun = time.process_time()
    case = random_case(seed, fault)
    try:
        result, false_mm = _result(case, *look(case))
    except PictureError:
        result, false_mm = "paused", 0.0
    return Outcome(seed, fault, result, false_mm, time.process_time() - begun)


def _result(case: Case, decision: Decision, evidence: Evidence) -> tuple[str, float]:
    unseen = [one.gap for one in evidence.unseen]
    gaps = [one for one in decision.gaps if one not in unseen]
    bare = case.bare
    false_mm = sum(g.length_mm for g in gaps if 2 * _shared(g, bare) < g.length_mm)
    if bare is None:
        if decision.kind is DecisionKind.MEND or gaps:
            return "repair", false_mm
        if decision.kind is DecisionKind.GO_ON:
            return "sound", 0.0
        return ("asked" if unseen else "paused"), 0.0
    missing = bare[2] - bare[1]
    found = sum(_shared(g, bare) for g in gaps)
    if 2 * found >= missing:
        return "found", false_mm
    if 2 * (found + sum(_shared(g, bare) for g in unseen)) >= missing:
        return "asked", false_mm
    goes_on = decision.kind in (DecisionKind.GO_ON, DecisionKind.MEND)
    return ("missed" if goes_on else "paused"), false_mm


def _shared(gap: Gap, bare: painter.Gap | None) -> float:
    if bare is None or gap.stroke != bare[0]:
        return 0.0
    return max(0.0, min(gap.to_mm, bare[2]) - max(gap.from_mm, bare[1]))


def rows(quick: bool) -> Iterator[Row]:
    """Yield sound prints and prints with one fault each."""
    count = 2 if quick else 300
    planted = [(FIRST_FAULTY + k, FAULTS[(k // 3) % len(FAULTS)]) for k in range(count)]
    with ProcessPoolExecutor(os.cpu_count()) as pool:
        sound = list(pool.map(outcome, range(count), [None] * count, chunksize=3))
        faulty = list(pool.map(outcome, *zip(*planted, strict=True), chunksize=3))
    missed = [[one.seed, one.fault] for one in faulty if one.result == "missed"]
    more: Row = {"results": Counter(one.result for one in faulty), "missed": missed}
    yield limited("faulty prints missed silently", len(missed), f"of {count}", 0) | more
    beside = sum(one.false_mm > 0 for one in faulty)
    yield row("faulty prints with a false gap beside", beside, f"of {count}")
    repairs = [one.seed for one in sound if one.result == "repair"]
    more = {"results": Counter(one.result for one in sound), "seeds": repairs}
    yield limited("sound prints with a false repair", len(repairs), f"of {count}", 0) | more
    cpu = float(np.mean([one.cpu_s for one in (*sound, *faulty)]))
    yield row("a print, painting included", cpu, "CPU s")
