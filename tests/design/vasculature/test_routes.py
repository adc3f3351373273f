"""Routed connections around obstacles, and terminals that stay unjoined."""

import numpy as np
import pytest

from design.errors import GrowthError
from design.hemodynamics import FlowConditions, balance, flow_spread
from design.network import VesselKind
from design.vasculature import (
    GrowthOptions,
    LoopOptions,
    RootSpec,
    close_loops,
    collisions,
    grow_forest,
)
from design.vasculature.loops.connect import Web
from design.vasculature.loops.loops import open_web, tree_ends
from tests.design.tissue import surfaces
from tests.design.tissue.kept import kept_tissue


@pytest.fixture(scope="module")
def torus():
    shape = surfaces.torus()
    return kept_tissue(shape)


@pytest.fixture(scope="module")
def web(torus):
    settings = GrowthOptions(terminals=4)
    ends, vessels = tree_ends(grow_forest(torus, [settings, settings]))
    found = open_web(torus, ends, np.arange(4), vessels, LoopOptions())
    # Nothing in the way but the surface.
    found.capsules["there"] = 0
    return found


def test_a_few_that_find_no_way_are_pruned_and_counted(torus, monkeypatch):
    settings = GrowthOptions(terminals=40)
    trees = grow_forest(torus, [RootSpec(settings), RootSpec(settings, VesselKind.VEIN)])
    whole = close_loops(torus, *trees)
    assert (whole.connections, whole.pruned) == (40, 0)
    whole_way = Web.lay_all

    def all_but_two(web):
        whole_way(web)
        for number in (3, 17):
            web._fell(number)

    monkeypatch.setattr(Web, "lay_all", all_but_two)
    with pytest.raises(GrowthError, match=r"2 of 40 connections found no way .* \(0 may be"):
        close_loops(torus, *trees)
    fewer = close_loops(torus, *trees, LoopOptions(prune_part=0.05))
    assert (fewer.connections, fewer.pruned) == (38, 2)
    network = fewer.network
    assert (network.kind == VesselKind.CONNECTION).sum() == 38
    assert len(network.inlets()) == len(network.outlets()) == 1
    assert collisions(network, 0.0, 0.1).count == 0
    conditions = FlowConditions(4e-3, inlet_flow_ul_s=1.0)
    assert flow_spread(network, conditions) > 1e-3
    narrowed = balance(network, conditions, widen=False)
    assert flow_spread(narrowed, conditions) < 1e-9
    assert collisions(narrowed, 0.0, 0.1).count == 0
