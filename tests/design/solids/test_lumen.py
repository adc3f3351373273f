"""Lumen solids, against closed forms, and their rounded junctions, against a rolled ball."""

import itertools

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

from design.errors import SolidError
from design.network import VesselNetwork
from design.solids import (
    Solid,
    find_crossings,
    lumen_pair,
    lumen_solid,
    network_genus,
    surface_genus,
)
from design.solids.smooth.fillet import rounded_distance, wall_rows
from design.solids.smooth.layout import lay_out
from design.solids.topology import edge_faults
from design.solids.tube import Facets
from tests.design.networks import polylines
from tests.design.solids.networks import channels, ladder, lattice, vessel
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
    solid = lumen_solid(polylines(parts, 0.5))
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


@pytest.mark.parametrize("fillet", [0.0, 0.5])
def test_the_same_network_gives_the_same_bytes(fillet: float) -> None:
    first, second = (lumen_solid(ladder(), fillet_ratio=fillet) for _ in range(2))
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


# Rounded junctions.


FORK = channels([[0, 0, 0], [5, 0, 0], [9, 3, 0], [9, -3, 1]], [(0, 1), (1, 2), (1, 3)], 0.4)


@pytest.mark.parametrize("turn", [TURN, pytest.param(np.eye(3), marks=pytest.mark.slow)])
@pytest.mark.parametrize("ratio", [0.0, 0.25, 0.5, 1.0])
def test_a_cross_of_six_is_closed_and_grows_with_its_fillet(turn: np.ndarray, ratio: float) -> None:
    arms = np.concatenate([3.0 * np.eye(3), -3.0 * np.eye(3)]) @ turn.T
    network = channels([[0, 0, 0], *arms], [(0, k) for k in range(1, 7)], 0.4)
    solid = lumen_solid(network, fillet_ratio=ratio)
    _assert_solid(solid)
    assert surface_genus(solid.faces) == (0, 1)
    sharp = lumen_solid(network)
    if ratio:
        assert solid.volume_mm3 > sharp.volume_mm3 * (1.0 + 0.015 * ratio**2)


@pytest.mark.parametrize("ratio", [0.0, pytest.param(0.5, marks=pytest.mark.slow)])
def test_loops_keep_their_genus(ratio: float) -> None:
    for network in (ladder(), lattice(3, 2.0, 0.3), lattice(3, 2.0, 0.3, TURN)):
        solid = lumen_solid(network, fillet_ratio=ratio)
        _assert_solid(solid)
        assert surface_genus(solid.faces) == (network_genus(network), 1)


@pytest.mark.parametrize("ratio", [0.0, 0.5])
@pytest.mark.slow
def test_junctions_closer_than_their_width_are_united_in_a_crowd(ratio: float) -> None:
    nodes = np.array([[0, 0, 0], [3, 0, 0], [3.3, 0, 0], [6, 0, 0], [3, 3, 0], [3.3, -3, 0]])
    ends = [(0, 1), (1, 2), (2, 3), (1, 4), (2, 5)]
    network = channels(nodes @ TURN.T, ends, [0.5, 0.5, 0.5, 0.3, 0.3])
    layout = lay_out(network, Facets(0.001), ratio, None)
    assert layout.swallowed == [False, True, False, False, False]
    solid = lumen_solid(network, fillet_ratio=ratio)
    _assert_solid(solid)
    assert surface_genus(solid.faces) == (0, 1)


def test_a_negative_fillet_is_refused() -> None:
    with pytest.raises(SolidError, match="fillet -1"):
        lumen_solid(FORK, fillet_ratio=-1.0)
    with pytest.raises(SolidError, match="fillet nan"):
        lumen_solid(FORK, fillet_mm=float("nan"))


def _crossings(solid: Solid) -> int:
    """Pairs of an edge and a triangle without a common vertex that cross: every pair is tried."""
    corners, faces = solid.vertices[solid.faces], solid.faces
    low, high = corners.min(axis=1), corners.max(axis=1)
    found = 0
    for index, (a, b, c) in enumerate(corners):
        near = np.flatnonzero(np.all((low <= high[index]) & (high >= low[index]), axis=1))
        near = near[~np.isin(faces[near], faces[index]).any(axis=1)]
        normal = np.cross(b - a, c - a)
        for k in range(3):
            p, q = corners[near, k], corners[near, (k + 1) % 3]
            over, under = (p - a) @ normal, (q - a) @ normal
            crosses = over * under < 0.0
            at = p + (over / np.where(crosses, over - under, 1.0))[:, None] * (q - p)
            for tail, head in ((a, b), (b, c), (c, a)):
                crosses &= np.cross(head - tail, at - tail) @ normal > 1e-9 * normal @ normal
            found += int(crosses.sum())
    return found


