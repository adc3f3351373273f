"""Run time and peak memory per stage of the two example recipes: ``make bench``.

Measured through the command line, each recipe in a process and folder of its own, kernels already
compiled; per-stage figures are those that the run's manifest states, the whole is measured here.
"""

from __future__ import annotations

import json
import os
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

from benchmarks.machine import ROOT, print_rows, row

RECIPES = {"planar_fresh": 120.0, "cortex_embedded": None}


def run(recipe: str, folder: Path) -> tuple[float, dict[str, Any]]:
    """Wall seconds of the whole run, and its manifest."""
    begin = time.perf_counter()
    command = [sys.executable, "-m", "printctl", "run", str(ROOT / "examples" / f"{recipe}.yaml")]
    mine = os.environ | {"PRINTCTL_DATA": str(folder.parent)}  # these prints aren't the user's
    subprocess.run([*command, "--out", str(folder)], check=True, stdout=sys.stderr, env=mine)
    seconds = time.perf_counter() - begin
    return seconds, json.loads((folder / "manifest.json").read_text())


def rows_of(recipe: str, goal_s: float | None) -> list[dict[str, Any]]:
    """Rows of one recipe."""
    with tempfile.TemporaryDirectory() as folder:
        seconds, manifest = run(recipe, Path(folder) / recipe)
    rows = [
        row(
            f"{recipe}: whole run",
            round(seconds, 1),
            "s",
            f"<= {goal_s:g}" if goal_s else "",
            seconds <= goal_s if goal_s else None,
        )
    ]
    for name, stage in manifest["stages"].items():
        rows.append(row(f"{recipe}: {name}", stage["seconds"], "s"))
        rows.append(row(f"{recipe}: {name}, peak", stage["peak_mb"], "MB"))
    return rows


def main() -> None:
    """Run both recipes and print the rows."""
    rows = [found for recipe, goal in RECIPES.items() for found in rows_of(recipe, goal)]
    peak = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss * 1024 / 1e6
    rows.append(row("largest process of either run, peak", round(peak, 1), "MB"))
    print_rows(rows)


if __name__ == "__main__":
    main()
