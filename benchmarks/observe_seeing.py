"""Measure layer seeing: gaps found, false findings, width intervals, time.

python -m benchmarks.observe_seeing [--quick]
    [--only gaps|lengths|false|troubles|widths|dark|time|oct]

Pictures and volumes come from `benchmarks/checkers/layer_painter.py`, `layer_troubles.py` and
`layer_volume.py`, which share nothing with the product.
"""

from __future__ import annotations

import os
import time
from collections import defaultdict
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from itertools import product
from pathlib import Path
from typing import NamedTuple

import numpy as np

from benchmarks.checkers import layer_painter as painter
from benchmarks.checkers import layer_troubles as trouble
from benchmarks.checkers.layer_volume import paint_volume
from benchmarks.command import Row, run
from benchmarks.machine import row
from printctl.observe.deciding import GapTest
from registration.inspection import ExpectedLines, LayerFindings, height_map, see_layer
from registration.scan import Scan

CLEAR = ("opaque", "absorbing")


def expected(plan: painter.Plan, z_mm: float = 0.3) -> ExpectedLines:
    """The plan as the product takes it."""
    count = len(plan.width)
    start, end = (np.column_stack([p, np.full(count, z_mm)]) for p in (plan.start, plan.end))
    return ExpectedLines(
        start, end, plan.width.astype(float), np.arange(count), plan.stroke.astype(np.int64),
        np.ones(count, dtype=bool),
    )  # fmt: skip


def layer(
    seed: int,
    kind: str,
    layout: str,
    um_per_px: float,
    gaps_mm: tuple[float, ...] = (),
    size: float = 5.0,
    ratio: float = 1.0,
) -> tuple[painter.Painted, np.ndarray]:
    """Paint a layer; its own shift with it."""
    rng = np.random.default_rng(seed)
    plan = painter.plan_layer(layout, size, rng.uniform(0.2, 0.5), rng)
    look = painter.random_look(kind, rng, 0.3)
    gaps = painter.plant_gaps(plan, gaps_mm, rng)
    ink = painter.lay(plan, rng, ratio=ratio, gaps=gaps)
    shift = rng.uniform(-0.06, 0.06, 2)
    return painter.paint(
        plan, ink, gaps, size, um_per_px, look, rng, tilt=15, shift=(shift[0], shift[1])
    ), shift


