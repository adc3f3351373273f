"""Compile every kernel by running two tiny recipes through the whole chain.

Kernels are compiled for the types they are called with, so the chain itself is the only list of
them that can't go out of date.
"""

from __future__ import annotations

import io
import tempfile
from pathlib import Path
from typing import Any

from rich.console import Console

from printctl.pipeline import run_recipe
from printctl.recipe import parse_recipe

LAYERED: dict[str, Any] = {
    "schema": 1,
    "name": "warm_fresh",
    "tissue": {"shape": "block", "size_mm": [16, 8, 3]},
    "vasculature": {"design": "planar_four_vessel"},
    "toolpath": {"method": "fresh", "needle": "22g", "layer_um": 150, "line_um": 400},
    "scan": {"simulated": "oct", "voxel_um": [60, 60, 30]},
    "registration": {"tolerance_um": 1000},
}
EMBEDDED: dict[str, Any] = {
    "schema": 1,
    "name": "warm_embedded",
    "tissue": {"shape": "cylinder", "diameter_mm": 14, "height_mm": 8},
    "vasculature": {"grow": "tree", "terminals": 6, "smallest_diameter_mm": 0.5},
    "toolpath": {"method": "embedded", "allowed_crossings": 100},
    "printer": {"ink": "gelatin_sacrificial", "bath": "cell_matrix"},
    "scan": {"simulated": "microct", "voxel_um": [80, 80, 80]},
    "registration": {"tolerance_um": 1000},
}


def warm_kernels() -> None:
    """Run both recipes in a scratch folder and forget them."""
    silent = Console(file=io.StringIO())
    with tempfile.TemporaryDirectory() as scratch:
        for data in (LAYERED, EMBEDDED):
            recipe = parse_recipe(data, "warm-up recipe")
            run_recipe(recipe, Path(scratch), Path(scratch) / recipe.name, silent)
