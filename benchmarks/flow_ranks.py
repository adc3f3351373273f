"""Flow on MPI ranks: 2 ranks against 1, direct against iterative solver, ours against plain.

Where FEniCSx isn't installed a row says so and nothing is measured. The case is a bent pipe with
a resistance at its end, steady Navier–Stokes at Re 13; meshes and comparisons are this file's.
"""

from __future__ import annotations

import importlib.util
import os
import statistics
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.command import Row
from benchmarks.flow_pipes import pipe_mesh
from benchmarks.machine import row
from design.hemodynamics.three_d.lumen_mesh import LumenMesh
from design.hemodynamics.three_d.ranks import (
    PortFlow,
    PortPressure,
    RankConditions,
    RankResult,
    write_case,
)
from printctl.analysis.flow.ranks import find_engine, run_on_ranks
from printctl.errors import PrintctlError

VISCOSITY, FLOW, RESISTANCE, DISTAL = 1e-3, 250.0 / 60.0, 2.0, 10.0
REPEATS = 3
# Rings across the pipe and layers along it.
SIZES = {"small": (3, 20), "middle": (4, 30), "large": (6, 60)}


def ranks_rows(quick: bool) -> Iterator[Row]:
    """2 ranks against 1, and what larger ones need."""
    try:
        engine = find_engine()
    except PrintctlError as exc:
        print(exc, file=sys.stderr)
        yield row(
            "ranks: not measured, no FEniCSx here (--only ranks says how to install it)", 0, ""
        )
        return
    with tempfile.TemporaryDirectory() as folder:
        case = _Case(Path(folder), engine.python)
        yield from _equal_rows(case, 1 if quick else REPEATS)
        yield from _embedded_rows(case)
        if not quick:
            yield from _growth_rows(case)


class _Case:
    """Solves sizes of the pipe, each once asked for."""

    def __init__(self, folder: Path, python: Path) -> None:
        self.folder, self.python = folder, python

    def solve(self, size: str, ranks: int, solver: str = "direct") -> RankResult:
        ports = PortFlow(FLOW), PortPressure(DISTAL, RESISTANCE)
        conditions = RankConditions(ports, VISCOSITY, solver=solver)  # type: ignore[arg-type]
        write_case(pipe(size), conditions, self.folder)
        return run_on_ranks(self.folder, ranks, self.python)


def pipe(size: str) -> LumenMesh:
    return pipe_mesh(0.2, 2.0, *SIZES[size], bend_rad=1.5)


def apart(one: Any, other: Any) -> float:
    """Largest difference by the largest value."""
    return float(np.abs(other - one).max() / np.abs(one).max())


def _equal_rows(case: _Case, repeats: int) -> Iterator[Row]:
    case.solve("small", 1)  # compiles
    found = {
        (solver, ranks): [case.solve("small", ranks, solver) for _ in range(repeats)]
        for solver in ("direct", "iterative")
        for ranks in range(1, 1 + min(2, os.cpu_count() or 1))
    }
    one = found["direct", 1][0]
    count = f"{one.report['unknowns']:,} unknowns"
    for (solver, ranks), runs in found.items():
        name = f"ranks: {count}, {solver}, {ranks}"
        if runs[0] is not one:
            error = apart(one.pressure, runs[0].pressure)
            yield row(f"{name}: pressure from direct on 1", error, "", "<= 1e-6", error <= 1e-6)
        spent = statistics.median(run.report["solve_s"] for run in runs)
        yield row(f"{name}: solve", spent, "s")
        yield row(f"{name}: memory of a rank", max(runs[0].report["memory_mb"]), "MB")
        if ranks == 2:
            alone = statistics.median(r.report["solve_s"] for r in found[solver, 1])
            yield row(f"{name}: time by that of 1", spent / alone, "")
        if solver == "iterative":
            steps = runs[0].report["steps"]
            yield row(f"{name}: iterations a solve", _iterations(steps), "")


def _iterations(steps: list[dict[str, Any]]) -> float:
    """Of the last of Newton's steps, whose two solves are flow and resistance."""
    return float(steps[-1]["iterations"] / 2)


def _growth_rows(case: _Case) -> Iterator[Row]:
    """What a rank needs as the case grows, by the iterative solver on all processors."""
    ranks = min(2, os.cpu_count() or 1)
    for size in SIZES:
        for solver in ("direct", "iterative"):
            if (size, solver) == ("large", "direct"):
                continue
            found = case.solve(size, ranks, solver)
            name = f"ranks: {found.report['unknowns']:,} unknowns, {solver}, {ranks}"
            yield row(f"{name}: solve", found.report["solve_s"], "s")
            yield row(f"{name}: memory of all ranks", sum(found.report["memory_mb"]), "MB")
            if solver == "iterative":
                yield row(f"{name}: iterations a solve", _iterations(found.report["steps"]), "")


def _embedded_rows(case: _Case) -> Iterator[Row]:
    """The same mesh, elements and weak form by NGSolve, where it is installed."""
    if importlib.util.find_spec("ngsolve") is None or (
        importlib.util.find_spec("design.hemodynamics.three_d.steady") is None
    ):
        yield row("ranks: not compared with the embedded engine, which isn't installed", 0, "")
        return
    steady = importlib.import_module("design.hemodynamics.three_d.steady")
    from design.hemodynamics import PulsatileConditions, ResistanceOutlet
    from design.hemodynamics.waveforms import Constant

    outlet = ResistanceOutlet(RESISTANCE, DISTAL)
    conditions = PulsatileConditions(VISCOSITY, Constant(FLOW), outlet=outlet)
    options = importlib.import_module("design.hemodynamics.three_d.options").FlowOptions
    theirs = steady.solve_steady(pipe("small"), conditions, options(order=2, tolerance=1e-10))
    ours = case.solve("small", 1)
    count = f"{ours.report['unknowns']:,} unknowns"
    for name, one, other in (
        ("pressure at ports", theirs.port_pressure, ours.port_pressure),
        ("flow at ports", theirs.port_flow, ours.port_flow),
        (
            "pressure anywhere",
            theirs.field.pressure[:, :, 0],
            ours.pressure[pipe("small").tets[:, :4]],
        ),
    ):
        error = apart(one, other)
        yield row(f"ranks: {count}: {name}, from the embedded engine's", error, "",
                  "<= 1e-6", error <= 1e-6)  # fmt: skip
    finer = steady.solve_steady(pipe("small"), conditions, options(order=3))
    error = apart(finer.port_pressure, ours.port_pressure)
    yield row(f"ranks: {count}: pressure at ports, from the embedded engine's next order", error,
              "", "<= 0.005", error <= 0.005)  # fmt: skip
