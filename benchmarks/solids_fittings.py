"""Benchmark rows: constructs are one body, by trimesh: fittings on every face, and the gallery.

Each random recipe is a block with closed loops between two of its faces, with a fitting of random
kind, bore and length on inlet and outlet, and a random fillet and print scale.
"""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import trimesh
import yaml

from benchmarks.machine import ROOT, row

Row = dict[str, Any]
SEED, RECIPES, QUICK = 59, 50, 6
KINDS = ("plain", "barb", "luer_female", "luer_male")


def rows(quick: bool) -> Iterator[Row]:
    """All rows."""
    recipes = [random_recipe(number) for number in range(QUICK if quick else RECIPES)]
    yield _row("random recipes, fittings on every face: not one body", recipes)
    gallery = [_of_solid(path) for path in sorted((ROOT / "examples").glob("*.yaml"))]
    yield _row("the gallery's recipes: not one body", gallery[:4] if quick else gallery)


def random_recipe(number: int) -> Row:
    """Recipe ``number``; inlets take each of a block's six faces in turn, outlets another one."""
    rng = np.random.default_rng([SEED, number])
    size, side = rng.uniform(14, 20, 3).round(2), number % 6
    ends = [_end(rng, size, face) for face in (side, (side + int(rng.integers(1, 6))) % 6)]
    keys = ("root_mm", "root_direction", "vein_root_mm", "vein_root_direction")
    return {
        "schema": 1,
        "name": f"fittings_{number}",
        "seed": number + 1,
        "print_scale": float(rng.choice([1.0, 1.0, 1.7])),
        "tissue": {"shape": "block", "size_mm": size.tolist()},
        "vasculature": {
            "grow": "closed_loop",
            "terminals": int(rng.integers(2, 7)),
            "smallest_diameter_mm": round(rng.uniform(0.3, 0.5), 2),
            "clearance_mm": 0.15,
            **dict(zip(keys, (*ends[0], *ends[1]), strict=True)),
        },
        "solid": {
            "fillet_ratio": float(rng.choice([0.0, 0.3, 0.7])),
            "inlets": _fitting(rng, KINDS[number // 6 % 4]),
            "outlets": _fitting(rng, KINDS[int(rng.integers(4))]),
        },
        "toolpath": {"method": "embedded"},
    }


def _end(rng: np.random.Generator, size: Any, face: int) -> tuple[list[float], list[float]]:
    """Place and inward direction of an end on a face: -x, +x, -y, +y, -z, +z."""
    axis, high = divmod(face, 2)
    place = size * rng.uniform(0.35, 0.65, 3)
    place[axis] = size[axis] * high
    inward = np.zeros(3)
    inward[axis] = 1.0 - 2.0 * high
    return place.round(3).tolist(), inward.tolist()


def _fitting(rng: np.random.Generator, kind: str) -> Row:
    bore, length = rng.uniform(0.5, 2.5), rng.uniform(7.5, 10.5)
    return {"kind": kind, "bore_mm": round(bore, 2), "length_mm": round(length, 2)}


def _of_solid(path: Path) -> Row:
    """An example's recipe without flow in space and waves, which take minutes and make no solid."""
    recipe = yaml.safe_load(path.read_text())
    for key in ("one_d", "three_d", "compare"):
        recipe.get("flow", {}).pop(key, None)
    return dict(recipe)


def _row(measure: str, recipes: list[Row]) -> Row:
    wrong = {name: why for name, why in map(_checked, recipes) if why}
    found = row(measure, len(wrong), f"of {len(recipes)}", "0", not wrong)
    return found | {"wrong": wrong}


def _checked(recipe: Row) -> tuple[str, str]:
    """Name of a recipe, and what its construct is where it isn't one closed body."""
    name = str(recipe["name"])
    with tempfile.TemporaryDirectory() as scratch:
        path, run = Path(scratch) / f"{name}.yaml", Path(scratch) / "run"
        path.write_text(json.dumps(recipe))
        call = [sys.executable, "-m", "printctl", "run", str(path), "--out", str(run)]
        done = subprocess.run(
            [*call, "--until", "solid"], capture_output=True, text=True, check=False
        )
        # A plate's run has a solid for each well.
        solids = sorted(run.rglob("solid.stl"))
        if done.returncode or not solids:
            return name, " ".join(done.stderr.split())[-300:] or "no solid.stl"
        faults = [fault for path in solids if (fault := _fault(trimesh.load_mesh(path)))]
    return name, "; ".join(faults)


def _fault(mesh: trimesh.Trimesh) -> str:
    outer = [one for one in mesh.split(only_watertight=False) if one.volume > 0.0]
    if mesh.is_watertight and len(outer) == 1:
        return ""
    return f"watertight {mesh.is_watertight}, {len(outer)} bodies"
