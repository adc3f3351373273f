"""Growth from a given artery, to given terminals, from a searched root; viscosity by diameter."""

from dataclasses import replace

import numpy as np
import pytest

from design.errors import DesignError, GrowthError
from design.tissue import block, tissue_from_surface
from design.vasculature import (
    GrowthOptions,
    GrowthStage,
    RootSpec,
    collisions,
    forest_to_network,
    grow_forest,
    grow_tree,
    supply_balance,
    tree_radii,
    tree_to_network,
)
from design.vasculature.growth.root_search import search_root
from design.vasculature.growth.tree import EFFORT, _mouth_reach
from design.vasculature.growth.trunk import trunk_of
from design.vasculature.viscosity import relative_viscosity
from tests.design.geometry.oracles import segment_segment
from tests.design.networks import network, polylines
from tests.design.tissue.kept import kept_tissue, shared
from tests.design.vasculature import oracles
from tests.slower import first_of


@pytest.fixture(scope="module")
def bent():
    """One artery that winds through the box, then parts in two."""
    t = np.linspace(0, 1, 60)
    main = np.column_stack([1 + 12 * t, 8 + 2 * np.sin(6 * t), 6 + 1.5 * np.cos(5 * t)])
    ends = main[-1] + np.array([[4.0, 3.0, 1.0], [4.0, -3.0, -1.0]])
    lines = [main, np.array([main[-1], ends[0]]), np.array([main[-1], ends[1]])]
    return polylines(lines, 0.4)


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
    path = shared("xcavate_network_14_vessels.txt")
    numbers = [
        [float(x) for x in line.split(",")[:4]]
        for line in path.read_text().split("Vessel: 1,")[0].splitlines()
        if line and not line.startswith("Vessel")
    ]
    table = 10.0 * np.array(numbers)
    line, radius = table[:, :3], table[:, 3]
    artery = polylines([line], radius)
    low, high = line.min(axis=0) - 4.0, line.max(axis=0) + 4.0
    shape = block(tuple(high - low))
    tissue = tissue_from_surface(shape.vertices + low, shape.faces)
    options = GrowthOptions(terminals=100)
    tree = grow_tree(tissue, options, trunk=artery)
    assert (tree.children[:, 0] < 0).sum() == 100
    own = tree.distal[tree.given]
    trunk = trunk_of(artery)
    assert off_axes(own, trunk.proximal, trunk.distal).max() < 1e-9
    check_flows(tree, options, tissue)


def network_of(ends):
    nodes = np.array([[0.0, 0, 0], [4, 0, 0], [8, 2, 0], [8, -2, 0], [8, 0, 2]])
    return network(nodes, ends, 0.2)


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


def test_stages_must_ascend_to_all_and_a_search_places_the_root_alone(slab):
    with pytest.raises(GrowthError, match=r"stages reach \[50, 40\] of 40"):
        GrowthOptions(terminals=40, stages=(GrowthStage(50), GrowthStage(40)))
    with pytest.raises(GrowthError, match=r"stages reach \[50\] of 200"):
        GrowthOptions(terminals=200, stages=(GrowthStage(50),))
    with pytest.raises(GrowthError, match=r"flow_ratio is 0\.9"):
        GrowthOptions(terminals=50, stages=(GrowthStage(50, flow_ratio=0.9),))
    with pytest.raises(GrowthError, match="either root_point_mm or root_candidates"):
        GrowthOptions(root_candidates=3, root_point_mm=(0.0, 0.0, 0.0))
    with pytest.raises(GrowthError, match="give each of several trees its"):
        grow_forest(slab, [GrowthOptions(terminals=5, root_candidates=3)])


# Given terminals: all reached, or named.


WELLS = np.array([(x, y, 6.0) for x in np.arange(2, 20, 2.5) for y in np.arange(2, 16, 2.5)])


def tips_of(tree):
    return tree.distal[tree.children[:, 0] < 0]


def in_order(points):
    return points[np.lexsort(points.T)]