def gaps(quick: bool) -> Iterator[Row]:
    """Share of planted gaps found, by length, 10 to 40 µm per pixel, moderate contrast."""
    lengths = (0.2, 0.25, 0.3, 0.5, 1.0)
    for um in (10.0, 20.0, 40.0):
        hits, off = defaultdict(list), []
        for k in range(8 if quick else 48):
            painted, _ = layer(
                9_000 + k, CLEAR[k % 2], painter.LAYOUTS[(k // 2) % 4], um, lengths[k % 3 :],
                size=4.0 if um < 15 else 6.0,
            )  # fmt: skip
            findings = see_layer(painted.picture, painted.frame, expected(painted.plan))
            for stroke, begin, end in painted.gaps:
                own = [
                    gap
                    for gap in findings.gaps
                    if gap.stroke == stroke and gap.from_mm < end and gap.to_mm > begin
                ]
                hits[round(end - begin, 2)].append(bool(own))
                off += [(gap.length_mm - (end - begin)) * 1e3 for gap in own]
        every = [hit for found in hits.values() for hit in found]
        yield row(
            f"gaps of 0.2 to 1 mm found, {um:g} µm per px ({len(every)})",
            round(float(np.mean(every)), 3), "", ">= 0.95", float(np.mean(every)) >= 0.95,
        ) | {
            "by_length_mm": {
                k: [round(float(np.mean(v)), 3), len(v)] for k, v in sorted(hits.items())
            },
            "length_error_um": [round(float(np.median(off)), 1), round(float(np.std(off)), 1)],
        }  # fmt: skip


def lengths(quick: bool) -> Iterator[Row]:
    """Share of gaps' true lengths within their intervals, ends round and square."""
    for ends in ("round", "square"):
        off, u = [], []
        for k in range(8 if quick else 40):
            rng = np.random.default_rng(60_000 + k)
            plan = painter.plan_layer(("rings", "meander", "waves")[k % 3], 5.0, 0.3, rng)
            look = painter.random_look(CLEAR[k % 2], rng, 0.3)
            look.blur_px = float(rng.uniform(0.5, 2.0))
            gaps = painter.plant_gaps(plan, (0.3, 0.5, 1.0), rng)
            ink = painter.lay(plan, rng, gaps=gaps)
            painted = painter.paint(
                plan, ink, gaps, 5.0, (15.0, 20.0, 30.0)[k % 3], look, rng,
                round_ends=ends == "round",
            )  # fmt: skip
            for gap in see_layer(painted.picture, painted.frame, expected(plan)).gaps:
                for stroke, begin, end in gaps:
                    if gap.stroke == stroke and gap.from_mm < end and gap.to_mm > begin:
                        off.append(gap.length_mm - (end - begin))
                        u.append(gap.u_length_mm)
        held = float(np.mean(np.abs(off) < 2.0 * np.array(u)))
        yield row(
            f"lengths of gaps with {ends} ends within 2 u ({len(off)})", round(held, 3), "",
            ">= 0.9", held >= 0.9,
        ) | {"error_um": [round(1e3 * float(np.mean(off)), 1), round(1e3 * float(np.std(off)), 1)],
             "u_um": round(1e3 * float(np.mean(u)), 1)}  # fmt: skip


def false(quick: bool) -> Iterator[Row]:
    """Findings on sound layers of all painters, and gaps that would be acted on."""
    count = 40 if quick else 5000
    with ProcessPoolExecutor(os.cpu_count()) as pool:
        layers = list(pool.map(_sound_layer, range(70_000, 70_000 + count), chunksize=10))
    told = {
        name: [one.seed for one in layers if getattr(one, name)]
        for name in ("gaps", "acted_on", "stretches", "blobs")
    }
    acted = told["acted_on"]
    yield row(
        f"layers with a false gap that one picture would be mended by, of {count} sound ones",
        len(acted), "layers", "<= 1 in 1,000", len(acted) <= max(1, count // 1000),
    ) | {
        "seeds": acted, "any_gap": told["gaps"][:20], "thin_or_thick": len(told["stretches"]),
        "blobs": len(told["blobs"]),
        "seen_share": round(float(np.mean([one.seen_share for one in layers])), 3),
    }  # fmt: skip


class SoundLayer(NamedTuple):
    """What was found on a sound layer."""

    seed: int
    gaps: bool
    acted_on: bool
    stretches: bool
    blobs: bool
    seen_share: float


def _sound_layer(seed: int) -> SoundLayer:
    k = seed - 70_000
    painted, _ = layer(
        seed, painter.KINDS[k % 4], painter.LAYOUTS[(k // 4) % 4], (12.0, 20.0, 35.0)[k % 3],
        size=3.5,
    )  # fmt: skip
    f = see_layer(painted.picture, painted.frame, expected(painted.plan))
    acted = any(GapTest().significant(gap, f.places) for gap in f.gaps)
    return SoundLayer(seed, bool(f.gaps), acted, bool(f.stretches), bool(f.blobs), f.seen_share)


def troubled(seed: int, kind: str) -> painter.Painted:
    """Paint a layer with gaps under a shadow bar, of crossing translucent lines, or with crumbs."""
    rng = np.random.default_rng([31, seed])
    size, um, width = 5.0, (15.0, 25.0, 35.0)[seed % 3], rng.uniform(0.25, 0.5)
    crossing = kind == "crossings"
    plan = (
        trouble.grid(size, width, rng)
        if crossing
        else painter.plan_layer(painter.LAYOUTS[(seed // 2) % 4], size, width, rng)
    )
    look = painter.random_look("absorbing" if crossing else CLEAR[seed % 2], rng, 0.3)
    if crossing and sum(look.ink) > sum(look.bath):  # what absorbs is darker
        look.ink, look.bath = look.bath, look.ink
    lengths: tuple[float, ...] = ((), (0.3, 0.5), (0.25, 1.0))[seed % 3]
    gaps = painter.plant_gaps(plan, lengths * 4 if crossing else lengths, rng)
    gaps = trouble.bare(plan, gaps) if crossing else gaps
    ink = painter.lay(plan, rng, gaps=gaps)
    fine = 1.6
    overlay = trouble.Troubles(
        bars=[trouble.random_bar(size, rng)] if kind == "shadow" else [],
        crumbs=trouble.random_crumbs(ink, 5, 0.8, rng) if kind == "crumbs" else [],
        extra=trouble.piled(ink, gaps, (0.0, 0.0), size, um * 1e-3 / fine, look)
        if crossing
        else None,
    )
    return painter.paint(plan, ink, gaps, size, um, look, rng, fine=fine, overlay=overlay)


def troubles(quick: bool) -> Iterator[Row]:
    """Share seen, gaps found where seen and false gaps, under three kinds of trouble."""
    count = 12 if quick else 60
    for kind in ("shadow", "crossings", "crumbs"):
        seen, found, missed, false_gaps = [], 0, 0, 0
        for k in range(count):
            painted = troubled(50_000 + k, kind)
            f = see_layer(painted.picture, painted.frame, expected(painted.plan))
            seen.append(f.seen_share)
            for stroke, begin, end in painted.gaps:
                hit = any(
                    g.stroke == stroke and g.from_mm < end and g.to_mm > begin for g in f.gaps
                )
                found += hit
                missed += not hit and _all_seen(f, stroke, begin, end)
            false_gaps += sum(
                not any(g.stroke == s and g.from_mm < e and g.to_mm > b for s, b, e in painted.gaps)
                for g in f.gaps
            )
        share = found / max(1, found + missed)
        limit = max(1, count // 12) if kind == "crumbs" else 0
        yield row(
            f"{kind}: gaps found where lines are seen, {count} layers", round(share, 3), "",
            ">= 0.95", share >= 0.95 and false_gaps <= limit,
        ) | {
            "seen_share": round(float(np.mean(seen)), 3), "found": found, "missed": missed,
            "false_gaps": false_gaps,
        }  # fmt: skip


def _all_seen(f: LayerFindings, stroke: int, begin: float, end: float) -> bool:
    """Whether every station of a stretch was seen."""
    at, half = f.stations.along_mm, 0.5 * f.stations.length_mm
    own = (f.stations.stroke == stroke) & (at > begin - half) & (at < end + half)
    return bool(own.any() and f.stations.seen[own].all())


def widths(quick: bool) -> Iterator[Row]:
    """Share of true widths, ratios and shifts within 95 % intervals."""
    inside: dict[str, list[float]] = defaultdict(list)
    ratios, shifts = [], []
    errors: dict[str, list[float]] = defaultdict(list)
    for k in range(9 if quick else 60):
        kind = ("opaque", "absorbing", "rims")[k % 3]
        layout = ("rings", "meander", "waves")[(k // 3) % 3]
        true_ratio = float(np.random.default_rng(k).uniform(0.85, 1.15))
        painted, shift = layer(
            40_000 + k, kind, layout, (10.0, 20.0, 30.0)[k % 3], ratio=true_ratio
        )
        f = see_layer(painted.picture, painted.frame, expected(painted.plan))
        known = np.flatnonzero(np.isfinite(f.stations.width_mm))
        if not len(known):
            continue
        true = _true_widths(painted, f, known)
        z = (f.stations.width_mm[known] - true) / f.stations.u_width_mm[known]
        inside[kind].append(float(np.mean(np.abs(z) < 1.96)))
        off = f.width_ratio - float(np.median(true / f.stations.expected_mm[known]))
        errors[kind].append(off)
        ratios.append(abs(off) < 1.96 * f.u_width_ratio)
        moved = (f.shift.dx_mm - shift[0], f.shift.dy_mm - shift[1])
        shifts += [abs(d) < 1.96 * u for d, u in zip(moved, f.shift.u_mm, strict=True)]
    for kind, shares in inside.items():
        mean = float(np.mean(shares))
        yield row(
            f"widths within their 95 % interval, {kind} ({len(shares)} layers)", round(mean, 3), "",
            ">= 0.93", mean >= 0.93,
        )  # fmt: skip
    for name, held in (("ratios", ratios), ("shifts", shifts)):
        mean = float(np.mean(held))
        yield row(
            f"{name} within their 95 % interval", round(mean, 3), "", ">= 0.93", mean >= 0.93
        ) | {
            "rms_error_of_ratios": {
                kind: round(float(np.sqrt(np.mean(np.square(off)))), 4)
                for kind, off in errors.items()
            }
        }


def dark(quick: bool) -> Iterator[Row]:
    """Widths of ink that takes away light, by density and blur."""
    off, told, inside = [], [], []
    for k in range(10 if quick else 60):
        rng = np.random.default_rng(70_000 + k)
        plan = painter.plan_layer(("rings", "meander", "waves")[k % 3], 4.0, 0.3, rng)
        look = painter.random_look("absorbing", rng)
        density = float(np.exp(rng.uniform(np.log(0.1), np.log(2.0))))
        # The painter's beads are 1.3 times as dense as its ink is dark.
        look.ink = tuple(np.array(look.bath) * np.exp(-density / 1.3))
        look.blur_px = float(rng.uniform(0.5, 2.5))
        ink = painter.lay(plan, rng, ratio=rng.uniform(0.85, 1.15))
        painted = painter.paint(plan, ink, [], 4.0, (15.0, 20.0, 30.0)[k % 3], look, rng)
        f = see_layer(painted.picture, painted.frame, expected(plan))
        known = np.flatnonzero(np.isfinite(f.stations.width_mm))
        if len(known):
            error = f.stations.width_mm[known] / _true_widths(painted, f, known) - 1.0
            u = f.stations.u_width_mm[known] / f.stations.expected_mm[known]
            off.append(float(np.median(error)))
            told.append(float(np.median(u)))
            inside.append(float(np.mean(np.abs(error) < 1.96 * u)))
    mean, held = 100.0 * float(np.mean(off)), float(np.mean(inside))
    yield row(
        f"dark ink of density 0.1 to 2, blur 0.5 to 2.5 px: widths off ({len(off)} layers)",
        round(mean, 2), "%", "within 2", abs(mean) <= 2.0,
    ) | {"rms_percent": round(100.0 * float(np.sqrt(np.mean(np.square(off)))), 2),
         "u_percent": round(100.0 * float(np.mean(told)), 2)}  # fmt: skip
    yield row(
        "dark ink: widths within their 95 % interval", round(held, 3), "", ">= 0.93", held >= 0.93
    )


def _true_widths(painted: painter.Painted, f: LayerFindings, known: np.ndarray) -> np.ndarray:
    out = []
    for k in known:
        own = painted.stroke == f.stations.stroke[k]
        out.append(np.interp(f.stations.along_mm[k], painted.along[own], painted.laid[own]))
    return np.array(out)


def eight_megapixels(quick: bool) -> Iterator[Row]:
    """CPU time of a layer of 20 x 20 mm, of dark ink and of ridges lit from the side."""
    for kind, layout in product(
        ("absorbing", "relief"), ("meander", "filled")[: 1 if quick else 2]
    ):
        rng = np.random.default_rng(5)
        plan = painter.plan_layer(layout, 20.0, 0.3, rng)
        light = painter.random_look(kind, rng, 0.3)
        ink = painter.lay(plan, rng)
        painted = painter.paint(plan, ink, [], 20.0, 8.1, light, rng, tilt=10, fine=1.0)
        look = partial(see_layer, painted.picture, painted.frame, expected(painted.plan))
        look()  # compiled or loaded once
        spent = _best_of(3, look)
        high, wide = painted.picture.shape[:2]
        what = "lit ridges" if kind == "relief" else "dark ink"
        yield row(
            f"20 x 20 mm, {layout}, {what}, {high * wide / 1e6:.1f} megapixels, colour",
            round(spent, 2), "CPU s", "<= 2 s on two cores", spent <= 2.0,
        )  # fmt: skip


def oct_volume(quick: bool) -> Iterator[Row]:
    """CPU time and findings of a volume of 500 x 500 x 100."""
    rng = np.random.default_rng(3)
    plan = painter.plan_layer("waves", 9.0, 0.3, rng)
    planted = painter.plant_gaps(plan, (0.3, 0.5, 1.0), rng)
    volume, to_scan = paint_volume(plan, painter.lay(plan, rng, gaps=planted), planted, rng)
    scan = Scan(volume, (0.01, 0.02, 0.02), 1.0, False, "linear", "oct", True, Path("painted"))
    found: list[LayerFindings] = []

    def look() -> None:
        picture, frame = height_map(scan, to_scan, 0.3, 0.25)
        found.append(see_layer(picture, frame, expected(plan)))

    spent = _best_of(3, look)
    yield row("OCT 500 x 500 x 100", round(spent, 2), "CPU s", "<= 4 s on two cores", spent <= 4.0)
    gaps_found = sum(
        any(g.stroke == s and g.from_mm < e and g.to_mm > b for g in found[0].gaps)
        for s, b, e in planted
    )
    told = [round(found[0].width_ratio, 3), round(found[0].u_width_ratio, 3)]
    good = gaps_found == len(planted) == len(found[0].gaps)
    yield row("OCT: gaps found", gaps_found, f"of {len(planted)}", "all", good) | {
        "width_ratio": told
    }


def _best_of(times: int, job: Callable[[], object]) -> float:
    spent = []
    for _ in range(times):
        began = time.process_time()
        job()
        spent.append(time.process_time() - began)
    return min(spent)


if __name__ == "__main__":
    run(
        {
            "gaps": gaps,
            "lengths": lengths,
            "false": false,
            "troubles": troubles,
            "widths": widths,
            "dark": dark,
            "time": eight_megapixels,
            "oct": oct_volume,
        },
        __doc__,
    )
