"""Repair of self-intersections after rounding: removed by small moves if possible, or reported."""

from __future__ import annotations

import numpy as np
import pytest

from design.solids import Solid, block_solid, find_crossings, lumen_solid, surface_genus
from design.solids import lumen as lumen_module
from design.solids.mend import mend_surface
from design.solids.topology import corner_fans, is_closed
from tests.design.solids.networks import channels


def _bundle() -> Solid:
    """Six winding vessels that run along one another, so far away that rounding moves them 1 µm."""
    rng = np.random.default_rng(2)
    along = np.linspace(0.0, 1.0, 20)
    nodes, pairs = np.empty((0, 3)), []
    for vessel in range(6):
        waves = np.sin(3.0 * along[:, None] * np.arange(1, 5)) @ rng.normal(0, 0.15, (4, 2))
        line = np.column_stack([10.0 * along + rng.uniform(-1, 1), waves])
        nodes = np.concatenate([nodes, line])
        pairs += [(20 * vessel + k, 20 * vessel + k + 1) for k in range(19)]
    radius = np.repeat(rng.uniform(0.3, 0.5, 6), 19)
    return lumen_solid(channels(nodes + 1e4, pairs, radius), tolerance_mm=0.01)


@pytest.fixture
def unmended(monkeypatch: pytest.MonkeyPatch) -> pytest.MonkeyPatch:
    """Unions as rounding leaves them."""
    none = np.empty(0, np.int64)
    monkeypatch.setattr(lumen_module, "mended_solid", lambda solid, _: (solid, none))
    return monkeypatch


def test_vessels_along_one_another_unite_without_crossings(unmended: pytest.MonkeyPatch) -> None:
    rough = _bundle()
    assert len(find_crossings(rough.vertices, rough.faces).faces) > 0
    unmended.undo()
    mended = _bundle()
    assert len(find_crossings(mended.vertices, mended.faces).faces) == 0
    assert is_closed(mended.faces)
    assert surface_genus(mended.faces) == surface_genus(rough.faces)
    assert mended.volume_mm3 == pytest.approx(rough.volume_mm3, rel=1e-6)
    assert np.array_equal(mended.vertices, mended.vertices.astype(np.float32))


def test_a_surface_without_crossings_stays_as_it_is() -> None:
    block = block_solid((1, 2, 3))
    faces = block.faces.astype(np.int64)
    vertices, kept, left = mend_surface(block.vertices, faces, 1e-3)
    assert vertices is block.vertices
    assert kept is faces
    assert len(left) == 0


def test_what_would_move_the_surface_too_far_is_told() -> None:
    cube = block_solid((1, 1, 1))
    turn, _ = np.linalg.qr(np.random.default_rng(2).normal(size=(3, 3)))
    vertices = np.concatenate([cube.vertices, (cube.vertices @ turn.T + 0.5)])
    vertices = vertices.astype(np.float32).astype(np.float64)
    faces = np.concatenate([cube.faces, cube.faces + 8]).astype(np.int64)
    moved, kept, left = mend_surface(vertices, faces, 1e-3)
    assert len(left) > 0
    assert is_closed(kept)
    assert np.abs(moved - vertices).max() < 2e-3


def test_bodies_that_touch_in_a_vertex_are_drawn_apart() -> None:
    """Each vertex is then of one fan of faces, as other programs ask of a two-manifold."""
    cube = block_solid((1, 1, 1))
    corner = cube.vertices.max(axis=0)
    touching = np.flatnonzero((cube.vertices == cube.vertices.min(axis=0)).all(axis=1))[0]
    its = np.flatnonzero((cube.vertices == corner).all(axis=1))[0]
    second = cube.faces.astype(np.int64) + len(cube.vertices)
    second[second == touching + len(cube.vertices)] = its
    vertices = np.concatenate([cube.vertices, cube.vertices + corner - cube.vertices.min(axis=0)])
    faces = np.concatenate([cube.faces.astype(np.int64), second])
    assert corner_fans(faces).max() + 1 > len(np.unique(faces))
    apart, kept, left = mend_surface(vertices, faces, 1e-3)
    assert len(left) == 0
    assert is_closed(kept)
    assert corner_fans(kept).max() + 1 == len(np.unique(kept))
    assert len(np.unique(apart[np.unique(kept)], axis=0)) == 16
    assert np.array_equal(apart, apart.astype(np.float32))
