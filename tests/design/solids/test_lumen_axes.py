"""Lumens found in a model without its network; crossings of rounded surfaces mended."""

import manifold3d
import numpy as np
import pytest

from design.errors import SolidError
from design.network import VesselNetwork
from design.solids import (
    Solid,
    block_solid,
    find_crossings,
    lumen_solid,
    network_genus,
    surface_genus,
)
from design.solids import lumen as lumen_module
from design.solids.axes.lumen_axes import found_lumens, unfollowed_ways
from design.solids.repair.mend import mend_surface
from design.solids.topology import corner_fans, is_closed
from tests.design.solids.networks import channels
from tests.registration.parts import lumens, solid

BLOCK = manifold3d.Manifold.cube((9.0, 5.0, 2.6))
FORKED = channels(
    [(-0.5, 2.5, 1.3), (2.5, 2.5, 1.3), (4.5, 1.2, 1.1), (4.5, 3.8, 1.5),
     (6.5, 2.5, 1.3), (9.5, 2.0, 1.0)],
    [(0, 1), (1, 2), (1, 3), (2, 4), (3, 4), (4, 5)], [0.4, 0.25, 0.3, 0.25, 0.3, 0.35],
)  # fmt: skip
"""In, two ways that each bend and meet again, and out, through both faces of the block."""


def channel(start: tuple[float, ...], end: tuple[float, ...], radius: float) -> VesselNetwork:
    return channels([start, end], [(0, 1)], radius)


def off_axis_mm(found: VesselNetwork, designed: VesselNetwork) -> float:
    """Return how far any point of the axes found lies beside the designed axes."""
    start, end, _, _, _ = designed.pieces()
    way = (end - start) / np.linalg.norm(end - start, axis=1)[:, None]
    off = found.points[:, None] - start
    return float(np.linalg.norm(np.cross(off, way), axis=-1).min(axis=1).max())


@pytest.mark.parametrize("alone", [False, True])
def test_a_loop_and_its_forks_are_found_where_and_as_wide_as_designed(alone: bool) -> None:
    inside = lumens(FORKED)
    model = solid(inside if alone else BLOCK - inside)
    found = found_lumens(model, is_lumen=alone).network
    # The two vessels to each bend are one lumen.
    assert (found.vessel_count, len(found.nodes)) == (4, 4)
    assert off_axis_mm(found, FORKED) < 0.03
    assert sorted(found.mean_radius()) == pytest.approx([0.25, 0.3, 0.35, 0.4], rel=0.02)
    if not alone:
        assert unfollowed_ways(model, found) == 0


def test_a_slanted_channel_reaches_both_faces_and_a_blind_one_its_end() -> None:
    slanted, blind = (
        channel((-0.5, 0.8, 0.7), (9.5, 1.6, 1.9), 0.2),
        channel((4.5, 5.5, 1.3), (4.5, 2.8, 1.3), 0.3),
    )
    found = found_lumens(solid(BLOCK - lumens(slanted) - lumens(blind))).network
    assert found.vessel_count == 2
    # The blind one ends in half a ball.
    assert sorted(found.lengths()) == pytest.approx([2.35, 9.1], abs=0.2)
    assert sorted(found.mean_radius()) == pytest.approx([0.2, 0.3], rel=0.02)
    line, radius = found.polyline(int(found.lengths().argmax()))
    way = (line[:, :1] + 0.5) * [1.0, 0.08, 0.12]
    assert line - [-0.5, 0.8, 0.7] == pytest.approx(way, abs=0.003)
    assert radius == pytest.approx(np.full(len(radius), 0.2), rel=0.01)


def test_axes_go_on_to_slanted_faces_and_the_joints_of_acute_forks() -> None:
    places = np.array([(-0.5, 2.5, 1.3), (2.2, 2.5, 1.3), (9.5, 0.7, 1.5), (9.5, 4.0, 1.3),
                       (1.0, 4.2, -0.4), (3.54, 4.2, 3.0)])  # fmt: skip
    net = channels(places, [(0, 1), (1, 2), (1, 3), (4, 5)], [0.4, 0.3, 0.26, 0.25])
    found = found_lumens(solid(BLOCK - lumens(net)))
    assert (found.network.vessel_count, found.left, found.stretches) == (4, 0.0, ((),) * 4)
    fork = found.network.nodes[found.network.degree() == 3]
    assert fork[0] == pytest.approx(places[1], abs=0.03)
    steep = found.network.nodes[np.argsort(found.network.nodes[:, 2])[[0, -1]]]
    assert steep == pytest.approx(np.array([(1.3, 4.2, 0.0), (3.24, 4.2, 2.6)]), abs=0.03)


def test_what_no_vessel_follows_is_told_and_a_bubble_is_no_lumen() -> None:
    bubble = manifold3d.Manifold.sphere(0.6, 64).translate((4.5, 1.2, 1.3))
    with pytest.raises(SolidError, match="no lumen"):
        found_lumens(solid(BLOCK - bubble))
    found = found_lumens(solid(BLOCK - bubble - lumens(channel((-1, 3, 1.3), (10, 3, 1.3), 0.3))))
    assert found.network.vessel_count == 1
    share = 0.6**3 * 4 / 3 / (0.6**3 * 4 / 3 + 9 * 0.3**2)
    assert found.left == pytest.approx(share, rel=0.1)
    assert np.abs(found.left_at - [4.5, 1.2, 1.3]).max() < 0.6
    flat = manifold3d.Manifold.cube((11.0, 2.4, 0.5)).translate((-1.0, 1.2, 1.0))
    found = found_lumens(solid(BLOCK - flat))
    lengths = found.network.lengths()
    unsure = [sum(b - a for a, b in one) for one in found.stretches]
    assert sum(unsure) > 0.8 * lengths.sum()


def test_a_groove_a_notch_and_a_dimple_are_no_lumens() -> None:
    groove = manifold3d.Manifold.cube((10.0, 0.6, 0.6)).translate((-0.5, 1.7, 2.1))
    notch = manifold3d.Manifold.cube((3.0, 3.0, 3.0)).translate((7.0, 2.5, -0.2))
    dimple = manifold3d.Manifold.sphere(0.5, 32).translate((2.0, 1.0, 2.6))
    part = BLOCK - groove - notch - dimple
    with pytest.raises(SolidError, match="no lumen"):
        found_lumens(solid(part))
    found = found_lumens(solid(part - lumens(channel((-1, 2, 1), (10, 2, 1), 0.3)))).network
    assert found.vessel_count == 1
    assert found.lengths()[0] == pytest.approx(9.0, abs=0.05)


def test_a_closed_ring_and_lumens_a_wall_apart_are_found() -> None:
    turn = np.linspace(0, 2 * np.pi, 33)[:-1]
    nodes = np.column_stack([3 + 1.2 * np.cos(turn), 2.5 + 1.2 * np.sin(turn), np.full(32, 1.3)])
    ring = channels(nodes, [(k, (k + 1) % 32) for k in range(32)], 0.3)
    one = channel((7.0, -0.5, 1.3), (7.0, 5.5, 1.3), 0.3)
    two = channel((7.65, -0.5, 1.3), (7.65, 5.5, 1.3), 0.3)
    found = found_lumens(solid(BLOCK - lumens(ring) - lumens(one) - lumens(two)))
    assert sorted(found.network.lengths()) == pytest.approx([5.0, 5.0, 2.4 * np.pi], abs=0.1)
    assert (found.left, found.stretches) == (0.0, ((),) * 3)
    assert network_genus(found.network) == 1


# Mending of crossings that rounding makes.


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
