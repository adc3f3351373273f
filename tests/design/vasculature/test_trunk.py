"""Growth from a given artery, and in stages."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from design.errors import GrowthError
from design.network import VesselNetwork
from design.tissue import block, tissue_from_surface
from design.vasculature import (
    GrowthOptions,
    GrowthStage,
    collisions,
    grow_tree,
    tree_radii,
    tree_to_network,
)
from design.vasculature.growth.forest import RootSpec, grow_forest
from design.vasculature.growth.trunk import trunk_of
from tests.design.geometry.oracles import segment_segment
from tests.design.tissue.kept import kept_tissue
from tests.design.vasculature import oracles
from tests.slower import first_of

SHARED = Path(__file__).parents[4] / "shared" / "data"


@pytest.fixture(scope="module")
def box():
    shape = block((20.0, 16.0, 12.0))
    return kept_tissue(shape)


@pytest.fixture(scope="module")
def bent():
    """One artery that winds through the box, then parts in two."""
    t = np.linspace(0, 1, 60)
    main = np.column_stack([1 + 12 * t, 8 + 2 * np.sin(6 * t), 6 + 1.5 * np.cos(5 * t)])
    ends = main[-1] + np.array([[4.0, 3.0, 1.0], [4.0, -3.0, -1.0]])
    lines = [main, np.array([main[-1], ends[0]]), np.array([main[-1], ends[1]])]
    return VesselNetwork(
        nodes=np.array([main[0], main[-1], *ends]),
        vessel_nodes=np.array([[0, 1], [1, 2], [1, 3]]),
        kind=np.zeros(3, dtype=np.int64),
        tree=np.zeros(3, dtype=np.int64),
        offset=np.array([0, 60, 62, 64]),
        points=np.concatenate(lines),
        radius=np.full(64, 0.4),
    )


def off_axes(points, start, end):
    """Distance of each point from the nearest of the given segments."""
    return np.array(
        [min(segment_segment(p, p, a, b) for a, b in zip(start, end, strict=True)) for p in points]
    )


def check_flows(tree, options, tissue):
    flows = oracles.terminal_flows(tree, tree_radii(tree))
    assert np.ptp(flows) < 1e-9 * flows.mean()
    assert flows.sum() == pytest.approx(options.flow_ul_s(tissue.volume_mm3))


@pytest.mark.parametrize("seed", first_of(range(3)))
def test_a_bent_artery_stays_where_it_is(box, bent, seed):
    options = GrowthOptions(terminals=200, seed=seed, clearance_mm=0.02)
    trunk = trunk_of(bent)
    tree = grow_tree(box, options, trunk=bent)
    assert (tree.children[:, 0] < 0).sum() == 200
    given = tree.given
    assert given.sum() > len(trunk.parent)
    own = tree.distal[given]
    assert off_axes(own, trunk.proximal, trunk.distal).max() < 1e-9
    # Its bends and ends are all still there.
    for point in trunk.distal:
        assert np.abs(own - point).sum(axis=1).min() == 0.0
    assert off_axes(bent.points, trunk.proximal, trunk.distal).max() <= 0.25 * 0.4
    check_flows(tree, options, box)
    fresh = ~given
    inside = box.grid.capsule_inside(
        tree.proximal[fresh], tree.distal[fresh], tree_radii(tree)[fresh] - 1e-9, 0.02
    )
    assert inside.all()
    assert collisions(tree_to_network(tree), 0.02, options.clearance_ratio).count == 0
    assert "stay where they are" in tree.notes[0]
    assert "in place of 0.4 mm" in tree.notes[0]


def test_a_trunks_branches_are_narrower_where_early_ones_are_kept_so(box, bent):
    options = GrowthOptions(terminals=200, clearance_mm=0.02)
    widest = []
    for most in (np.inf, 0.35):
        trunk = replace(trunk_of(bent), widest_branch=most)
        (tree,) = grow_forest(box, [RootSpec(options, trunk=trunk)])
        assert (tree.children[:, 0] < 0).sum() == 200
        check_flows(tree, options, box)
        radius = tree_radii(tree)
        widest.append(float(radius[~tree.given].max() / radius[0]))
    assert widest[0] > 0.65
    assert widest[1] < 0.5


def test_an_artery_segmented_and_published_is_a_trunk():
    """One of X-CAVATE's arteries (SOURCES.md) in a box about it."""
    path = SHARED / "xcavate_network_14_vessels.txt"
    if not path.is_file():
        pytest.skip("no shared data beside the repository")
    numbers = [
        [float(x) for x in line.split(",")[:4]]
        for line in path.read_text().split("Vessel: 1,")[0].splitlines()
        if line and not line.startswith("Vessel")
    ]
    table = 10.0 * np.array(numbers)
    line, radius = table[:, :3], table[:, 3]
    network = VesselNetwork(
        line[[0, -1]],
        np.array([[0, 1]]),
        np.zeros(1, np.int64),
        np.zeros(1, np.int64),
        np.array([0, len(line)]),
        line,
        radius,
    )
    low, high = line.min(axis=0) - 4.0, line.max(axis=0) + 4.0
    shape = block(tuple(high - low))
    tissue = tissue_from_surface(shape.vertices + low, shape.faces)
    options = GrowthOptions(terminals=100)
    tree = grow_tree(tissue, options, trunk=network)
    assert (tree.children[:, 0] < 0).sum() == 100
    own = tree.distal[tree.given]
    trunk = trunk_of(network)
    assert off_axes(own, trunk.proximal, trunk.distal).max() < 1e-9
    check_flows(tree, options, tissue)


