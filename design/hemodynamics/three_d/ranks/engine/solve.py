"""Solve a 3D flow case on MPI ranks, from reading its files to writing its result."""

from __future__ import annotations

import json
import time
from pathlib import Path

import dolfinx

from .newton import newton
from .problem import problem_of
from .results import port_rows, write_field, write_report
from .world import WORLD, peak_mb, say

DIRECT_UNKNOWNS = 150_000
"""From where ``auto`` takes multigrid: a factor's memory grows faster than the unknowns."""


def solve_case(folder: Path) -> None:
    """Solve, and write `velocity.npy`, `pressure.npy` and, last, `ranks.json`."""
    begun = time.perf_counter()
    case = json.loads((folder / "case.json").read_text(encoding="utf-8"))
    problem = problem_of(folder, case)
    ready = time.perf_counter()
    kind = case["solver"]
    if kind == "auto":
        kind = "direct" if problem.unknowns <= DIRECT_UNKNOWNS else "iterative"
    say(
        f"FEniCSx {dolfinx.__version__}, {WORLD.size} ranks, {problem.unknowns:,} unknowns, "
        f"{case['model']}, {kind}; ready after {ready - begun:.1f} s"
    )
    steps = newton(problem, kind, case["tolerance"])
    solved = time.perf_counter()
    ports = port_rows(problem)
    write_field(folder / "velocity.npy", problem, problem.velocity, (case["nodes"], 3))
    write_field(folder / "pressure.npy", problem, problem.pressure, (case["corners"],))
    report = {
        "case": case["id"],
        "dolfinx": dolfinx.__version__,
        "ranks": WORLD.size,
        "unknowns": problem.unknowns,
        "solver": kind,
        "steps": steps,
        "ports": ports,
        "setup_s": ready - begun,
        "solve_s": solved - ready,
        "total_s": time.perf_counter() - begun,
        "memory_mb": WORLD.allgather(peak_mb()),
    }
    write_report(folder / "ranks.json", report)
    say(f"done after {time.perf_counter() - begun:.1f} s")
