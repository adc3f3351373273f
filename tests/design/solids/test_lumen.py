"""Lumen solids, against closed forms: volume, cross-section, joints, handles."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

from design.errors import SolidError
from design.network import VesselNetwork
from design.solids import Solid, lumen_pair, lumen_solid, surface_genus
from design.solids.topology import edge_faults
from tests.design.solids.networks import channels, ladder, vessel
from tests.slower import examples, first_of

TURN, _ = np.linalg.qr(np.random.default_rng(1).normal(size=(3, 3)))
TURN *= np.sign(np.linalg.det(TURN))


def _assert_solid(solid: Solid) -> None:
    """Closed, oriented, and unmoved by rounding to float32."""
    assert not edge_faults(solid.faces)
    assert solid.volume_mm3 > 0
    rounded = solid.vertices.astype(np.float32)
    assert np.array_equal(rounded.astype(np.float64), solid.vertices)
    assert len(np.unique(rounded, axis=0)) == len(rounded)


def _area(solid: Solid, origin: np.ndarray, normal: np.ndarray) -> float:
    """Area of a plane section."""
    section = trimesh.Trimesh(solid.vertices, solid.faces).section(normal, origin)
    return float(section.to_2D()[0].area)


@settings(max_examples=examples(40), deadline=None)
@given(
    first=st.floats(0.08, 2.0),
    ratio=st.floats(0.3, 3.0),
    length=st.floats(2.0, 20.0),
    seed=st.integers(0, 2**32 - 1),
)
def test_a_tapered_capsule_has_the_volume_of_its_cone_and_half_balls(first, ratio, length, seed):
    rng = np.random.default_rng(seed)
    direction = rng.normal(size=3)
    start = rng.uniform(-50, 50, 3)
    end = start + length * direction / np.linalg.norm(direction)
    last = first * ratio
    solid = lumen_solid(vessel([start, end], [first, last]))
    _assert_solid(solid)
    cone = np.pi * length * (first**2 + first * last + last**2) / 3
    exact = cone + 2 / 3 * np.pi * (first**3 + last**3)
    assert solid.volume_mm3 == pytest.approx(exact, rel=1e-4)


@pytest.mark.parametrize("radius", [0.05, 0.2, 0.75, 4.0])
def test_the_cross_section_has_the_circles_area(radius: float) -> None:
    solid = lumen_solid(vessel([[0, 0, 0], [3, 4, 12]], radius))
    axis = np.array([3, 4, 12]) / 13
    for share in (0.31, 0.5, 0.77):
        area = _area(solid, share * 13 * axis, axis)
        assert area == pytest.approx(np.pi * radius**2, rel=2e-4)


def test_facets_stay_within_the_tolerance_of_the_cylinder() -> None:
    solid = lumen_solid(vessel([[0, 0, 0], [10, 0, 0]], 0.5), extend_ends_mm=1.0)
    corners = solid.vertices[solid.faces]
    middle = corners.mean(axis=1)
    side = (middle[:, 0] > -0.9) & (middle[:, 0] < 10.9)
    edges = (corners + np.roll(corners, 1, axis=1)) / 2
    off = np.linalg.norm(np.concatenate([corners, edges], axis=1)[side][..., 1:], axis=-1) - 0.5
    assert np.abs(off).max() < 0.001
    assert off.max() > 0 > off.min()


@pytest.mark.parametrize("turn", [np.eye(3), TURN])
def test_an_elbow_is_two_cylinders_and_a_ball(turn: np.ndarray) -> None:
    """Cylinders over L each, less their overlap, plus the quarter ball that neither covers.

    Perpendicular half-cylinders from one point share a quarter of the bicylinder's 16 r³/3; of
    the ball at the corner, the quarter on the far side of both discs is outside of both.
    """
    radius, length = 0.5, 4.0
    nodes = np.array([[length, 0, 0], [0, 0, 0], [0, length, 0]]) @ turn.T
    solid = lumen_solid(channels(nodes, [(0, 1), (1, 2)], radius), tolerance_mm=2e-4)
    _assert_solid(solid)
    tubes = 2 * np.pi * radius**2 * length - 4 / 3 * radius**3
    exact = tubes + np.pi * radius**3 / 3 + 4 / 3 * np.pi * radius**3
    assert solid.volume_mm3 == pytest.approx(exact, rel=1e-3)


def test_a_cross_of_three_axes_has_the_tricylinders_overlap() -> None:
    """Union of three: 3 V - 3 · 16 r³/3 + 8 (2 - √2) r³, for cylinders through one point."""
    radius, half = 0.4, 3.0
    arms = np.concatenate([half * np.eye(3), -half * np.eye(3)])
    network = channels([[0, 0, 0], *arms], [(0, k) for k in range(1, 7)], radius)
    solid = lumen_solid(network, tolerance_mm=2e-4)
    _assert_solid(solid)
    cylinders = 3 * np.pi * radius**2 * 2 * half
    overlap = 16 * radius**3 - 8 * (2 - np.sqrt(2)) * radius**3
    exact = cylinders - overlap + 6 * 2 / 3 * np.pi * radius**3
    assert solid.volume_mm3 == pytest.approx(exact, rel=1e-3)


@pytest.mark.parametrize("closed_in", first_of([5, 1]))
def test_a_smooth_ring_is_a_torus(closed_in: int) -> None:
    turn = np.linspace(0, 2 * np.pi, 101)
    points = np.stack([4 * np.cos(turn), 4 * np.sin(turn), 0 * turn], axis=1) @ TURN.T
    points[-1] = points[0]
    cuts = np.linspace(0, 100, closed_in + 1).astype(int)
    parts = [points[a : b + 1] for a, b in itertools.pairwise(cuts)]
    network = VesselNetwork(
        nodes=points[cuts[:-1]],
        vessel_nodes=np.array([(k, (k + 1) % closed_in) for k in range(closed_in)]),
        kind=np.zeros(closed_in, dtype=int),
        tree=np.zeros(closed_in, dtype=int),
        offset=np.r_[0, np.cumsum([len(part) for part in parts])],
        points=np.concatenate(parts),
        radius=np.full(sum(len(part) for part in parts), 0.5),
    )
    solid = lumen_solid(network)
    _assert_solid(solid)
    assert surface_genus(solid.faces) == (1, 1)
    assert solid.volume_mm3 == pytest.approx(2 * np.pi**2 * 4 * 0.25, rel=2e-3)


@pytest.mark.slow
@settings(max_examples=examples(25), deadline=None)
@given(seed=st.integers(0, 2**32 - 1))
def test_random_tangles_stay_closed(seed: int) -> None:
    """Vessels that cross, overlap and coincide: whatever the union is, it's a solid."""
    rng = np.random.default_rng(seed)
    nodes = np.unique(rng.integers(0, 4, (12, 3)), axis=0).astype(float)
    ends = rng.integers(0, len(nodes), (16, 2))
    ends = ends[ends[:, 0] != ends[:, 1]]
    turn = TURN if seed % 2 else np.eye(3)
    network = channels(nodes @ turn.T, ends, rng.choice([0.2, 0.25, 0.5], len(ends)))
    _assert_solid(lumen_solid(network, tolerance_mm=0.01))