@pytest.mark.parametrize("ratio", first_of([0.5, 0.0]))
def test_no_triangle_crosses_another(ratio: float) -> None:
    short = [[-4, 0, 0], [0, 0, 0], [1.3, 0, 0], [5, 0, 0], [3, 3, 0], [-1.5, -3, 0]]
    crowd = channels(short, [(0, 1), (1, 2), (2, 3), (1, 4), (2, 5)], [0.5, 0.5, 0.5, 0.1, 0.1])
    arms = np.concatenate([3.0 * np.eye(3), -3.0 * np.eye(3)]) @ TURN.T
    cross = channels([[0, 0, 0], *arms], [(0, k) for k in range(1, 7)], 0.4)
    for network in (FORK, crowd, cross):
        assert _crossings(lumen_solid(network, fillet_ratio=ratio, tolerance_mm=0.02)) == 0


def _distances(walls: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Distance of points (m, 3) from each half-infinite tube, (m, n): plain NumPy."""
    along = np.maximum(points @ walls[:, 3:6].T, 0.0)
    gap = points[:, None] - along[..., None] * walls[None, :, 3:6]
    return np.linalg.norm(gap, axis=2) - walls[:, 7]


def _walls(axes: np.ndarray, radius: np.ndarray) -> np.ndarray:
    axes = axes / np.linalg.norm(axes, axis=1)[:, None]
    count = len(axes)
    return wall_rows(np.zeros((count, 3)), axes, np.full(count, np.inf), radius, np.zeros(count))


def test_a_point_is_filled_where_no_ball_outside_the_vessels_reaches_it() -> None:
    rng = np.random.default_rng(3)
    walls = _walls(
        np.array([[1.0, 0, 0], [-0.6, 0.8, 0.1], [-0.7, -0.7, 0.3]]), np.array([1, 0.8, 0.6])
    )
    rho = 0.4
    points = rng.uniform(-2.0, 2.0, (4000, 3))
    near = np.abs(_distances(walls, points).min(axis=1)) < rho
    balls = rng.normal(size=(4000, 3))
    balls *= rho * rng.random((4000, 1)) ** (1 / 3) / np.linalg.norm(balls, axis=1)[:, None]
    tried = 0
    for point in points[near][:250]:
        off = rounded_distance(walls, rho, *point)
        if abs(off) < 0.1 * rho:
            continue
        tried += 1
        reached = np.any(_distances(walls, point + balls).min(axis=1) >= rho)
        assert reached == (off > 0.0)
    assert tried > 100


def test_between_plane_walls_the_fillet_is_the_balls_arc() -> None:
    """Two tubes so wide that their walls are planes at a right angle, ball in the corner."""
    wide, rho = 1e4, 0.5
    walls = wall_rows(
        np.array([[0, -wide, 0], [-wide, 0, 0]]), np.array([[0, 0, 1.0], [0, 0, 1.0]]),
        np.full(2, np.inf), np.full(2, wide), np.zeros(2),
    )  # fmt: skip
    angle = np.linspace(0.1, 1.4, 7)
    arc = rho - rho * np.stack([np.cos(angle), np.sin(angle), 0 * angle - 2.0], axis=1)
    found = np.array([rounded_distance(walls, rho, *point) for point in arc])
    assert found == pytest.approx(0.0, abs=2e-5)


# Rounded seams of groups of overlapping junctions.


PAIR = np.array([[0, 1, 0], [3, 0, 0], [3.3, 0, 0], [6, 0.7, 0], [3, 3, 0], [3.3, -3, 0]])
CROWD = channels(PAIR @ TURN.T, [(0, 1), (1, 2), (2, 3), (1, 4), (2, 5)], [0.5, 0.5, 0.5, 0.3, 0.3])


def _assert_uncrossed(solid: Solid) -> None:
    _assert_solid(solid)
    assert len(find_crossings(solid.vertices, solid.faces).pairs) == 0


def _sharp_share(solid: Solid, middle: np.ndarray, reach: float) -> float:
    """Area beside edges with a bend over 41°, of the area around ``middle``."""
    faces = solid.faces.astype(np.int64)
    a, b, c = (solid.vertices[faces[:, k]] for k in range(3))
    normal = np.cross(b - a, c - a)
    area = np.linalg.norm(normal, axis=1)
    normal /= np.maximum(area, 1e-30)[:, None]
    tail, head = faces.ravel(), np.roll(faces, -1, axis=1).ravel()
    size = len(solid.vertices)
    one, two = np.argsort(tail * size + head) // 3, np.argsort(head * size + tail) // 3
    near = (np.linalg.norm(solid.vertices - middle, axis=1) < reach)[faces].all(axis=1)
    bent = near[one] & near[two] & (np.sum(normal[one] * normal[two], axis=1) < 0.75)
    return float(np.minimum(area[one], area[two])[bent].sum() / area[near].sum())


@pytest.mark.slow
def test_seams_of_a_crowd_are_gone_with_a_fillet() -> None:
    layout = lay_out(CROWD, Facets(0.001), 0.5, None)
    assert sum(layout.swallowed) == 1
    middle = TURN @ np.array([3.15, 0, 0])
    sharp, round_ = lumen_solid(CROWD), lumen_solid(CROWD, fillet_ratio=0.5)
    _assert_uncrossed(round_)
    assert surface_genus(round_.faces) == (0, 1)
    # What is left are needles of the union, a thousandth of a radius wide.
    assert _sharp_share(sharp, middle, 1.2) > 0.04
    assert _sharp_share(round_, middle, 1.2) < 0.015
    assert sharp.volume_mm3 < round_.volume_mm3 < 1.01 * sharp.volume_mm3


def test_a_crowds_fillet_is_that_of_a_junction_alone() -> None:
    """A branch on a straight trunk, once cut so short beside it that both make a crowd."""
    nodes = [[-4, 0, 0], [0, 0, 0], [4, 0, 0], [0, 3, 0]]
    alone = channels(nodes, [(0, 1), (1, 2), (1, 3)], [0.5, 0.5, 0.3])
    nodes = [*nodes, [0.3, 0, 0], [0.3, 0, -3]]
    beside = channels(nodes, [(0, 1), (1, 4), (4, 2), (1, 3), (4, 5)], [0.5, 0.5, 0.5, 0.3, 0.3])
    both = lumen_solid(beside, fillet_mm=0.15).volume_mm3 - lumen_solid(beside).volume_mm3
    one = lumen_solid(alone, fillet_mm=0.15).volume_mm3 - lumen_solid(alone).volume_mm3
    assert both == pytest.approx(2.0 * one, rel=0.1)


@pytest.mark.slow
def test_loops_with_crowds_keep_their_genus() -> None:
    for network in (ladder(), lattice(2, 1.2, 0.3, TURN)):
        solid = lumen_solid(network, fillet_ratio=0.5, tolerance_mm=0.004)
        _assert_uncrossed(solid)
        assert surface_genus(solid.faces) == (network_genus(network), 1)


def test_vessels_with_no_room_between_them_arent_bridged() -> None:
    """Two branches side by side, their gap far below the ball: it stays open."""
    nodes = [[-3, 0, 0], [0, 0, 0], [0.7, 0, 0], [4, 0, 0], [0, 4, 0], [0.7, 4, 0]]
    network = channels(nodes, [(0, 1), (1, 2), (2, 3), (1, 4), (2, 5)], [0.4, 0.4, 0.4, 0.3, 0.3])
    solid = lumen_solid(network, fillet_mm=0.3, tolerance_mm=0.004)
    _assert_uncrossed(solid)
    assert surface_genus(solid.faces) == (0, 1)
    gap = np.abs(solid.vertices[:, 0] - 0.35) < 0.02
    # Between the branches nothing is filled, but at their very root.
    assert solid.vertices[gap & (np.abs(solid.vertices[:, 2]) < 0.1), 1].max(initial=0.0) < 3.0
