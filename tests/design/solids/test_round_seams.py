"""Rounded seams of groups of overlapping junctions."""

from __future__ import annotations

import numpy as np
import pytest

from design.solids import Solid, find_crossings, lumen_solid, network_genus, surface_genus
from design.solids.smooth.layout import lay_out
from design.solids.topology import edge_faults
from design.solids.tube import Facets
from tests.design.solids.networks import channels, ladder, lattice

TURN, _ = np.linalg.qr(np.random.default_rng(1).normal(size=(3, 3)))
PAIR = np.array([[0, 1, 0], [3, 0, 0], [3.3, 0, 0], [6, 0.7, 0], [3, 3, 0], [3.3, -3, 0]])
CROWD = channels(PAIR @ TURN.T, [(0, 1), (1, 2), (2, 3), (1, 4), (2, 5)], [0.5, 0.5, 0.5, 0.3, 0.3])


def _assert_sound(solid: Solid) -> None:
    assert not edge_faults(solid.faces)
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
    _assert_sound(round_)
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
        _assert_sound(solid)
        assert surface_genus(solid.faces) == (network_genus(network), 1)


def test_vessels_with_no_room_between_them_arent_bridged() -> None:
    """Two branches side by side, their gap far below the ball: it stays open."""
    nodes = [[-3, 0, 0], [0, 0, 0], [0.7, 0, 0], [4, 0, 0], [0, 4, 0], [0.7, 4, 0]]
    network = channels(nodes, [(0, 1), (1, 2), (2, 3), (1, 4), (2, 5)], [0.4, 0.4, 0.4, 0.3, 0.3])
    solid = lumen_solid(network, fillet_mm=0.3, tolerance_mm=0.004)
    _assert_sound(solid)
    assert surface_genus(solid.faces) == (0, 1)
    gap = np.abs(solid.vertices[:, 0] - 0.35) < 0.02
    # Between the branches nothing is filled, but at their very root.
    assert solid.vertices[gap & (np.abs(solid.vertices[:, 2]) < 0.1), 1].max(initial=0.0) < 3.0


@pytest.mark.slow
def test_the_same_crowd_gives_the_same_bytes() -> None:
    one, two = (lumen_solid(CROWD, fillet_ratio=0.5, tolerance_mm=0.004) for _ in range(2))
    assert one.vertices.tobytes() == two.vertices.tobytes()
    assert one.faces.tobytes() == two.faces.tobytes()
