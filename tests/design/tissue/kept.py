"""Tissues that many tests grow in: each made once in a process."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from typing import Any

from design.tissue import Surface, Tissue, tissue_from_surface

_KEPT: dict[str, Tissue] = {}


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
