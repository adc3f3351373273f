"""Growth at organ scale: time, memory and correctness of trees and closed loops.

Every run has a process of its own (`worker`); what is checked is the exported `network.csv`, by the
checkers. Goals are held against the wall clock; ``cpu_s`` beside it is without neighbours' share.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

from benchmarks.checkers import (
    box_triangles,
    loop_flows,
    near_pairs,
    outlet_flows,
    pieces_outside,
    read_network,
    read_stl,
    spread,
    write_stl,
)
from benchmarks.common import (
    DATA,
    Row,
    SkippedError,
    at_least,
    limited,
    needed,
    row,
    run_module,
    scratch,
)
from benchmarks.vasculature.checks import CLEARANCE_RATIO, DROP_PA, VISCOSITY_PA_S, check, rows_of
from benchmarks.vasculature.peer import grow_svv
from benchmarks.vasculature.worker import LUMEN_MM, WALL_MM

CUBE_MM = 10.0
CUBE_ROOT = (CUBE_MM / 2, CUBE_MM / 2, CUBE_MM, 0.0, 0.0, -1.0)
PRINTED_LENGTH_MM = 60.0
ROUNDING_MM = 1e-9
GYRUS, VENTRICLES = "gyrus_patch_fsaverage5.stl", "biventricle_svv.stl"


def _run(way: str, stl: Path, terminals: int, out: Path, *root: float, seed: int = 1) -> Row:
    return run_module("benchmarks.vasculature.worker", way, stl, terminals, seed, out, *root)


def _time(name: str, run: Row, goal_s: float | None = None) -> Row:
    """Return tissue plus growth, audited."""
    made = limited(f"{name}: tissue, growth, audit", run["tissue_s"] + run["growth_s"], "s", goal_s)
    return made | {key: round(run[key], 2) for key in ("tissue_s", "cpu_s", "growth_cpu_s")}


def _tree_rows(
    where: str, mesh: str, terminals: int, goal_s: float, goal_gb: float | None = None
) -> Iterator[Row]:
    """Yield time, memory and the checkers' findings of one tree."""
    name, stl = f"{where} {terminals:,}", needed(DATA / mesh)
    with scratch() as folder:
        out = folder / "network.csv"
        run = _run("tree", stl, terminals, out)
        yield _time(name, run, goal_s)
        yield limited(f"{name}: peak memory, file and all", run["peak_mb"] / 1e3, "GB", goal_gb)
        yield from rows_of(name, terminals, check(out, stl, run["flow_ul_s"]))


def gyrus_rows(quick: bool) -> Iterator[Row]:
    """Yield 8,000 terminals in a patch of cortex."""
    return _tree_rows("gyrus", GYRUS, 8000, 5.0)


def biventricle_rows(quick: bool) -> Iterator[Row]:
    """Yield a large tree in both ventricles."""
    return _tree_rows("biventricle", VENTRICLES, 20_000 if quick else 100_000, 15.0)


def million_rows(quick: bool) -> Iterator[Row]:
    """Yield a million terminals."""
    return _tree_rows("biventricle", VENTRICLES, 1_000_000, 45.0)


def ten_million_rows(quick: bool) -> Iterator[Row]:
    """Yield ten million terminals."""
    return _tree_rows("biventricle", VENTRICLES, 10_000_000, 480.0, 5.0)


def cube_rows(quick: bool) -> Iterator[Row]:
    """Yield a cube beside svv, unless quick: same cube, root, flow, pressures."""
    terminals = 2000 if quick else 8000
    name = f"cube {terminals:,}"
    with scratch() as folder:
        stl, ours, theirs = (folder / each for each in ("cube.stl", "ours.csv", "svv.csv"))
        write_stl(stl, box_triangles(np.zeros(3), np.full(3, CUBE_MM)))
        run = _run("tree", stl, terminals, ours, *CUBE_ROOT)
        yield _time(name, run)
        found = check(ours, stl, run["flow_ul_s"])
        if quick:
            yield from rows_of(name, terminals, found)
            return
        try:
            svv = grow_svv(terminals, CUBE_MM, run["flow_ul_s"], theirs)
        except SkippedError as skipped:
            yield from rows_of(name, terminals, found)
            yield {"measure": f"{name}: svv", "skipped": str(skipped)}
            return
        after = _run("tree", stl, terminals, ours, *CUBE_ROOT)
        ratio = (run["growth_s"] + after["growth_s"]) / 2 / svv["growth_s"]
        peer = {"name": "svv 0.0.57, with svv-accelerated", "value": svv["growth_s"], "unit": "s"}
        made = row(f"{name}: growth over svv's", ratio, "", "<= 1/30", ratio <= 1 / 30, peer)
        yield made | {"cpu_ratio": run["growth_cpu_s"] / svv["growth_cpu_s"]}
        yield from rows_of(name, terminals, found, check(theirs, stl, run["flow_ul_s"]))


