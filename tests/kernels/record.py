"""Record the kernels that each kind of work needs (`kernels/needed.jsonl`); takes 20 minutes.

    python -m tests.kernels.record

Each work is done once in a process of its own, with a store that is empty. What lies in the store
afterwards is what it needs. Run it where kernels or their argument types have changed; where
nobody does, the list is only less complete (`kernels.needed`).
"""

from __future__ import annotations

import io
import os
import subprocess
import sys
import tempfile
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any, Final

import numpy as np
from rich.console import Console

from design.errors import GrowthError
from kernels.files import read_whole
from kernels.folder import ALL, FOR_KERNELS, kernel_of
from kernels.key import called_kernels, signature_text
from kernels.needed import NeededKernel, resolve_name, types_of, types_text, write
from printctl.pipeline.run import design_recipe, run_recipe
from printctl.recipe import parse_recipe

ROOT: Final = Path(__file__).parents[2]
_SIGNATURE: Final = 3
"""Place of the signature in what numba's `CompileResult` is kept as."""
EXAMPLES: Final = ROOT / "examples"

LAYERED: dict[str, Any] = {
    "schema": 1,
    "name": "warm_fresh",
    "tissue": {"shape": "block", "size_mm": [16, 8, 3]},
    "vasculature": {"design": "planar_four_vessel"},
    "flow": {
        "pulse": {"amplitude_ml_min": 0.1, "period_s": 1, "wall_young_kpa": 100},
        "one_d": {},
    },
    "oxygen": {"grid_cells": 2000},
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
CROWDED: dict[str, Any] = EMBEDDED | {
    "name": "warm_loops",
    "vasculature": {
        "grow": "closed_loop",
        "terminals": 12,
        "smallest_diameter_mm": 0.3,
    },
}
"""So little room that connections go round and terminals are shortened."""


def _run(data: dict[str, Any], scratch: Path) -> None:
    recipe = parse_recipe(data, "kernels")
    run_recipe(recipe, scratch, scratch / recipe.name, Console(file=io.StringIO()))


def _design(data: dict[str, Any], scratch: Path) -> None:
    recipe = parse_recipe(data, "kernels")
    # What finds no way has compiled all that looks for one.
    with suppress(GrowthError):
        design_recipe(recipe, scratch, scratch / recipe.name, Console(file=io.StringIO()))


def _printctl(*words: object) -> None:
    from printctl.cli.main import main

    sys.argv = ["printctl", *map(str, words)]
    with suppress(SystemExit):
        main()


def run_fresh(scratch: Path) -> None:
    """A planar print in layers, whole."""
    _printctl("run", EXAMPLES / "planar_fresh.yaml", "--out", scratch / "planar")


def pulse_and_oxygen(scratch: Path) -> None:
    """The same with what a recipe may ask for beside: flow that pulses, waves, oxygen."""
    _run(LAYERED, scratch)


def run_embedded(scratch: Path) -> None:
    """A tree written in one bath, whole."""
    _run(EMBEDDED, scratch)


def design(scratch: Path) -> None:
    """What is designed, or grown in one tree."""
    folder = scratch / "designed"  # not where a run has left what it made
    folder.mkdir()
    for data in (LAYERED, EMBEDDED):
        _design(data, folder)


def connect(scratch: Path) -> None:
    """Trees that are grown and connected."""
    _design(CROWDED, scratch)


def flow_in_3d(scratch: Path) -> None:
    """Even triangles on lumens' walls; needs none of the extra's solvers."""
    from design.hemodynamics.three_d.surface import wall_surface
    from design.hemodynamics.three_d.wall import lumen_wall
    from design.vasculature import planar_four_vessel

    network = planar_four_vessel()
    wall_surface(network, lumen_wall(network, fillet_ratio=0.5, ratio=1.0), fillet_ratio=0.5)


def mend(scratch: Path) -> None:
    """What takes crossings away from unions: two tetrahedra pushed into one another."""
    from design.solids.mend import mend_surface

    corners = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])
    faces = np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]])
    vertices = np.concatenate([corners, corners + [0.25, 0.125, 0.0625]])
    mend_surface(vertices, np.concatenate([faces, faces + 4]), 1e-3)


def register(scratch: Path) -> None:
    """A scan held against its design."""
    run = scratch / "planar"
    _printctl("register", run / "scan.tif", "--model", run, "--out", scratch / "registered")


def simulate(scratch: Path) -> None:
    """G-code's dry run."""
    _printctl("simulate", scratch / "planar" / "part.gcode")


def slice_mesh(scratch: Path) -> None:
    """A mesh in layers."""
    solid = scratch / "planar" / "solid.stl"
    _printctl("slice", solid, "--unit", "mm", "--out", scratch / "solid.gcode")


WORKS: Final[dict[str, Callable[[Path], None]]] = {
    "run fresh": run_fresh,  # first: the others take its files
    "pulse and oxygen": pulse_and_oxygen,
    "run embedded": run_embedded,
    "design": design,
    "connect": connect,
    "flow in 3D": flow_in_3d,
    "mend": mend,
    "register": register,
    "simulate": simulate,
    "slice": slice_mesh,
}


def record() -> None:
    """Do each work in a process of its own, and write the list."""
    by: dict[tuple[str, str], set[str]] = {}
    entries: set[tuple[str, str]] = set()
    with tempfile.TemporaryDirectory() as folder:
        for work in WORKS:
            for one, entry in _done_alone(work, Path(folder)):
                by.setdefault(one, set()).add(work)
                entries |= {one} if entry else set()
            print(work, sum(work in works for works in by.values()), "kernels", flush=True)
    rows = [NeededKernel(*one, frozenset(works), one in entries) for one, works in by.items()]
    write(sorted(rows, key=lambda one: (_calls(one), one.kernel, one.takes)))


def _done_alone(work: str, scratch: Path) -> list[tuple[tuple[str, str], bool]]:
    """Kernels with types, and whether Python called them."""
    cache = scratch / "caches" / work
    environment = {"PRINTCTL_CACHE": str(cache), "PRINTCTL_DATA": str(scratch / "data")}
    command = [sys.executable, "-m", "tests.kernels.record", work, str(scratch)]
    subprocess.run(command, check=True, cwd=ROOT, env=os.environ | environment)
    found = [(row(file), not file.name.endswith(FOR_KERNELS)) for file in cache.rglob(f"*{ALL}")]
    return sorted((one, entry) for one, entry in found if one is not None)


def row(file: Path) -> tuple[str, str] | None:
    """Kernel and types that a file holds; None for literals, which only callers pass on.

    None too for a file of another commit whose types this one doesn't know.
    """
    payload = read_whole(file)
    if payload is None:
        return None
    types = payload[_SIGNATURE].args
    try:
        takes = types_text(types)
    except TypeError:
        return None
    # What is read back must be the same to the store.
    assert signature_text(types_of(takes), {}) == signature_text(types, {}), takes
    module, _, name = kernel_of(file).rpartition(".")
    return f"{module}:{name}", takes


def _calls(one: NeededKernel) -> int:
    """How many kernels a kernel calls: those that call none are compiled first."""
    return len(called_kernels(resolve_name(one.kernel), {}))


if __name__ == "__main__":
    if sys.argv[1:]:
        WORKS[sys.argv[1]](Path(sys.argv[2]))
    else:
        record()
