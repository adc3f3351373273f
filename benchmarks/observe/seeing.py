"""Layers seen by a camera: sound layers acted on, gaps found, gaps passed silently.

Pictures come from `benchmarks.checkers.layer_painter`, which shares nothing with the product.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor

import numpy as np

from benchmarks.checkers import layer_painter as painter
from benchmarks.common import Row, row
from printctl.inspection import ExpectedLines, LayerFindings, see_layer
from printctl.observe.deciding import GapTest

LENGTHS_MM = (0.2, 0.25, 0.3, 0.5, 1.0)
FIRST_SOUND, FIRST_FAULTY = 70_000, 9_000


def expected(plan: painter.Plan) -> ExpectedLines:
    """Return the plan as the product takes it."""
    count = len(plan.width)
    start, end = (np.column_stack([p, np.full(count, 0.3)]) for p in (plan.start, plan.end))
    return ExpectedLines(
        start, end, plan.width.astype(float), np.arange(count), plan.stroke.astype(np.int64),
        np.ones(count, dtype=bool),
    )  # fmt: skip


def seen(
    seed: int, kind: str, layout: str, um_per_px: float, size: float, lengths: tuple[float, ...]
) -> tuple[painter.Painted, LayerFindings]:
    """Paint a layer with gaps of these lengths, mm, and see it."""
    rng = np.random.default_rng(seed)
    plan = painter.plan_layer(layout, size, rng.uniform(0.2, 0.5), rng)
    look = painter.random_look(kind, rng, 0.3)
    gaps = painter.plant_gaps(plan, lengths, rng)
    ink = painter.lay(plan, rng, gaps=gaps)
    x, y = rng.uniform(-0.06, 0.06, 2)
    painted = painter.paint(plan, ink, gaps, size, um_per_px, look, rng, tilt=15, shift=(x, y))
    return painted, see_layer(painted.picture, painted.frame, expected(plan))


def sound(seed: int) -> tuple[bool, bool]:
    """Return whether a sound layer shows a gap, and one that a single picture would act on."""
    k = seed - FIRST_SOUND
    kind, layout = painter.KINDS[k % 4], painter.LAYOUTS[(k // 4) % 4]
    _, found = seen(seed, kind, layout, (12.0, 20.0, 35.0)[k % 3], 3.5, ())
    acted = any(GapTest().significant(gap, found.places) for gap in found.gaps)
    return bool(found.gaps), acted


def faulty(job: tuple[int, str]) -> tuple[int, int, int]:
    """Return how many gaps were planted in a layer, found, and passed though all was seen."""
    k, kind = job
    um = (10.0, 20.0, 40.0)[k % 3]
    layout, size = painter.LAYOUTS[(k // 2) % 4], 4.0 if um < 15 else 6.0
    painted, found = seen(FIRST_FAULTY + k, kind, layout, um, size, LENGTHS_MM[k % 3 :])
    hits = silent = 0
    at, half = found.stations.along_mm, 0.5 * found.stations.length_mm
    for stroke, begin, end in painted.gaps:
        hit = any(g.stroke == stroke and g.from_mm < end and g.to_mm > begin for g in found.gaps)
        own = (found.stations.stroke == stroke) & (at > begin - half) & (at < end + half)
        hits += hit
        silent += not hit and bool(own.any() and found.stations.seen[own].all())
    return len(painted.gaps), hits, silent


def rows(quick: bool) -> Iterator[Row]:
    """Yield sound layers of all painters, then gaps of opaque ink and of ridges lit aslant."""
    layers, each = (12, 4) if quick else (5000, 144)
    with ProcessPoolExecutor(os.cpu_count()) as pool:
        seeds = range(FIRST_SOUND, FIRST_SOUND + layers)
        shown, acted = np.array(list(pool.map(sound, seeds, chunksize=4))).T
        seeds_acted_on = [int(FIRST_SOUND + k) for k in np.flatnonzero(acted)]
        name, limit = "sound layers that one picture would be acted on", max(1, layers // 1000)
        made = row(name, int(acted.sum()), f"of {layers}", f"<= {limit}", acted.sum() <= limit)
        yield made | {"with_any_gap": int(shown.sum()), "seeds": seeds_acted_on}
        for kind, least in (("opaque", 0.95), ("relief", None)):
            jobs = [(k, kind) for k in range(each)]
            planted, hits, silent = np.sum(list(pool.map(faulty, jobs, chunksize=4)), axis=0)
            goal = () if least is None else (f">= {least:.0%}", hits >= least * planted)
            found = row(f"{kind}: gaps of 0.2 to 1 mm found", int(hits), f"of {planted}", *goal)
            yield found | {"seen_yet_passed": int(silent)}
