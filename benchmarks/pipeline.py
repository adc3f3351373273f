"""Run time and peak memory per stage of the two example recipes.

Measured through the command line, each recipe in a process and folder of its own, kernels already
compiled; per-stage figures are those that the run's manifest states, the whole is measured here.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from benchmarks.common import ROOT, Row, limited, row

RECIPES = {"planar_fresh": 120.0, "cortex_embedded": None}


def run(recipe: str, folder: Path) -> tuple[float, dict[str, Any]]:
    """Wall seconds of the whole run, and its manifest."""
    begin = time.perf_counter()
    command = [sys.executable, "-m", "printctl", "run", str(ROOT / "examples" / f"{recipe}.yaml")]
    mine = os.environ | {"PRINTCTL_DATA": str(folder.parent)}  # these prints aren't the user's
    subprocess.run([*command, "--out", str(folder)], check=True, stdout=sys.stderr, env=mine)
    seconds = time.perf_counter() - begin
    return seconds, json.loads((folder / "manifest.json").read_text())


def rows_of(recipe: str, goal_s: float | None) -> Iterator[Row]:
    """Rows of one recipe."""
    with tempfile.TemporaryDirectory() as folder:
        seconds, manifest = run(recipe, Path(folder) / recipe)
    yield limited(f"{recipe}: whole run", seconds, "s", goal_s)
    for name, stage in manifest["stages"].items():
        yield row(f"{recipe}: {name}", stage["seconds"], "s") | {"peak_mb": stage["peak_mb"]}


def rows(quick: bool) -> Iterator[Row]:
    """Yield both recipes; quick has the planar one."""
    for recipe, goal in list(RECIPES.items())[: 1 if quick else None]:
        yield from rows_of(recipe, goal)
