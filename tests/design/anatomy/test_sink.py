"""Trunks sink to the depth that their radii need, along their whole way."""

import numpy as np
import pytest

from design.anatomy.trunk_depth import sink_trunk, with_bends
from design.tissue import Surface
from design.vasculature.treemath import tree_from_topology, tree_radii
from tests.design.tissue.kept import kept_tissue


@pytest.fixture(scope="module")
def grooved():
    """A block of 40 x 20 x 20 mm with a groove 4 mm deep across the middle of its top."""
    x, z = np.array([20, 30, 40, 40, 0, 0, 10.0]), np.array([16, 20, 20, 0, 0, 20, 20.0])
    front, back = (np.column_stack([x, np.full(7, y), z]) for y in (0.0, 20.0))
    fan = np.array([[0, i + 1, i] for i in range(1, 6)])
    around = np.arange(7)
    after = np.roll(around, -1)
    side = np.column_stack([around, after, after + 7])
    other = np.column_stack([around, after + 7, around + 7])
    faces = np.concatenate([fan, fan[:, ::-1] + 7, side, other])
    return kept_tissue(Surface(np.concatenate([front, back]), faces))


def straight(points):
    """A trunk of one line whose end parts in two."""
    line = np.array(points, dtype=float)
    n = len(line) - 1
    ends = line[-1] + np.array([[3.0, 2.0, -1.0], [3.0, -2.0, -1.0]])
    parent = np.array([*np.arange(n) - 1, n - 1, n - 1], dtype=np.int32)
    children = np.full((n + 2, 2), -1, dtype=np.int32)
    children[: n - 1, 0] = np.arange(1, n)
    children[n - 1] = n, n + 1
    return tree_from_topology(
        np.concatenate([line[:-1], line[[-1, -1]]]),
        np.concatenate([line[1:], ends]),
        parent,
        children,
        flow_ul_s=5.0,
        pressure_drop_pa=20.0,
        murray_exponent=2.5,
        viscosity_pa_s=4e-3,
        given=np.ones(n + 2, dtype=np.bool_),
    )


def reaches_out(tissue, tree, clearance_mm):
    below = tree.parent >= 0
    inside = tissue.grid.capsule_inside(tree.proximal, tree.distal, tree_radii(tree), clearance_mm)
    return (~inside & below).any()


def test_a_piece_bends_below_a_groove_that_its_ends_do_not_lie_in(grooved):
    """Its ends alone were sunk before, a little each time, and whole coronaries went in the end."""
    tree = straight([[1, 10, 18], [8, 10, 18], [32, 10, 18]])
    assert reaches_out(grooved, tree, 0.1)
    sunk = sink_trunk(grooved, tree, 0.1)
    assert not reaches_out(grooved, sunk, 0.1)
    assert len(sunk.parent) > len(tree.parent)
    far = np.abs(sunk.distal[:, 0] - 20.0) > 11.0
    assert sunk.distal[far & (sunk.distal[:, 0] < 33), 2].min() > 17.0


def test_bends_change_neither_radii_nor_where_a_trunk_runs():
    tree = straight([[1, 10, 18], [8, 10, 18], [32, 10, 18]])
    bent = with_bends(tree, np.array([1, 3]))
    assert bent.distal[1].tolist() == [20.0, 10.0, 18.0]
    assert bent.children[1].tolist() == [4, -1]
    assert bent.children[4].tolist() == [2, 3]
    assert bent.parent.tolist() == [-1, 0, 4, 4, 1, 3]
    assert bent.given.all()
    np.testing.assert_allclose(tree_radii(bent)[:4], tree_radii(tree), rtol=1e-12)
    np.testing.assert_allclose(tree_radii(bent)[4:], tree_radii(tree)[[1, 3]], rtol=1e-12)