def test_the_same_network_gives_the_same_bytes() -> None:
    first, second = lumen_solid(ladder()), lumen_solid(ladder())
    assert first.vertices.tobytes() == second.vertices.tobytes()
    assert first.faces.tobytes() == second.faces.tobytes()


def test_bad_input_is_refused() -> None:
    network = channels([[0, 0, 0], [1, 0, 0], [1, 0, 0]], [(0, 1), (1, 2)], 0.2)
    with pytest.raises(SolidError, match="vessel 1 has zero length"):
        lumen_solid(network)
    network = channels([[0, 0, 0], [1, 0, 0], [2, 0, 0]], [(0, 1), (1, 2)], 0.2)
    with pytest.raises(SolidError, match="node 1 isn't a free end"):
        lumen_solid(network, extend_ends_mm=1.0, extend_nodes=np.array([1]))
    with pytest.raises(SolidError, match="extend_ends_mm -1"):
        lumen_solid(network, extend_ends_mm=-1.0)


def test_facets_by_radius_keep_the_volume_and_stay_closed() -> None:
    fine, coarse = lumen_solid(ladder()), lumen_solid(ladder(), facet_ratio=0.05)
    _assert_solid(coarse)
    assert surface_genus(coarse.faces) == surface_genus(fine.faces)
    assert len(coarse.faces) < 0.3 * len(fine.faces)
    assert coarse.volume_mm3 == pytest.approx(fine.volume_mm3, rel=0.01)


def _branched(short_mm: float) -> VesselNetwork:
    """A stem and two branches; the stem is as long as is asked."""
    nodes = [(0, 0, 0), (short_mm, 0, 0), (short_mm + 4, 3, 0), (short_mm + 4, -3, 1)]
    return channels(nodes, [(0, 1), (1, 2), (1, 3)], [0.5, 0.4, 0.35])


@pytest.mark.parametrize("fillet", [0.0, 0.5])
@pytest.mark.parametrize("length_mm", [0.05, 2.0])
def test_a_pair_is_what_two_unions_are(length_mm: float, fillet: float) -> None:
    network, nodes = _branched(2.0), np.array([0, 3])
    closed, opened = lumen_pair(network, length_mm, nodes, fillet_ratio=fillet)
    one = lumen_solid(network, fillet_ratio=fillet)
    two = lumen_solid(network, fillet_ratio=fillet, extend_ends_mm=length_mm, extend_nodes=nodes)
    for solid, wanted in ((closed, one), (opened, two)):
        _assert_solid(solid)
        assert len(solid.faces) == len(wanted.faces)
        assert np.array_equal(np.sort(solid.vertices, axis=0), np.sort(wanted.vertices, axis=0))


def test_a_helix_has_the_volume_of_its_pieces() -> None:
    """Pappus: a mitred tube's volume is area times axis length, its ends apart."""
    turn = np.linspace(0, 4 * np.pi, 240)
    points = np.stack([3 * np.cos(turn), 3 * np.sin(turn), 0.4 * turn], axis=1)
    solid = lumen_solid(vessel(points, 0.3))
    _assert_solid(solid)
    length = np.linalg.norm(np.diff(points, axis=0), axis=1).sum()
    exact = np.pi * 0.09 * length + 4 / 3 * np.pi * 0.027
    assert solid.volume_mm3 == pytest.approx(exact, rel=5e-4)
    assert surface_genus(solid.faces) == (0, 1)