def loop_rows(quick: bool) -> Iterator[Row]:
    """Yield closed loops in a patch of cortex, and unless quick in both ventricles."""
    gyrus, name = needed(DATA / GYRUS), "closed loops 2 x 500, gyrus"
    for seed in (1,) if quick else range(1, 7):
        yield from _loops(f"{name}, seed {seed}", gyrus, 500, 10.0, seed)
    if not quick:
        name = "closed loops 2 x 10,000, biventricle"
        yield from _loops(name, needed(DATA / VENTRICLES), 10_000, 240.0, 1)


def _loops(name: str, stl: Path, terminals: int, goal_s: float, seed: int) -> Iterator[Row]:
    with scratch() as folder:
        out = folder / "loops.csv"
        run = _run("loops", stl, terminals, out, seed=seed)
        yield _time(name, run, goal_s)
        share = 100.0 * run["connections"] / terminals
        joined = at_least(f"{name}: terminals joined", share, "%", 99)
        yield joined | {"pruned": run["pruned"]}
        net = read_network(out)
        near = near_pairs(net, clearance_ratio=CLEARANCE_RATIO)
        outside = pieces_outside(net, read_stl(stl)).pieces
        # The vein's root has to leave the tissue, as the artery's enters it.
        strays = int((~np.isin(net.node[outside, 1], net.outlets())).sum())
        yield limited(f"{name}: colliding pairs", len(near.colliding), "pairs", 0)
        overlaps = 100.0 * len(near.within_joints) / net.count
        yield limited(f"{name}: overlaps within joints", overlaps, "% of segments", 2.0)
        yield limited(f"{name}: segments out of tissue", strays, "segments", 0)
        flows = loop_flows(net, DROP_PA, VISCOSITY_PA_S)
        yield limited(f"{name}: flow spread of the loops", spread(flows), "of the mean", 0.01)


def printable_rows(quick: bool) -> Iterator[Row]:
    """Yield trees in the biventricle at 60 mm, as the paper's printer can make them."""
    triangles = read_stl(needed(DATA / VENTRICLES))
    triangles *= PRINTED_LENGTH_MM / np.ptp(triangles.reshape(-1, 3), axis=0).max()
    for terminals in (100,) if quick else (500, 2000):
        with scratch() as folder:
            stl, out = folder / "biventricle.stl", folder / "printable.csv"
            write_stl(stl, triangles)
            run = _run("printable", stl, terminals, out)
            net = read_network(out)
        name = f"printable {terminals:,} in the biventricle at 60 mm"
        near = near_pairs(net, clearance_mm=WALL_MM).colliding
        walled = replace(net, radius=net.radius + WALL_MM)  # a lumen's wall must be in tissue, too
        faults = {
            "lumens_below_0.4_mm": int((net.radius < LUMEN_MM / 2 - ROUNDING_MM).sum()),
            "walls_below_0.3_mm_between_vessels": len(near),
            "walls_below_0.3_mm_to_the_surface": len(pieces_outside(walled, triangles).pieces),
        }
        yield limited(f"{name}: violations", sum(faults.values()), "", 0) | faults
        goal = (f"{terminals}", len(net.outlets()) == terminals) if terminals <= 500 else ()
        yield row(f"{name}: terminals reached", len(net.outlets()), "", *goal)
        yield _time(name, run)
        flows = outlet_flows(net, run["drop_pa"], run["viscosity_pa_s"])
        yield row(f"{name}: terminal flow spread", spread(flows), "(max - min) / mean")
