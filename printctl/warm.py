"""Compile every kernel by running tiny recipes through the whole chain, and drawing a picture.

Kernels are compiled for the types they are called with, so the chain itself is the only list of
them that can't go out of date. Numba compiles on one core; two chains of recipes with few kernels
in common are run in two processes.
"""

from __future__ import annotations

import io
import multiprocessing
import os
import tempfile
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console

from design.errors import GrowthError
from design.hemodynamics.three_d.surface import wall_surface
from design.hemodynamics.three_d.wall import lumen_wall
from design.solids.mend import without_crossings
from design.vasculature import planar_four_vessel
from printctl.link.history import DATA_VARIABLE
from printctl.networks import Drive, load_source
from printctl.pipeline.run import design_recipe, run_recipe
from printctl.recipe import Recipe, parse_recipe
from registration.picture import PictureOptions, draw_picture, quantities

Run = Callable[[Recipe, Path, Path, Console], dict[str, Any]]

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
POLISHED: dict[str, Any] = EMBEDDED | {
    "name": "warm_polish",
    "vasculature": {"grow": "tree", "terminals": 30, "polish": True},
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


def warm_kernels() -> None:
    """Run all recipes in scratch folders, and forget them."""
    # Spawned: a fork of a process with numba's threads may hang.
    spawn = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(2, spawn) as pool:
        for chain in [pool.submit(warm_growth), pool.submit(warm_prints)]:
            chain.result()


def warm_prints() -> None:
    """Both kinds of prints, whole, and a picture."""
    with scratch_folder() as scratch:
        _warmed(LAYERED, run_recipe, scratch)
        draw(_warmed(EMBEDDED, run_recipe, scratch))


def warm_growth() -> None:
    """What grows, is polished and joined."""
    with scratch_folder() as scratch:
        _warmed(POLISHED, design_recipe, scratch)
        # What finds no way has compiled all that looks for one.
        with suppress(GrowthError):
            _warmed(CROWDED, design_recipe, scratch)
    mesh_walls()
    mend_crossing()


def mesh_walls() -> None:
    """Even triangles on lumens' walls, as 3D flow wants them; needs none of its extra."""
    network = planar_four_vessel()
    wall_surface(network, lumen_wall(network, fillet_ratio=0.5, ratio=1.0))


def mend_crossing() -> None:
    """What takes crossings away from unions: two tetrahedra pushed into one another."""
    corners = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])
    faces = np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]])
    vertices = np.concatenate([corners, corners + [0.25, 0.125, 0.0625]])
    without_crossings(vertices, np.concatenate([faces, faces + 4]), 1e-3)


@contextmanager
def scratch_folder() -> Iterator[Path]:
    """A folder for runs that nobody remembers."""
    with tempfile.TemporaryDirectory() as folder, history_in(Path(folder) / "data"):
        yield Path(folder)


def _warmed(data: dict[str, Any], run: Run, scratch: Path) -> Path:
    recipe = parse_recipe(data, "warm-up recipe")
    run(recipe, scratch, scratch / recipe.name, Console(file=io.StringIO()))
    return scratch / recipe.name


@contextmanager
def history_in(folder: Path) -> Iterator[None]:
    """Have prints remembered in ``folder``, not among the user's, by all processes begun here."""
    before = os.environ.get(DATA_VARIABLE)
    os.environ[DATA_VARIABLE] = str(folder)
    try:
        yield
    finally:
        if before is None:
            del os.environ[DATA_VARIABLE]
        else:
            os.environ[DATA_VARIABLE] = before


def draw(folder: Path) -> None:
    """A small picture of a run's network in its tissue."""
    source = load_source(folder, None, Drive())
    radius = quantities(source.network, source.known)[0]
    draw_picture(source.network, radius, source.surface, PictureOptions(width=300))
