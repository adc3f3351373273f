"""Run the product's growth in separate processes."""

from __future__ import annotations

import json
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path
from statistics import median
from typing import Any

from benchmarks.machine import ROOT, row


class GrowthFailedError(Exception):
    """The product refused or broke, and what it said."""


@dataclass(frozen=True)
class Case:
    """What is grown in what.

    Attributes
    ----------
    name : str
        As the rows call it.
    stl : Path
    terminals : int
    root : tuple of 6 floats, optional
        Point and direction, mm; the product's default is the case that `SOURCES.md` fixes.
    """

    name: str
    stl: Path
    terminals: int
    root: tuple[float, ...] | None = None
    seed: int = 1


def grow(case: Case, out: Path | None = None, *more: str) -> dict[str, Any]:
    """One run: what `benchmarks.vasculature_grow` prints; ``more`` are further words for it.

    Raises
    ------
    GrowthFailedError
        When the process fails or the product refuses.
    """
    words = ["--stl", str(case.stl), "--terminals", str(case.terminals), "--seed", str(case.seed)]
    words += ["--root", *map(str, case.root)] if case.root else []
    words += ["--out", str(out)] if out else []
    words += more
    return run_module(case.name, "benchmarks.vasculature_grow", words)


def run_module(name: str, module: str, words: list[str]) -> dict[str, Any]:
    """Run a module in a process of its own; the JSON object it prints last.

    Raises
    ------
    GrowthFailedError
        When the process fails or the product refuses.
    """
    print(f"{name} ...", file=sys.stderr, flush=True)
    command = [sys.executable, "-m", module, *words]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    if done.returncode:
        said = done.stderr.strip().splitlines() or [f"exit code {done.returncode}"]
        raise GrowthFailedError(f"{name}: {said[-1]}")
    found: dict[str, Any] = json.loads(done.stdout.strip().splitlines()[-1])
    if "error" in found:
        raise GrowthFailedError(f"{name}: {found['error']}")
    return found


def grow_often(case: Case, out: Path, times: int = 3) -> dict[str, Any]:
    """Medians of several runs; the file of the last (all are alike) stays."""
    runs = [grow(case, out) for _ in range(times)]
    numbers = [key for key, value in runs[0].items() if not isinstance(value, str)]
    return {key: median(run[key] for run in runs) for key in numbers} | {"runs": times}


def seconds(name: str, run: dict[str, Any], goal_s: float | None = None) -> dict[str, Any]:
    """The row of growth alone; ``cpu_s`` is what a machine without neighbours would come near."""
    value = run["growth_s"]
    made = row(
        f"{name}: growth, audited",
        round(value, 3),
        "s",
        f"<= {goal_s:g}" if goal_s else "",
        value <= goal_s if goal_s else None,
    )
    return made | {"clock": "wall", "cpu_s": round(run["growth_cpu_s"], 3)}


def whole(name: str, run: dict[str, Any], goal_s: float | None = None) -> list[dict[str, Any]]:
    """Rows of tissue plus growth, of the file's writing and of peak memory."""
    value = run["tissue_s"] + run["growth_s"]
    goal = f"<= {goal_s:g}" if goal_s else ""
    all_in = row(
        f"{name}: tissue prepared, growth, audit",
        round(value, 2),
        "s",
        goal,
        value <= goal_s if goal_s else None,
    )
    cpu = round(run["tissue_cpu_s"] + run["growth_cpu_s"], 2)
    rows = [all_in | {"clock": "wall", "cpu_s": cpu, "tissue_s": round(run["tissue_s"], 2)}]
    if "export_s" in run:
        export = row(f"{name}: network.csv written", round(run["export_s"], 2), "s")
        rows.append(export | {"clock": "wall"})
    return rows


def memory(name: str, run: dict[str, Any], goal_gb: float | None = None) -> dict[str, Any]:
    """Peak memory of the process up to the end of growth, and with the export."""
    value = run["peak_mb"] / 1e3
    made = row(
        f"{name}: peak memory",
        round(value, 2),
        "GB",
        f"<= {goal_gb:g}" if goal_gb else "",
        value <= goal_gb if goal_gb else None,
    )
    made["bytes_a_terminal"] = round(2 * run["peak_mb"] * 1e6 / (run["segments"] + 1))
    return made | {"with_export_gb": round(run.get("peak_export_mb", run["peak_mb"]) / 1e3, 2)}
