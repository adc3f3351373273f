"""Signed distance field of lumen walls, against tubes and cones; projection onto it."""

from __future__ import annotations

import numpy as np
import pytest

from design.hemodynamics.three_d.wall import lumen_wall
from kernels.arrays import FloatArray
from tests.design.hemodynamics.three_d.shapes import bent, cross, straight


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
