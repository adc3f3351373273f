"""Run time and peak memory per stage of the two example recipes, kernels already compiled.

Each runs through the command line in a process and folder of its own; per-stage figures are those
that the run's manifest states, the whole is measured here.
"""

from __future__ import annotations

import json
import os
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

from benchmarks.common import ROOT, Row, limited, printctl, row, timed

RECIPES = {"planar_fresh": 120.0, "cortex_embedded": None}


def rows(quick: bool) -> Iterator[Row]:
    """Yield both recipes; quick has the planar one as far as its toolpath."""
    for recipe, goal_s in list(RECIPES.items())[: 1 if quick else None]:
        with tempfile.TemporaryDirectory() as folder:
            os.environ["PRINTCTL_DATA"] = folder  # these prints aren't the user's
            out, begin = Path(folder) / recipe, time.perf_counter()
            until = ["--until", "toolpath"] if quick else []
            example = ROOT / "examples" / f"{recipe}.yaml"
            cpu, memory, _ = timed(printctl("run", example, "--out", out, *until))
            seconds = time.perf_counter() - begin
            stages = json.loads((out / "manifest.json").read_text())["stages"]
        about = {"cpu_s": cpu, "peak_mb": memory}
        yield limited(f"{recipe}: whole run", seconds, "s", None if quick else goal_s) | about
        for name, stage in stages.items():
            yield row(f"{recipe}: {name}", stage["seconds"], "s") | {"peak_mb": stage["peak_mb"]}