@pytest.mark.parametrize("seed", first_of(range(4)))
@pytest.mark.parametrize("printed", [{}, {"smallest_radius_mm": 0.1}])
def test_every_well_of_a_plate_is_reached(box, seed, printed):
    options = GrowthOptions(terminal_points_mm=WELLS, seed=seed, clearance_mm=0.1, **printed)
    assert options.terminals == len(WELLS)
    tree = grow_tree(box, options)
    np.testing.assert_array_equal(in_order(tips_of(tree)), in_order(WELLS))
    assert collisions(tree_to_network(tree), 0.1, options.clearance_ratio).count == 0
    flows = oracles.terminal_flows(tree, tree_radii(tree))
    assert np.ptp(flows) < 1e-9 * flows.mean()


def test_given_flows_are_what_an_independent_solver_finds(box):
    rng = np.random.default_rng(0)
    points, asked = rng.uniform([1, 1, 1], [19, 15, 11], (300, 3)), rng.uniform(0.2, 3, 300)
    options = GrowthOptions(terminal_points_mm=points, terminal_flows=asked)
    tree = grow_tree(box, options)
    flow_at = {tuple(p): q for p, q in zip(points.tolist(), asked.tolist(), strict=True)}
    expected = np.array([flow_at[tuple(tip)] for tip in tips_of(tree).tolist()])
    found = oracles.terminal_flows(tree, tree_radii(tree))
    total = options.flow_ul_s(box.volume_mm3)
    np.testing.assert_allclose(found, expected * total / expected.sum(), rtol=1e-9)


@pytest.mark.parametrize(
    ("asked", "message"),
    [
        ({"terminal_points_mm": []}, "at least one point"),
        ({"terminal_points_mm": [[1, 2, 3], [1, 2, 3]]}, "names a point twice"),
        ({"terminal_points_mm": [[1, 2], [3, 4]]}, "three finite numbers"),
        ({"terminal_points_mm": [[1, 2, 3], [3, 4, 5]], "terminal_flows": [1.0]}, "flow above 0"),
        ({"terminal_points_mm": [[1, 2, 3], [3, 4, 5]], "terminal_flows": [1, 0]}, "flow above 0"),
    ],
)
def test_impossible_points_are_refused(asked, message):
    with pytest.raises(GrowthError, match=message):
        GrowthOptions(**asked)


@pytest.mark.slow
def test_forests_keep_given_flows(box):
    rng = np.random.default_rng(1)
    points, asked = rng.uniform([1, 1, 1], [19, 15, 11], (120, 3)), rng.uniform(0.2, 3, 120)
    options = GrowthOptions(terminal_points_mm=points, terminal_flows=asked, clearance_mm=0.02)
    flow_at = {tuple(p): q for p, q in zip(points.tolist(), asked.tolist(), strict=True)}
    total = options.flow_ul_s(box.volume_mm3)
    vein = GrowthOptions(terminals=120, clearance_mm=0.02, terminal_flow="demand")
    artery, drain = grow_forest(box, [options, vein])
    expected = np.array([flow_at[tuple(tip)] for tip in tips_of(artery).tolist()])
    found = oracles.terminal_flows(artery, tree_radii(artery))
    np.testing.assert_allclose(found, expected * total / expected.sum(), rtol=1e-9)
    tips = drain.children[:, 0] < 0
    assert supply_balance(box, drain.distal[tips], drain.flow_ul_s[tips]).spread < 0.05
    both = forest_to_network([artery, drain])
    assert collisions(both, 0.02, options.clearance_ratio).count == 0


def test_points_and_ends_outside_or_without_room_are_refused_with_their_place(box):
    points = [[5, 5, 5], [10, 8, 30], [9, 8, 6]]
    with pytest.raises(GrowthError, match=r"1 of 3 given.*outside.*number 1 at \(10, 8, 30\)"):
        grow_tree(box, GrowthOptions(terminal_points_mm=points))
    points = np.concatenate([WELLS, [[10.0, 8.0, 0.02]]])
    with pytest.raises(GrowthError, match=r"1 of 49 given.*can't be joined.*10, 8, 0\.02.*0\.02"):
        grow_tree(box, GrowthOptions(terminal_points_mm=points, smallest_radius_mm=0.1), attempts=1)
    nodes = np.array([[1.0, 8, 6], [6.0, 8, 6], [15.0, 12, 6], [15.0, 4, -3]])
    trunk = network(nodes, [(0, 1), (1, 2), (1, 3)], 0.4)
    with pytest.raises(GrowthError, match=r"1 of the trunk's 2 ends .*\(15, 4, -3\) mm, 3 mm from"):
        grow_tree(box, GrowthOptions(terminals=20), trunk=trunk)


