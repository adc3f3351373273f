"""Division of vessels into elements: complete, straight, of limited length."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from design.toolpath.embedded.elements import STRAIGHT_MM, TAPER_STEP, elements_of, off_chords
from tests.design.toolpath.shapes import cage, helix, polyline, polylines, random_tree, ring

NETWORKS = {
    "tree": random_tree(9, 8, 1, 0.1),
    "cage": cage(5, 2.0, 3.0),
    "helix": polyline(helix(2, 2.0, 1.0), 0.2),
    "ring": polylines([ring(2.0, 0.3)], 0.2),
}


def gap_to_line(place, line):
    """Distance of a place from a polyline."""
    a, way = line[:-1], np.diff(line, axis=0)
    share = np.clip(((place - a) * way).sum(axis=1) / (way**2).sum(axis=1), 0, 1)
    return np.linalg.norm(a + share[:, None] * way - place, axis=1).min()


@pytest.mark.parametrize("name", NETWORKS)
def test_elements_run_along_their_vessels_from_node_to_node(name):
    net = NETWORKS[name]
    elements = elements_of(net, 0.15)
    assert np.array_equal(elements.point[: len(net.nodes)], net.nodes)
    assert elements.first.tolist()[-1] == len(elements.end)
    for vessel in range(net.vessel_count):
        own = slice(elements.first[vessel], elements.first[vessel + 1])
        end = elements.end[own]
        assert (elements.vessel[own] == vessel).all()
        assert np.array_equal(end[1:, 0], end[:-1, 1])
        assert [end[0, 0], end[-1, 1]] == net.vessel_nodes[vessel].tolist()
        length = np.linalg.norm(np.diff(elements.point[end], axis=1)[:, 0], axis=1)
        assert elements.length[own] == pytest.approx(length, rel=1e-12)
        assert elements.arc[own] == pytest.approx(np.cumsum(length) - length, abs=1e-9)


@pytest.mark.parametrize("name", NETWORKS)
def test_no_element_is_too_long_and_no_length_is_lost(name):
    net = NETWORKS[name]
    elements = elements_of(net, 0.15)
    assert elements.length.max() <= 0.15 * (1 + 1e-9)
    length = np.add.reduceat(elements.length, elements.first[:-1])
    assert length == pytest.approx(net.lengths(), rel=1e-3)  # chords of curves are shorter


@pytest.mark.parametrize("name", NETWORKS)
def test_every_point_of_a_vessel_lies_within_2_um_of_its_elements(name):
    net = NETWORKS[name]
    elements = elements_of(net, 0.15)
    for vessel in range(net.vessel_count):
        own = elements.end[elements.first[vessel] : elements.first[vessel + 1]]
        line = elements.point[np.append(own[:, 0], own[-1, 1])]
        assert max(gap_to_line(p, line) for p in net.polyline(vessel)[0]) <= STRAIGHT_MM + 1e-12


@given(
    st.lists(st.tuples(*[st.floats(-2, 2)] * 3), min_size=2, max_size=25),
    st.floats(1e-4, 0.01),
)
def test_points_left_out_lie_near_the_line_of_those_kept(points, wobble):
    line = np.cumsum(np.array(points), axis=0) * wobble
    radius = np.linspace(0.1, 0.2, len(line))
    keep = off_chords(line, radius)
    kept, thick = line[keep], radius[keep]
    assert np.array_equal(kept[[0, -1]], line[[0, -1]])
    assert np.array_equal(thick[[0, -1]], radius[[0, -1]])
    stands = np.linalg.norm(np.diff(kept, axis=0), axis=1) > 0
    if stands.all():
        assert max(gap_to_line(place, kept) for place in line) <= STRAIGHT_MM + 1e-12


def test_radii_are_those_along_a_tapered_vessel_in_steps_of_at_most_5_percent():
    net = polyline(np.array([[0.0, 0, 0], [4, 0, 3], [4, 0, 5]]), np.array([0.3, 0.1, 0.15]))
    elements = elements_of(net, 1.0)
    arc = np.column_stack([elements.arc, elements.arc + elements.length])
    expected = np.interp(arc, [0, 5, 7], [0.3, 0.1, 0.15])
    assert elements.radius == pytest.approx(expected, rel=1e-9)
    # Steps are equal in length, so the thin end's are somewhat more.
    assert np.abs(np.diff(np.log(elements.radius), axis=1)).max() < 2.2 * TAPER_STEP


def test_a_point_told_twice_makes_no_element_without_length():
    line = np.array([[0.0, 0, 0], [0, 0, 0], [1, 0, 0], [1, 1, 0], [1, 1, 0]])
    elements = elements_of(polyline(line, 0.2), 0.3)
    assert elements.length.min() > 0.2
    assert elements.length.sum() == pytest.approx(2.0)
