"""Half-edge operations: the mesh stays valid after any sequence."""

from __future__ import annotations

import numpy as np
import pytest

from design.solids import remesh as halfedges
from design.solids.remesh import remesh
from kernels.arrays import IntArray
from tests.design.solids.remesh.shapes import Torus, euler, torus_surface


def _same_twins(faces: IntArray, twin: IntArray) -> bool:
    """Whether what was kept up to date is what it is, found anew."""
    return bool(np.array_equal(twin, halfedges.twins_of(faces)))


def test_a_twin_runs_the_other_way_along_the_same_edge() -> None:
    faces = torus_surface(1.0, 0.3).faces
    twin = halfedges.twins_of(faces)
    assert np.array_equal(twin[twin], np.arange(faces.size))
    for h in range(0, faces.size, 7):
        there = int(twin[h])
        assert halfedges.origin(faces, h) == halfedges.tip(faces, there)
        assert halfedges.tip(faces, h) == halfedges.origin(faces, there)


def test_valence_and_neighbours_are_those_of_the_grid() -> None:
    surface = torus_surface(1.0, 0.3)
    faces = surface.faces
    twin, out = halfedges.twins_of(faces), halfedges.leaving(faces, len(surface.vertices))
    for a in range(len(surface.vertices)):
        assert halfedges.valence(twin, out, a) == 6
        mine = {int(v) for v in faces[(faces == a).any(axis=1)].ravel()} - {a}
        met = {
            b for b in range(len(surface.vertices)) if halfedges.are_joined(faces, twin, out, a, b)
        }
        assert met == mine


@pytest.mark.parametrize("h", [0, 1, 2, 40, 133])
def test_an_edge_is_split(h: int) -> None:
    surface = torus_surface(1.0, 0.3)
    count, f = len(surface.vertices), len(surface.faces)
    faces = np.concatenate([surface.faces, np.zeros((2, 3), np.int64)])
    twin = np.concatenate([halfedges.twins_of(surface.faces), np.zeros(6, np.int64)])
    halfedges.split_edge(faces, twin, h, count, f)
    assert _same_twins(faces, twin)
    assert halfedges.valence(twin, halfedges.leaving(faces, count + 1), count) == 4


@pytest.mark.parametrize("h", [0, 1, 2, 40, 133])
def test_an_edge_is_turned_and_turned_back(h: int) -> None:
    surface = torus_surface(1.0, 0.3)
    faces = surface.faces.copy()
    twin, out = halfedges.twins_of(faces), halfedges.leaving(faces, len(surface.vertices))
    across = {int(halfedges.apex(faces, h)), int(halfedges.apex(faces, int(twin[h])))}
    halfedges.flip(faces, twin, out, h)
    assert _same_twins(faces, twin)
    assert halfedges.are_joined(faces, twin, out, *across)
    for a in range(len(surface.vertices)):
        assert halfedges.origin(faces, int(out[a])) == a


@pytest.mark.parametrize("h", [0, 1, 2, 40, 133])
def test_an_edge_is_drawn_in(h: int) -> None:
    surface = torus_surface(1.0, 0.3)
    faces = surface.faces.copy()
    twin, out = halfedges.twins_of(faces), halfedges.leaving(faces, len(surface.vertices))
    gone, left = int(faces[h // 3, h % 3]), {h // 3, int(twin[h]) // 3}
    halfedges.collapse(faces, twin, out, h)
    rest = np.delete(faces, list(left), axis=0)
    assert gone not in rest
    halfedges.twins_of(rest)
    for a in set(rest.ravel().tolist()):
        assert int(out[a]) // 3 not in left
        assert halfedges.origin(faces, int(out[a])) == a


@pytest.mark.parametrize("edge", [0.09, 0.14, 0.23])
def test_a_torus_keeps_its_handle_at_any_size(edge: float) -> None:
    found = remesh(torus_surface(1.0, 0.25, 13, 7), Torus(1.0, 0.25, edge))
    assert euler(found) == 0