def network_of(ends):
    nodes = np.array([[0.0, 0, 0], [4, 0, 0], [8, 2, 0], [8, -2, 0], [8, 0, 2]])
    ends = np.array(ends)
    count = len(ends)
    zeros = np.zeros(count, dtype=np.int64)
    return VesselNetwork.from_segments(nodes, ends, np.full(count, 0.2), zeros, zeros)


@pytest.mark.parametrize(
    ("ends", "message"),
    [
        ([[0, 1], [1, 2], [1, 3], [1, 4]], r"parts into 3 branches at \(4, 0, 0\)"),
        ([[0, 1], [1, 2], [2, 3], [1, 3], [3, 4]], "isn't one tree"),
        ([[0, 1], [2, 1], [1, 3], [3, 4]], "2 inlets"),
    ],
)
def test_what_is_no_tree_is_refused(ends, message):
    with pytest.raises(GrowthError, match=message):
        trunk_of(network_of(ends))


def test_a_trunk_with_an_end_outside_the_tissue_is_refused_with_its_place(box):
    nodes = np.array([[1.0, 8, 6], [6.0, 8, 6], [15.0, 12, 6], [15.0, 4, -3]])
    trunk = VesselNetwork.from_segments(
        nodes,
        np.array([[0, 1], [1, 2], [1, 3]]),
        np.full(3, 0.4),
        np.zeros(3, int),
        np.zeros(3, int),
    )
    with pytest.raises(GrowthError, match=r"1 of the trunk's 2 ends .*\(15, 4, -3\) mm, 3 mm from"):
        grow_tree(box, GrowthOptions(terminals=20), trunk=trunk)


def test_each_stage_keeps_its_own_parameters(box):
    stages = (
        GrowthStage(40, length_to_radius=8.0, turn_angle_degrees=(0.0, 60.0), clearance_mm=0.3),
        GrowthStage(400, length_to_radius=1.0, clearance_mm=0.02),
    )
    options = GrowthOptions(terminals=400, stages=stages)
    first = grow_tree(box, GrowthOptions(terminals=40, length_to_radius=8.0, clearance_mm=0.3))
    tree = grow_tree(box, options)
    assert (tree.children[:, 0] < 0).sum() == 400
    assert collisions(tree_to_network(tree), 0.02, options.clearance_ratio).count == 0
    check_flows(tree, options, box)
    # Without the first stage's limits the tree is another one.
    plain = grow_tree(box, GrowthOptions(terminals=400, clearance_mm=0.02))
    assert len(first.distal) == 79
    assert plain.distal.tobytes() != tree.distal.tobytes()


@pytest.mark.parametrize(
    "strict",
    [{"clearance_mm": 0.3}, {"length_to_radius": 8.0}, {"turn_angle_degrees": (0.0, 60.0)}],
)
def test_a_stricter_stage_grows_on_what_a_milder_one_grew(box, strict):
    mild = {"clearance_mm": 0.02}
    stages = (GrowthStage(200, **mild), GrowthStage(400, **(mild | strict)))
    options = GrowthOptions(terminals=400, clearance_mm=0.02, stages=stages)
    tree = grow_tree(box, options, attempts=1)
    assert (tree.children[:, 0] < 0).sum() == 400
    assert collisions(tree_to_network(tree), 0.02, options.clearance_ratio).count == 0


def test_stages_must_ascend_to_all():
    with pytest.raises(GrowthError, match=r"stages reach \[50, 40\] of 40"):
        GrowthOptions(terminals=40, stages=(GrowthStage(50), GrowthStage(40)))
    with pytest.raises(GrowthError, match=r"stages reach \[50\] of 200"):
        GrowthOptions(terminals=200, stages=(GrowthStage(50),))
    with pytest.raises(GrowthError, match=r"flow_ratio is 0\.9"):
        GrowthOptions(terminals=50, stages=(GrowthStage(50, flow_ratio=0.9),))
