"""Signed distance field of lumen walls, against tubes and cones; projection onto it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from design.errors import FlowError
from design.hemodynamics.three_d.lagrange import triangle_rule
from design.hemodynamics.three_d.wall import lumen_wall
from kernels.arrays import FloatArray
from tests.design.hemodynamics.networks import network_of
from tests.design.hemodynamics.three_d.shapes import bent, cross, straight, thick_and_thin


def _around(axis: FloatArray, count: int, seed: int) -> tuple[FloatArray, FloatArray]:
    """Unit vectors square to an axis, and numbers in 0 to 1."""
    rng = np.random.default_rng(seed)
    side = np.cross(axis, rng.normal(size=(count, 3)))
    return side / np.linalg.norm(side, axis=1)[:, None], rng.uniform(size=count)


@pytest.mark.parametrize("taper", [1.0, 0.5])
def test_the_field_of_a_vessel_is_the_distance_from_its_cone(taper: float) -> None:
    network = straight(0.5, 4.0, taper)
    axis = (network.points[1] - network.points[0]) / 4.0
    side, s = _around(axis, 200, 1)
    s = 0.5 + 3.0 * s
    away = np.random.default_rng(2).uniform(0.1, 0.7, 200)
    points = network.points[0] + s[:, None] * axis + away[:, None] * side
    slope = (taper - 1.0) * 0.5 / 4.0
    exact = (away - 0.5 - slope * s) / np.sqrt(1.0 + slope**2)
    found = lumen_wall(network, 0.5, 0.7).distance(points)
    assert found == pytest.approx(exact, abs=1e-12)


def test_a_free_end_goes_on_as_a_tube() -> None:
    network = straight(0.5, 4.0, 0.5)
    wall = lumen_wall(network, 0.5, 0.7)
    axis = (network.points[1] - network.points[0]) / 4.0
    side, s = _around(axis, 50, 3)
    beyond = network.points[1] + 0.5 * s[:, None] * axis + 0.3 * side
    assert wall.distance(beyond) == pytest.approx(np.full(50, 0.05), abs=1e-12)


def test_points_are_laid_on_wall_port_and_rim() -> None:
    network = straight(0.5, 4.0)
    wall = lumen_wall(network, 0.5, 0.7)
    axis = (network.points[1] - network.points[0]) / 4.0
    side, s = _around(axis, 60, 4)
    start = network.points[0] + (4.0 * s)[:, None] * axis + 0.45 * side
    on = wall.onto(start, np.zeros(60, np.int64))
    assert on == pytest.approx(start + 0.05 * side, abs=1e-8)
    first = next(k for k, port in enumerate(wall.ports) if port.node == 0)
    near = network.points[0] + 0.02 * axis + 0.3 * side
    flat = wall.onto(near, np.full(60, first + 1))
    assert flat == pytest.approx(network.points[0] + 0.3 * side, abs=1e-12)
    rim = wall.onto(near + 0.15 * side, np.full(60, -2 - first))
    assert rim == pytest.approx(network.points[0] + 0.5 * side, abs=1e-8)


def test_a_fillet_is_outside_the_sharp_union_and_within_its_ball() -> None:
    network = cross()
    sharp, soft = (lumen_wall(network, ratio, 0.7) for ratio in (1e-6, 0.5))
    points = np.random.default_rng(5).uniform(-1.5, 1.5, (4000, 3))
    before, after = sharp.distance(points), soft.distance(points)
    near = np.abs(before) < 0.3
    assert (after[near] <= before[near] + 1e-6).all()
    filled = (before > 0.0) & (after < 0.0)
    assert filled.any()
    # The ball of 0.15 mm touches two walls at least: nothing farther than it is filled.
    assert before[filled].max() < 0.15
    far = np.linalg.norm(points, axis=1) > 1.4
    inside = far & (before < -0.05)
    assert after[inside] == pytest.approx(before[inside], abs=1e-3)


def test_a_finely_drawn_bend_has_the_field_of_a_ring() -> None:
    """Hundreds of pieces in one cell: all of them count."""
    network = bent(400)
    wall = lumen_wall(network, 0.5, 0.7)
    rng = np.random.default_rng(6)
    phi, psi = rng.uniform(0.1, 1.4, 300), rng.uniform(0.0, 2.0 * np.pi, 300)
    away = rng.uniform(0.3, 0.5, 300)
    wide = 2.0 + away * np.cos(psi)
    points = np.stack([wide * np.cos(phi), wide * np.sin(phi), away * np.sin(psi)], axis=1)
    assert wall.distance(points) == pytest.approx(away - 0.4, abs=2e-5)


def test_sizes_follow_the_vessel_that_is_nearest_in_radii() -> None:
    network = thick_and_thin()
    wall = lumen_wall(network, 0.5, 0.7)
    points = np.array([[1.0, 1.0, 0.0], [7.0, 0.0, 1.0], [4.05, 1.4, 0.0], [4.0, -1.0, 0.0]])
    assert wall.size(points) == pytest.approx(0.7 * np.array([1.0, 1.0, 0.05, 1.0]))


def test_pieces_of_nothing_are_refused_by_name() -> None:
    network = straight()
    still = replace(network, points=network.points[[0, 0]], nodes=network.nodes[[0, 0]])
    with pytest.raises(FlowError, match="vessel 0 has a piece without length"):
        lumen_wall(still, 0.5, 0.7)


def test_the_rule_on_triangles_is_exact_to_degree_4() -> None:
    from math import factorial

    at, weight = triangle_rule()
    for i in range(5):
        for j in range(5 - i):
            exact = 2.0 * factorial(i) * factorial(j) / factorial(i + j + 2)
            assert weight @ (at[:, 0] ** i * at[:, 1] ** j) == pytest.approx(exact, rel=1e-13)


def test_ports_stand_at_free_ends_square_to_their_vessels() -> None:
    network = network_of([[0, 0, 0], [0, 0, 2.0], [0, 1.5, 3.0]], [(0, 1), (1, 2)], [0.3, 0.2])
    ports = lumen_wall(network, 0.5, 0.7).ports
    assert [(p.node, p.inlet, p.radius_mm) for p in ports] == [(0, True, 0.3), (2, False, 0.2)]
    assert ports[0].outward == pytest.approx([0.0, 0.0, -1.0])
    assert ports[1].outward == pytest.approx(np.array([0.0, 1.5, 1.0]) / np.hypot(1.5, 1.0))
