"""Prepare many tissues, grow a tree in each, and audit the trees independently."""

from __future__ import annotations

import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.checkers import near_pairs, pieces_outside, read_network
from benchmarks.machine import row
from design.errors import DesignError
from design.network import VesselKind
from design.network_files.csv_format import write_network_csv
from design.tissue import (
    BlockZone,
    CylinderZone,
    SphereZone,
    Surface,
    Zone,
    annulus,
    biventricle,
    block,
    carve,
    cylinder,
    folded_cortex,
    load_surface,
    tissue_from_surface,
)
from design.vasculature import GrowthOptions, grow_tree, tree_to_network

TERMINALS = 50
CLEARANCE_RATIO = 0.1
SHAPES = 105
PIECES = 100

Made = tuple[Surface, tuple[str, ...]]


@dataclass(frozen=True)
class Case:
    """One tissue: its name says its parameters."""

    name: str
    seed: int
    make: Callable[[], Made]


def battery(cortex: Path) -> Iterator[Case]:
    """Shapes with random parameters, a third of them with zones; then pieces of the cortex."""
    for seed in range(SHAPES):
        rng = np.random.default_rng([seed, 1])
        name, shape = _shape(seed % 5, rng)
        zones = _zones(shape, rng) if seed % 3 == 0 else []
        cut = f", {len(zones)} zones out" if zones else ""
        yield Case(f"{name}{cut} (seed {seed})", seed, partial(carve, shape, zones))
    if not cortex.is_file():
        return
    surface, _ = load_surface(cortex, "mm")
    for seed in range(PIECES):
        rng = np.random.default_rng([seed, 2])
        middle = surface.vertices[rng.integers(len(surface.vertices))]
        half = 0.5 * rng.uniform(10.0, 30.0, 3)
        low, high = (tuple((middle + sign * half).tolist()) for sign in (-1, 1))
        size = " x ".join(f"{2 * s:.1f}" for s in half)
        box = BlockZone(low, high)
        yield Case(f"cortex, box {size} (seed {seed})", seed, partial(carve, surface, (), [box]))


def _shape(kind: int, rng: np.random.Generator) -> tuple[str, Surface]:
    a, b, c = rng.uniform(5.0, 40.0, 3)
    if kind == 0:
        return f"block {a:.1f} x {b:.1f} x {c:.1f}", block((a, b, c))
    if kind == 1:
        return f"cylinder {a:.1f} wide, {b:.1f} high", cylinder(a, b)
    if kind == 2:
        inner = a * rng.uniform(0.2, 0.9)
        return f"annulus {a:.1f}, {inner:.1f} wide, {c:.1f} high", annulus(a, inner, c)
    if kind == 3:
        thick, fold, high = rng.uniform(1, 4), rng.uniform(12, 24), rng.uniform(0.5, 3)
        made = folded_cortex(thick, rng.uniform(8, 32), fold, high, rng.uniform(1, 3))
        return f"folded cortex {thick:.2f} thick, folds {fold:.1f}, {high:.1f} high", made
    length = rng.uniform(15.0, 90.0)
    return f"biventricle {length:.1f} long", biventricle(length)


def _zones(shape: Surface, rng: np.random.Generator) -> list[Zone]:
    """One to three needles, balls or blocks about the shape's box."""
    low, high = shape.vertices.min(axis=0), shape.vertices.max(axis=0)
    size = float(np.ptp(shape.vertices, axis=0).min())
    zones: list[Zone] = []
    for _ in range(rng.integers(1, 4)):
        one, two = (tuple(rng.uniform(low, high).tolist()) for _ in range(2))
        radius = float(rng.uniform(0.03, 0.15) * size)
        kind = rng.integers(3)
        if kind == 0:
            zones.append(CylinderZone(one, two, radius))
        elif kind == 1:
            zones.append(SphereZone(one, 2 * radius))
        else:
            far = tuple((np.array(one) + rng.uniform(1, 4, 3) * radius).tolist())
            zones.append(BlockZone(one, far))
    return zones


def tried(case: Case, folder: Path) -> tuple[str, str, float]:
    """What became of a case: ``""`` and all was well, or the step and the message; CPU seconds."""
    begin = time.process_time()
    step, message = "tissue", ""
    try:
        surface, notes = case.make()
        tissue = tissue_from_surface(surface.vertices, surface.faces, notes=notes)
        step = "growth"
        tree = grow_tree(tissue, GrowthOptions(terminals=TERMINALS, seed=case.seed))
        out = folder / "network.csv"
        write_network_csv(out, tree_to_network(tree, VesselKind.ARTERY))
        step, message = "audit", _audit(out, tissue.surface.vertices[tissue.surface.faces])
    except DesignError as error:
        message = str(error)
    return (step if message else ""), message, time.process_time() - begin


def _audit(out: Path, triangles: NDArray[np.float64]) -> str:
    """What independent checkers find wrong in an exported network, or nothing."""
    net = read_network(out)
    wrong = []
    outside = pieces_outside(net, triangles)
    if len(outside.pieces):
        wrong.append(
            f"{len(outside.pieces)} pieces outside, by up to {outside.excess_mm.max():g} mm"
        )
    if len(net.outlets()) != TERMINALS:
        wrong.append(f"{len(net.outlets())} terminals, not {TERMINALS}")
    collisions = near_pairs(net, clearance_ratio=CLEARANCE_RATIO).colliding
    if len(collisions):
        wrong.append(f"{len(collisions)} colliding pairs")
    return "; ".join(wrong)


def battery_row(cortex: Path) -> dict[str, Any]:
    """The row of the whole battery, failures with their messages."""
    failures, times = [], []
    with tempfile.TemporaryDirectory() as folder:
        for case in battery(cortex):
            step, message, seconds = tried(case, Path(folder))
            times.append(seconds)
            if len(times) % 25 == 0:
                print(
                    f"{len(times)} tissues, {len(failures)} failures", file=sys.stderr, flush=True
                )
            if step:
                failures.append({"tissue": case.name, "step": step, "message": message})
                print(f"{case.name}: {step}: {message}", file=sys.stderr, flush=True)
    count = len(times)
    share = 1.0 - len(failures) / count
    made = row(
        f"battery of {count} tissues: prepared, {TERMINALS} terminals grown, audited",
        round(share, 4),
        "of all",
        "200 tissues or more",
        count >= 200,
    )
    steps = [failure["step"] for failure in failures]
    return made | {
        "failures_by_step": {step: steps.count(step) for step in ("tissue", "growth", "audit")},
        "cpu_s": round(sum(times), 1),
        "slowest_cpu_s": round(max(times), 1),
        "failures": failures,
    }
