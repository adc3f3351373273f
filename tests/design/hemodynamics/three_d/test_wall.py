"""Signed distance field of lumen walls, against tubes and cones; projection onto it."""

from dataclasses import replace

import numpy as np
import pytest

from design.errors import FlowError
from design.hemodynamics.three_d import LumenMesh, least_jacobian, straighten_edges
from design.hemodynamics.three_d.meshing.lumen_mesh import jacobian, nodes, quadratic, triangle_rule
from design.hemodynamics.three_d.meshing.wall import lumen_wall
from kernels.arrays import FloatArray
from tests.design.hemodynamics.three_d.lumens import pipe
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


# Curved elements: guaranteed bound of the Jacobian, against sampling; straightening.


def _sampled(mesh: LumenMesh) -> FloatArray:
    """Least determinant at many points of each element, over the straight one's."""
    node = mesh.points[mesh.tets]
    found = np.linalg.det(jacobian(node, quadratic(nodes(8))[1]))
    corner = node[:, :4]
    return np.asarray(found.min(axis=1) / np.linalg.det(corner[:, 1:] - corner[:, :1]))


def _pushed(mesh: LumenMesh, far: float) -> LumenMesh:
    """One edge's node pushed along the pipe, far enough to fold what is beside it."""
    points = mesh.points.copy()
    points[mesh.tets[0, 4]] += [0.0, 0.0, far]
    return replace(mesh, points=points)


@pytest.mark.parametrize("far", [0.02, 0.1, 0.4])
def test_the_bound_is_below_every_sample_and_not_far(far: float) -> None:
    mesh = _pushed(pipe(2, 4), far)
    bound, sampled = least_jacobian(mesh), _sampled(mesh)
    assert np.all(bound <= sampled + 1e-12)
    assert np.all(bound > sampled - 0.5 * np.abs(1.0 - sampled) - 1e-12)


def test_folded_elements_are_straightened_and_others_left() -> None:
    mesh = _pushed(pipe(2, 4), 0.8)
    assert _sampled(mesh).min() < 0.0
    mended, count = straighten_edges(mesh)
    assert 0 < count < 20
    assert _sampled(mended).min() > 0.0
    assert np.array_equal(mended.points[: mesh.corner_count], mesh.points[: mesh.corner_count])
    moved = np.any(mended.points != mesh.points, axis=1)
    assert 0 < moved.sum() < 40


def test_an_inverted_element_is_refused_with_its_place() -> None:
    mesh = pipe(1, 2)
    tets = mesh.tets.copy()
    tets[5] = tets[5][[1, 0, 2, 3, 4, 6, 5, 8, 7, 9]]
    with pytest.raises(FlowError, match=r"element 5 .* inverted .* mm; 1 such of 36"):
        least_jacobian(replace(mesh, tets=tets))


def test_the_rule_on_triangles_is_exact_to_degree_4() -> None:
    from math import factorial

    at, weight = triangle_rule()
    for i in range(5):
        for j in range(5 - i):
            exact = 2.0 * factorial(i) * factorial(j) / factorial(i + j + 2)
            assert weight @ (at[:, 0] ** i * at[:, 1] ** j) == pytest.approx(exact, rel=1e-13)
