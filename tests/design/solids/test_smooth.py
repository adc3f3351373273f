"""Rounded junctions: the fillet against a rolled ball, and unions that stay closed."""

from __future__ import annotations

import numpy as np
import pytest

from design.errors import SolidError
from design.solids import Solid, lumen_solid, network_genus, surface_genus
from design.solids.smooth.fillet import rounded_distance, wall_rows
from design.solids.smooth.layout import lay_out
from design.solids.topology import edge_faults
from design.solids.tube import Facets
from tests.design.solids.networks import channels, ladder, lattice
from tests.slower import first_of

TURN, _ = np.linalg.qr(np.random.default_rng(1).normal(size=(3, 3)))
TURN *= np.sign(np.linalg.det(TURN))
FORK = channels([[0, 0, 0], [5, 0, 0], [9, 3, 0], [9, -3, 1]], [(0, 1), (1, 2), (1, 3)], 0.4)


def _assert_solid(solid: Solid) -> None:
    assert not edge_faults(solid.faces)
    assert solid.volume_mm3 > 0
    assert np.array_equal(solid.vertices.astype(np.float32).astype(float), solid.vertices)


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


def test_the_same_network_gives_the_same_bytes() -> None:
    one, two = lumen_solid(FORK, fillet_ratio=0.5), lumen_solid(FORK, fillet_ratio=0.5)
    assert one.vertices.tobytes() == two.vertices.tobytes()
    assert one.faces.tobytes() == two.faces.tobytes()


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
