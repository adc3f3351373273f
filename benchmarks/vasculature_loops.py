"""Benchmark rows on closed loops: speed, joined terminals, collisions, containment, balance.

What is judged is the exported `network.csv`, by the checkers of `benchmarks.checkers`.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.checkers import loop_flows, near_pairs, pieces_outside, read_network, read_stl
from benchmarks.checkers.poiseuille import spread
from benchmarks.machine import row
from benchmarks.vasculature_checks import CLEARANCE_RATIO, DROP_PA, VISCOSITY_PA_S
from benchmarks.vasculature_runs import Case, GrowthFailedError, run_module

Row = dict[str, Any]
SEEDS = (1, 2, 3, 4, 5, 6)


@dataclass(frozen=True)
class LoopFindings:
    """Measures of one exported closed network.

    Attributes
    ----------
    segments, colliding_pairs, segments_outside : int
        Neither root's stem counts as outside: it has to pass the surface.
    overlaps_percent : float
        Pairs within joints, of segments.
    flow_spread : float
        (max - min) / mean of the connections' flows.
    """

    segments: int
    colliding_pairs: int
    overlaps_percent: float
    segments_outside: int
    flow_spread: float


def close(case: Case, out: Path) -> dict[str, Any]:
    """One run: what `benchmarks.vasculature_close` prints.

    Raises
    ------
    GrowthFailedError
        When the process fails or the product refuses.
    """
    words = ["--stl", str(case.stl), "--terminals", str(case.terminals)]
    words += ["--seed", str(case.seed), "--out", str(out)]
    return run_module(case.name, "benchmarks.vasculature_close", words)


def judge(path: Path, stl: Path) -> LoopFindings:
    """Run the checkers on an exported closed network and its tissue's STL."""
    net = read_network(path)
    near = near_pairs(net, clearance_ratio=CLEARANCE_RATIO)
    outside = pieces_outside(net, read_stl(stl)).pieces
    # The vein's root leaves the tissue as the artery's enters it.
    drains = np.isin(net.node[outside, 1], net.outlets())
    return LoopFindings(
        segments=net.count,
        colliding_pairs=len(near.colliding),
        overlaps_percent=100.0 * len(near.within_joints) / net.count,
        segments_outside=int((~drains).sum()),
        flow_spread=spread(loop_flows(net, DROP_PA, VISCOSITY_PA_S)),
    )


def loop_rows(case: Case, folder: Path, goal_s: float) -> Iterator[Row]:
    """All rows of one case."""
    out = folder / "loops.csv"
    run = close(case, out)
    value = run["tissue_s"] + run["forest_s"] + run["close_s"]
    timed = row(
        f"{case.name}: tissue, both trees, loops closed and audited",
        round(value, 2),
        "s",
        f"<= {goal_s:g}",
        value <= goal_s,
        {"name": "svv 0.0.57 (issue)", "value": 1.8, "unit": "s per connection"},
    )
    yield (
        timed
        | {"clock": "wall", "cpu_s": round(run["cpu_s"], 2)}
        | {key: round(run[key], 2) for key in ("tissue_s", "forest_s", "close_s")}
        | {"peak_gb": round(run["peak_mb"] / 1e3, 2)}
    )
    yield _joined(case.name, [run])
    yield from _faults(case.name, [judge(out, case.stl)])
    out.unlink()


def seed_rows(stl: Path, terminals: int, name: str, folder: Path) -> Iterator[Row]:
    """The same case with several seeds: what was joined, and the worst of each measure."""
    runs, found, refused = [], [], []
    for seed in SEEDS:
        case = Case(f"{name}, seed {seed}", stl, terminals, seed=seed)
        out = folder / "loops.csv"
        try:
            runs.append(close(case, out))
        except GrowthFailedError as error:
            refused.append(str(error))
            continue
        found.append(judge(out, stl))
    many = f"{name}, seeds {SEEDS[0]} to {SEEDS[-1]}"
    if refused:
        yield row(f"{many}: refused", len(refused), "runs", "0", False) | {"said": refused}
    if runs:
        yield _joined(many, runs) | {"close_s": [round(run["close_s"], 2) for run in runs]}
        yield from _faults(many, found)


def _joined(name: str, runs: list[dict[str, Any]]) -> Row:
    """How many terminals were joined, of all; the product may prune 1 % and says how many."""
    asked = sum(run["terminals"] for run in runs)
    joined = sum(run["connections"] for run in runs)
    share = joined / asked
    made = row(f"{name}: terminals joined", 100.0 * share, "%", ">= 99", share >= 0.99)
    keys = ("connections", "routed", "shortened", "pruned")
    return made | {key: [run[key] for run in runs] for key in keys}


def _faults(name: str, found: list[LoopFindings]) -> Iterator[Row]:
    """The worst of several runs."""
    for what, key, unit, limit in (
        ("colliding pairs", "colliding_pairs", "pairs", 0.0),
        ("overlaps within joints", "overlaps_percent", "% of segments", 2.0),
        ("segments out of tissue", "segments_outside", "segments", 0.0),
        ("flow spread of the loops, balanced", "flow_spread", "(max - min) / mean", 0.01),
    ):
        worst = max(getattr(one, key) for one in found)
        yield row(f"{name}: {what}", worst, unit, f"<= {limit:g}", worst <= limit)