# Root search: the cheapest root of those tried.


@pytest.fixture(scope="module")
def slab():
    return kept_tissue(block((30.0, 10.0, 6.0)))


def test_the_cheapest_candidate_wins_and_the_note_says_so(slab):
    options = GrowthOptions(terminals=150, root_candidates=10)
    tree = grow_tree(slab, options)
    found = search_root(
        slab,
        options,
        lambda t, o: grow_tree(t, o, attempts=EFFORT.probes),
        _mouth_reach(slab, options),
    )
    costs = []
    for point, way in zip(found.points, found.directions, strict=True):
        placed = replace(
            options, root_candidates=0, root_point_mm=tuple(point), root_direction=tuple(way)
        )
        try:
            costs.append(oracles.volume(grow_tree(slab, placed, attempts=EFFORT.probes)) / np.pi)
        except DesignError:
            costs.append(np.inf)
    np.testing.assert_allclose(found.cost, costs, rtol=1e-9)
    best = int(np.argmin(costs))
    np.testing.assert_array_equal(tree.proximal[0], found.points[best])
    assert "of 10 places tried" in tree.notes[0]
    assert "({:.4g}, {:.4g}, {:.4g})".format(*found.points[best]) in tree.notes[0]
    again = grow_tree(slab, options)
    assert again.distal.tobytes() == tree.distal.tobytes()
    assert again.notes == tree.notes


# Radii under diameter-dependent viscosity.


def pries(radius_mm, haematocrit):
    """Pries et al. 1994 written out, over plasma; radii as an array."""
    d = 2000.0 * np.asarray(radius_mm)
    squeezed = (d / (d - 1.1)) ** 2
    mu45 = 6 * np.exp(-0.085 * d) + 3.2 - 2.44 * np.exp(-0.06 * d**0.645)
    f = 1 / (1 + 10.0**-11 * d**12)
    c = (0.8 + np.exp(-0.075 * d)) * (f - 1) + f
    share = ((1 - haematocrit) ** c - 1) / ((1 - 0.45) ** c - 1)
    return (1 + (mu45 - 1) * share * squeezed) * squeezed


@pytest.mark.parametrize("haematocrit", [0.3, 0.45])
@pytest.mark.parametrize("smallest", [None, 0.006])
def test_terminal_flows_are_equal_by_an_independent_solver_with_that_law(haematocrit, smallest):
    options = GrowthOptions(
        terminals=300,
        viscosity_law="pries_1994",
        haematocrit=haematocrit,
        smallest_radius_mm=smallest,
        pressure_drop_pa=2e4,
    )
    small = kept_tissue(block((10.0, 8.0, 6.0)))
    tree = grow_tree(small, options)
    radius = tree_radii(tree)
    thick = pries(radius, haematocrit) / pries(1e6, haematocrit)
    assert thick.max() / thick.min() > 1.2
    flows = oracles.terminal_flows(tree, radius, thick)
    np.testing.assert_allclose(flows, options.flow_ul_s(small.volume_mm3) / 300, rtol=1e-6)
    assert collisions(tree_to_network(tree), 0.0, options.clearance_ratio).count == 0
    if smallest is not None:
        assert radius.min() == pytest.approx(smallest)


@pytest.mark.parametrize("haematocrit", [0.2, 0.45, 0.6])
def test_law_is_pries_over_its_value_in_wide_vessels(haematocrit):
    radii = np.geomspace(0.0025, 2.0, 40)
    expected = pries(radii, haematocrit) / pries(50.0, haematocrit)
    found = [relative_viscosity(r, haematocrit) for r in radii]
    np.testing.assert_allclose(found, expected, rtol=1e-4)
    assert relative_viscosity(0.5, -1.0) == 1.0
    assert relative_viscosity(1e-6, 0.45) == relative_viscosity(0.002, 0.45)
