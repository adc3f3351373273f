"""Layers of a painter by a mind that never saw the product: gaps found, passed and false.

Single layers, stacks with a picture before, embedded lines and laser maps in five inks, half of
them sound. Pictures come from `benchmarks.checkers.scene_painter`, which shares nothing with the
product; seeds are those on which nothing was tuned.
"""

from __future__ import annotations

import os
import time
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass

import numpy as np

from benchmarks.checkers.scene_painter import INKS, KINDS, Scene, scene
from benchmarks.common import Row, row
from printctl.inspection import (
    ExpectedLines,
    LayerFindings,
    SeeingOptions,
    see_layer,
    surface_of,
)
from registration.files.readers.heights import HeightMap

LENGTHS_MM = (0.25, 0.5, 1.0)
FIRST = 400
NEAR_MM = 0.1
"""Along a stroke, by which a gap that is told may miss one that is there."""


@dataclass(frozen=True)
class View:
    """A scene's camera as a frame."""

    scene: Scene

    def to_pixels(self, points_mm: np.ndarray) -> np.ndarray:
        """Return pixels of places."""
        return np.asarray(self.scene.to_pixels(np.asarray(points_mm, dtype=float)), dtype=float)


@dataclass(frozen=True)
class Judged:
    """One scene: gaps planted, found, passed though seen, false; what is seen, and CPU seconds."""

    ink: str
    planted: int
    found: int
    silent: int
    false: int
    seen: float
    cpu_s: float


def lines_of(painted: Scene) -> ExpectedLines:
    """Return the plan as the product takes it."""
    plan = painted.expected
    start, end, width = (plan[key].astype(float) for key in ("start", "end", "width_mm"))
    stroke, fresh = plan["stroke"].astype(np.int64), plan["fresh"].astype(bool)
    return ExpectedLines(start, end, width, np.arange(len(width)), stroke, fresh)


def seen(painted: Scene, kind: str) -> LayerFindings:
    """See a scene."""
    lines = lines_of(painted)
    if kind != "laser":
        options = SeeingOptions(round_lines=kind == "embedded")
        return see_layer(
            painted.picture, View(painted), lines, before=painted.before, options=options
        )
    corner = painted.to_pixels(np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0.0]]))
    step = 1.0 / (corner[1, 0] - corner[0, 0])
    thickness = painted.expected["thickness_mm"]
    middle = lines.end[lines.fresh, 2].max() - 0.5 * thickness
    origin = (-corner[0, 0] * step, -corner[0, 1] * step)
    heights = HeightMap(np.asarray(painted.picture, np.float32), (step, step), origin)
    surface = surface_of(heights, np.eye(4), middle, thickness, lines)
    return see_layer(
        surface.picture, surface.frame, lines, hidden=surface.hidden, thickness_mm=thickness
    )


def judged(job: tuple[str, str, int]) -> Judged:
    """Paint a scene, with gaps where its seed is odd, and compare what is told with the truth."""
    kind, ink, seed = job
    rng = np.random.default_rng((seed, KINDS.index(kind), INKS.index(ink)))
    painted = scene(kind, ink, rng, {"gaps": list(LENGTHS_MM)} if seed % 2 else {})
    start = time.process_time()
    found = seen(painted, kind)
    cpu_s = time.process_time() - start
    planted, stations = painted.truth["gaps"], found.stations
    hits = silent = 0
    for stroke, begin, end in planted:
        hit = any(g.stroke == stroke and g.from_mm < end and g.to_mm > begin for g in found.gaps)
        half = 0.5 * stations.length_mm
        own = (stations.stroke == stroke) & (stations.along_mm > begin - half)
        own &= stations.along_mm < end + half
        hits += hit
        silent += not hit and bool(own.any() and stations.seen[own].all())
    false = sum(
        not any(
            stroke == gap.stroke and gap.from_mm < end + NEAR_MM and gap.to_mm > begin - NEAR_MM
            for stroke, begin, end in planted
        )
        for gap in found.gaps
    )
    return Judged(ink, len(planted), hits, silent, false, found.seen_share, cpu_s)


def rows(quick: bool) -> Iterator[Row]:
    """Yield gaps by kind of picture."""
    count = 2 if quick else 24
    with ProcessPoolExecutor(os.cpu_count()) as pool:
        for kind in KINDS:
            jobs = [(kind, ink, FIRST + k) for ink in INKS for k in range(count)]
            each = list(pool.map(judged, jobs))
            planted, found, silent, false = (
                sum(getattr(one, name) for one in each)
                for name in ("planted", "found", "silent", "false")
            )
            made = row(
                f"{kind}: gaps that passed though seen, and false ones", silent + false,
                f"in {len(each)} layers", "0", silent + false == 0,
            )  # fmt: skip
            yield made | {
                "planted": planted,
                "found": found,
                "silent": silent,
                "false": false,
                "found_by_ink": {
                    ink: f"{sum(one.found for one in own)} of {sum(one.planted for one in own)}"
                    for ink in INKS
                    for own in [[one for one in each if one.ink == ink]]
                },
                "seen_share": round(float(np.mean([one.seen for one in each])), 2),
                "median_cpu_s": round(float(np.median([one.cpu_s for one in each])), 2),
            }
