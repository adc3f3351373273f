import numpy as np
import pytest

from design.errors import GrowthError
from design.network import VesselKind
from design.tissue import block
from design.vasculature import (
    GrowthOptions,
    RootSpec,
    collisions,
    forest_to_network,
    grow_forest,
    tree_radii,
)
from design.vasculature.growth.surroundings import part_tissue
from tests.design.tissue import surfaces
from tests.design.tissue.kept import kept_tissue
from tests.design.vasculature import oracles
from tests.slower import first_of


@pytest.fixture(scope="module")
def tissues():
    return {
        "block": kept_tissue(block((20.0, 16.0, 12.0))),
        "torus": kept_tissue(surfaces.torus()),
        "hollow sphere": kept_tissue(surfaces.hollow_sphere()),
    }


def pair(count, seed=1, clearance_mm=0.0):
    options = GrowthOptions(terminals=count, seed=seed, clearance_mm=clearance_mm)
    return [RootSpec(options), RootSpec(options, VesselKind.VEIN)]


@pytest.mark.parametrize("seed", first_of(range(5)))
@pytest.mark.parametrize("name", ["block", "torus", "hollow sphere"])
def test_artery_and_vein_pervade_a_tissue_without_touching(tissues, name, seed):
    trees = grow_forest(tissues[name], pair(30, seed, 0.02))
    network = forest_to_network(trees, [VesselKind.ARTERY, VesselKind.VEIN])
    assert collisions(network, 0.02, 0.1).count == 0
    if seed == 0:
        assert oracles.colliding_pairs(network, 0.02, 0.1)[0] == set()
    for tree in trees:
        assert int((tree.children[:, 0] < 0).sum()) == 30
        flows = oracles.terminal_flows(tree, tree_radii(tree))
        assert np.ptp(flows) < 1e-9 * flows.mean()
        radius = tree_radii(tree)[1:]
        assert tissues[name].grid.capsule_inside(tree.proximal[1:], tree.distal[1:], radius).all()


def test_veins_flow_towards_their_root(tissues):
    trees = grow_forest(tissues["block"], pair(20))
    network = forest_to_network(trees, [VesselKind.ARTERY, VesselKind.VEIN])
    roots = np.array([tree.proximal[0] for tree in trees])
    inlets, outlets = network.inlets(), network.outlets()
    assert (network.nodes[inlets] == roots[0]).all(axis=1).any()
    assert (network.nodes[outlets] == roots[1]).all(axis=1).any()
    assert len(inlets) == len(outlets) == 21


def test_roots_of_a_kind_share_the_tissue_by_their_terminals(tissues):
    tissue = tissues["block"]
    settings = [
        RootSpec(GrowthOptions(terminals=90, root_point_mm=(3.0, 8.0, 0.0))),
        RootSpec(GrowthOptions(terminals=30, root_point_mm=(17.0, 8.0, 0.0))),
        RootSpec(GrowthOptions(terminals=60), VesselKind.VEIN),
    ]
    left, right, vein = grow_forest(tissue, settings)
    assert left.terminal_flow_ul_s == pytest.approx(right.terminal_flow_ul_s)
    total = 90 * left.terminal_flow_ul_s + 30 * right.terminal_flow_ul_s
    assert total == pytest.approx(60 * vein.terminal_flow_ul_s)
    # The border is a plane across x; three quarters of 20 mm are to its left.
    tips = [tree.distal[tree.children[:, 0] < 0, 0] for tree in (left, right)]
    assert tips[0].max() < tips[1].min() + 0.5
    assert tips[0].max() == pytest.approx(15.0, abs=1.0)


def test_bad_forests_are_refused(tissues):
    with pytest.raises(GrowthError, match="no roots"):
        grow_forest(tissues["block"], [])
    far = GrowthOptions(terminals=5, root_point_mm=(200.0, 0, 0), root_direction=(-1.0, 0, 0))
    with pytest.raises(GrowthError, match="never enters the tissue"):
        grow_forest(tissues["block"], [far])
    same = GrowthOptions(terminals=5, root_point_mm=(10.0, 8.0, 0.0))
    with pytest.raises(GrowthError, match="meets another tree"):
        grow_forest(tissues["block"], [same, same])


def test_territories_have_the_volumes_wanted(tissues):
    tissue = tissues["torus"]
    centre = np.array([[8.0, 0, 0], [-4.0, 6.5, 0], [-4.0, -6.5, 0]])
    wanted = np.array([0.2, 0.3, 0.5])
    parts = part_tissue(tissue, centre, wanted)
    np.testing.assert_allclose(parts.share, wanted, atol=5e-3)
    low, high = tissue.bounds
    points = np.random.default_rng(5).uniform(low, high, (60_000, 3))
    inside = points[tissue.contains(points)]
    share = [parts.owns(n)(inside).mean() for n in range(3)]
    np.testing.assert_allclose(share, wanted, atol=0.02)
