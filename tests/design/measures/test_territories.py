"""Terminals' supply compared with the demand of the tissue nearest to each."""

import numpy as np
import pytest

from design.measures import measure_network, measures_dict
from design.measures.measure import MeasureOptions, measure_territories
from design.network import VesselKind, VesselNetwork
from design.tissue import block
from tests.design.tissue.kept import kept_tissue

ARTERY, VEIN, CONNECTION = VesselKind.ARTERY, VesselKind.VEIN, VesselKind.CONNECTION


@pytest.fixture(scope="module")
def box():
    shape = block((20.0, 10.0, 10.0))
    return kept_tissue(shape)


def network(kinds):
    """A fork in the middle, its ends at a quarter and three quarters, joined again beyond."""
    nodes = np.array([[10.0, 5, 0], [10, 5, 3], [5, 5, 5], [15, 5, 5], [10, 5, 8], [10, 5, 10]])
    ends = np.array([[0, 1], [1, 2], [1, 3], [2, 4], [3, 4], [4, 5]])[: len(kinds)]
    zeros = np.zeros(len(kinds), dtype=np.int64)
    return VesselNetwork.from_segments(
        nodes[: ends.max() + 1], ends, np.full(len(kinds), 0.2), np.array(kinds), zeros
    )


def test_a_tree_s_terminals_are_its_outlets(box):
    found = measure_territories(network([ARTERY] * 3), box, np.array([4.0, 3.0, 1.0]), 1)
    assert found.terminals == 2
    assert found.worst == pytest.approx(0.5, rel=0.01)
    assert found.worst_at_mm == (15.0, 5.0, 5.0)


def test_in_a_closed_loop_they_are_where_arteries_end(box):
    kinds = [ARTERY, ARTERY, ARTERY, CONNECTION, VEIN, VEIN]
    flow = np.array([4.0, 2.0, 2.0, 2.0, 2.0, 4.0])
    found = measure_territories(network(kinds), box, flow, 1)
    assert found.terminals == 2
    assert found.worst == pytest.approx(1.0, rel=0.01)


def test_all_measures_have_it_and_hand_it_on(box):
    options = MeasureOptions(samples=2000)
    flow = np.array([4.0, 3.0, 1.0])
    found = measure_network(network([ARTERY] * 3), box, options, flow)
    table = measures_dict(found)["territories"]
    assert table["p5"] == pytest.approx(0.5, rel=0.01)
    assert table["worst_at_mm"] == [15.0, 5.0, 5.0]
    assert measure_network(network([ARTERY] * 3), box, options).territories is None
    one = network([ARTERY])
    assert measure_network(one, box, options, np.ones(1)).territories is None
