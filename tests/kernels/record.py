"""Record the kernels that each kind of work needs (`kernels/needed.jsonl`).

    python -m tests.kernels.record

Each work is done once in a process of its own. Run it where kernels or their argument types have
changed; until then the list is only less complete (`kernels.ahead`).
"""

from __future__ import annotations

import inspect
import io
import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Callable
from contextlib import suppress
from importlib import import_module
from pathlib import Path
from typing import Any, Final
from unittest.mock import patch

import numba.np.numpy_support
import numpy as np
from numba import types
from rich.console import Console

from design.errors import GrowthError
from kernels import ahead
from kernels.ahead import LIST
from kernels.folder import PACKAGES
from printctl.pipeline.running.run import design_recipe, run_recipe
from printctl.recipe import parse_recipe

ROOT: Final = Path(__file__).parents[2]
FOUND: Final = "kernels.json"
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
    from design.hemodynamics.three_d.meshing.surface import wall_surface
    from design.hemodynamics.three_d.meshing.wall import lumen_wall
    from design.vasculature import planar_four_vessel

    network = planar_four_vessel()
    wall_surface(network, lumen_wall(network, fillet_ratio=0.5, ratio=1.0), fillet_ratio=0.5)


def mend(scratch: Path) -> None:
    """What takes crossings away from unions: two tetrahedra pushed into one another."""
    from design.solids.repair.mend import mend_surface

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
    """Do each work in a process of its own, and write the list, callees before callers."""
    by: dict[tuple[str, str], set[str]] = {}
    with tempfile.TemporaryDirectory() as folder:
        for work in WORKS:
            command = [sys.executable, "-m", "tests.kernels.record", work, folder]
            # With a store of its own nothing is loaded compiled: what a kernel calls is seen too.
            store = os.environ | {"PRINTCTL_CACHE": str(Path(folder) / "compiled" / work)}
            subprocess.run(command, check=True, cwd=ROOT, env=store)
            for kernel, takes in json.loads((Path(folder) / FOUND).read_text()):
                by.setdefault((kernel, takes), set()).add(work)
            print(work, sum(work in works for works in by.values()), "kernels", flush=True)
    rows = sorted(by, key=lambda one: (_calls(_kernel(one[0])), *one))
    lines = [
        json.dumps({"kernel": kernel, "by": sorted(by[kernel, takes]), "takes": json.loads(takes)})
        for kernel, takes in rows
    ]
    LIST.write_text("\n".join(lines) + "\n", encoding="utf-8")


def _called() -> list[tuple[str, str]]:
    """Kernels that this process has compiled or loaded, with their argument types."""
    found = []
    for name, kernel in _kernels().items():
        for signature in kernel.signatures:
            with suppress(TypeError):  # literals, which only callers pass on
                found.append((name, json.dumps([described(one) for one in signature])))
    return found


def _kernels() -> dict[str, Any]:
    """Numba's dispatchers in all modules of ours that are loaded."""
    ours = tuple(f"{folder}.".replace("/", ".") for folder in PACKAGES)
    loaded = [
        module
        for name, module in list(sys.modules.items())
        if f"{name}.".startswith(ours) and module is not None
    ]
    values = [value for module in loaded for value in vars(module).values()]
    kernels = [one for one in values if hasattr(one, "py_func") and hasattr(one, "signatures")]
    return {f"{one.py_func.__module__}:{one.py_func.__qualname__}": one for one in kernels}


def _kernel(name: str) -> Any:
    module, _, function = name.partition(":")
    return getattr(import_module(module), function)


def _calls(kernel: Any) -> int:
    """How many kernels a kernel calls, directly or not."""
    reached: set[Any] = set()
    waiting = [kernel]
    while waiting:
        read = inspect.getclosurevars(waiting.pop().py_func)
        for value in (*read.globals.values(), *read.nonlocals.values()):
            if hasattr(value, "py_func") and value not in reached:
                reached.add(value)
                waiting.append(value)
    return len(reached)


def described(one: Any) -> Any:
    """Describe a numba type as JSON (`kernels.ahead.numba_type`); `TypeError` for other kinds."""
    if isinstance(one, types.Bytes):
        return {"bytes": one.dtype.name}
    # Numba calls arrays of packed records unaligned; other unaligned arrays stand within a record.
    if type(one) is types.Array and one.aligned == types.Array(one.dtype, 1, "C").aligned:
        shape = [one.ndim, one.layout, *([] if one.mutable else ["readonly"])]
        return {"array": [described(one.dtype), *shape]}
    if isinstance(one, types.BaseTuple):
        items = [described(item) for item in one]
        if not isinstance(one, types.BaseNamedTuple):
            return {"tuple": items}
        named = one.instance_class
        return {"named": [f"{named.__module__}:{named.__qualname__}", items]}
    if isinstance(one, types.Record):
        dtype = numba.np.numpy_support.as_dtype(one)
        fields = [
            [name, field.base.str, list(field.shape), offset]
            for name, (field, offset) in dtype.fields.items()
        ]
        return {"record": [dtype.itemsize, dtype.isalignedstruct, fields]}
    numbers = types.Integer | types.Float | types.Complex | types.Boolean
    plain = isinstance(one, numbers | types.NoneType)
    if plain and not isinstance(one, types.Literal):
        return {types.boolean: "boolean", types.none: "none"}.get(one, one.name)
    raise TypeError(f"numba type {one}, which the list of kernels can't hold")


if __name__ == "__main__":
    if sys.argv[1:]:
        work, folder = sys.argv[1], Path(sys.argv[2])
        # Else other processes compile what is listed already.
        with patch.object(ahead, "LIST", folder / "none"):
            WORKS[work](folder)  # which may be a command, with arguments of its own
        (folder / FOUND).write_text(json.dumps(_called()))
    else:
        record()
