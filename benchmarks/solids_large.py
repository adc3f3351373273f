"""Slicing benchmark: a part of 1,000 vessels in 40 cm³ at 60 µm layers."""

from __future__ import annotations

import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from benchmarks.machine import row
from benchmarks.solids_slicing import timed

Row = dict[str, Any]

RECIPE = """schema: 1
name: large
seed: 1
tissue: {shape: block, size_mm: [34.2, 34.2, 34.2]}
vasculature: {grow: tree, terminals: 500, printable: true, smallest_diameter_mm: 0.3}
toolpath: {method: fresh}
"""


def rows() -> Iterator[Row]:
    """Time and memory of the whole process."""
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch)
        recipe, made = folder / "large.yaml", folder / "design"
        recipe.write_text(RECIPE)
        python = [sys.executable, "-m", "printctl"]
        print("large part: design", file=sys.stderr, flush=True)
        timed([*python, "design", str(recipe), "--out", str(made)])
        vessels = len({line.split(",")[0] for line in (made / "network.csv").open()}) - 1
        out = folder / "large.gcode"
        model = [str(made / "solid.stl"), "--unit", "mm", "--syringe", "hamilton_2_5ml"]
        print("large part: layers", file=sys.stderr, flush=True)
        cpu, memory = timed([*python, "slice", *model, "--out", str(out)])
        lines = sum(1 for _ in out.open("rb"))
        about = {"vessels": vessels, "lines_of_gcode": lines, "gcode_mb": out.stat().st_size / 1e6}
        measure = f"{vessels} vessels in 40 cm³, layers of 60 um"
        yield row(f"{measure}: CPU", cpu, "s", "<= 60", cpu <= 60) | about
        yield row(f"{measure}: memory", memory / 1e3, "GB", "<= 2", memory <= 2e3)
