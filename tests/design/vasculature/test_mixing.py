"""Mixing networks: three and four trees at shared nodes."""

import numpy as np
import pytest

from design.errors import GrowthError
from design.hemodynamics import FlowConditions, solve_flow
from design.network import VesselKind
from design.tissue import block
from design.vasculature import GrowthOptions, RootSpec, collisions, grow_forest, mix_trees
from tests.design.tissue.kept import kept_tissue
from tests.slower import first_of

A, V, L, C = (
    VesselKind.ARTERY,
    VesselKind.VEIN,
    VesselKind.LYMPH,
    VesselKind.CONNECTION,
)
COUNT = 24


@pytest.fixture(scope="module")
def tissue():
    shape = block((20.0, 16.0, 12.0))
    return kept_tissue(shape)


def grown(tissue, kinds, counts=None, seed=1):
    counts = counts or [COUNT] * len(kinds)
    # Bare options: the two arteries pervade the whole tissue, so that each node gets both.
    return grow_forest(
        tissue,
        [
            RootSpec(GrowthOptions(terminals=n, seed=seed), kind)
            if kinds.count(kind) == 1
            else GrowthOptions(terminals=n, seed=seed)
            for kind, n in zip(kinds, counts, strict=True)
        ],
    )


@pytest.mark.parametrize("kinds", first_of([[A, A, V], [A, V, L], [A, V, A, V]]), ids=str)
def test_every_node_mixes_all_trees_in_equal_shares(tissue, kinds):
    mixed = mix_trees(tissue, grown(tissue, kinds), kinds)
    network = mixed.network
    assert mixed.connections == COUNT
    assert len(network.inlets()) == kinds.count(A)
    assert len(network.outlets()) == len(kinds) - kinds.count(A)
    limbs = network.kind == C
    assert limbs.sum() == len(kinds) * COUNT
    nodes = np.flatnonzero(network.degree() == len(kinds)) if len(kinds) > 3 else None
    if nodes is not None:
        assert len(nodes) == COUNT
    assert collisions(network, 0.0, 0.1).count == 0
    start, end, r0, r1, vessel = network.pieces()
    roots = np.concatenate([network.inlets(), network.outlets()])
    stem = np.isin(network.vessel_nodes, roots).any(axis=1)[vessel]
    assert tissue.grid.capsule_inside(start, end, np.maximum(r0, r1))[~stem].all()
    flow = solve_flow(network, FlowConditions(4e-3, inlet_pressure_pa=5e3)).flow
    assert flow.min() > 0
    for of_one in flow[limbs].reshape(len(kinds), COUNT):
        np.testing.assert_allclose(of_one, of_one.mean(), rtol=1e-9)


@pytest.mark.parametrize(
    ("kinds", "counts", "message"),
    [
        ([A, V], [4, 4], "2 trees of 2 kinds can't be mixed"),
        ([A, A, V], [4, 5, 4], "trees of 4, 5, 4 terminals"),
        ([A, A, A], [4, 4, 4], "kinds given are artery, artery, artery"),
    ],
)
def test_what_cannot_be_mixed_is_refused(tissue, kinds, counts, message):
    trees = grow_forest(tissue, [GrowthOptions(terminals=n, seed=1) for n in counts])
    with pytest.raises(GrowthError, match=message):
        mix_trees(tissue, trees, kinds)
