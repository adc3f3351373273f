"""Tissues that many tests grow in, made once in a process; an independent judge of lumens."""

import hashlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from benchmarks.checkers.containment import surface_tree, to_surface, winding_numbers
from design.tissue import Surface, Tissue, tissue_from_surface
from design.vasculature import VesselTree, tree_radii
from kernels.arrays import FloatArray

_KEPT: dict[str, Tissue] = {}


def shared(name: str) -> Path:
    """Return a file of the shared data; skip the test where there is none."""
    path = Path(__file__).parents[4] / "shared" / "data" / name
    if not path.is_file():
        pytest.skip("no shared data beside the repository")
    return path


def inside_exactly(tissue: Tissue, start: FloatArray, end: FloatArray, radius: Any) -> Any:
    """Whether capsules, (n, 3) to (n, 3), lie in a tissue, by an independent checker."""
    corners = tissue.surface.vertices[tissue.surface.faces]
    exact = surface_tree(corners)
    away = to_surface(start, end, radius, exact, corners[exact.order])
    return (away >= radius) & (winding_numbers(end, corners, exact) > 0)


def lumens_outside(tree: VesselTree, tissue: Tissue) -> int:
    """Count segments whose lumen isn't in the tissue; the root apart."""
    radius = tree_radii(tree)[1:] - 1e-9
    return int(np.sum(~inside_exactly(tissue, tree.proximal[1:], tree.distal[1:], radius)))


def kept_tissue(surface: Surface, **options: Any) -> Tissue:
    """Return the tissue within a surface, as `tissue_from_surface`; tests don't change it."""
    digest = hashlib.sha256(repr(sorted(options.items())).encode())
    digest.update(surface.vertices.tobytes())
    digest.update(surface.faces.tobytes())
    key = digest.hexdigest()
    if key not in _KEPT:
        _KEPT[key] = tissue_from_surface(surface.vertices, surface.faces, **options)
    return _KEPT[key]


class KeptTissues:
    """Tissues of shapes by name, each made when it is first asked for."""

    def __init__(self, shapes: dict[str, Callable[[], Surface]]) -> None:
        self._shapes = shapes
        self._made: dict[str, Tissue] = {}

    def __getitem__(self, name: str) -> Tissue:
        if name not in self._made:
            self._made[name] = kept_tissue(self._shapes[name]())
        return self._made[name]
