"""Curved elements: guaranteed bound of the Jacobian, against sampling; straightening."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from design.errors import FlowError
from design.hemodynamics.three_d import LumenMesh, least_jacobian, straighten_edges
from design.hemodynamics.three_d.lagrange import jacobian, nodes, quadratic
from kernels.arrays import FloatArray
from tests.design.hemodynamics.three_d.lumens import pipe


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
