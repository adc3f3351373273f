"""Trees grown in tissues: inside, without collisions, printable, region by region."""

import re
from concurrent.futures import ThreadPoolExecutor
from dataclasses import fields, replace

import manifold3d
import numpy as np
import pytest

from design.errors import GrowthError, NoRoomError, TissueError
from design.geometry import build_triangle_tree, nearest_distances
from design.measures import MeasureOptions, measure_network
from design.solids import read_solid
from design.tissue import annulus, block, folded_cortex, load_tissue, tissue_from_surface
from design.vasculature import (
    ClusterPool,
    GrowthOptions,
    collisions,
    grow_printable,
    grow_tree,
    scaled_to_smallest_radius,
    tree_radii,
    tree_to_network,
)
from design.vasculature.growth import region_split, regions
from design.vasculature.growth.tree import TreeGrowth
from tests.design.tissue import surfaces
from tests.design.tissue.kept import KeptTissues, kept_tissue, lumens_outside, shared
from tests.design.vasculature import oracles
from tests.design.vasculature.bifurcation_places import (
    accuracies,
    cases_of,
    order_down,
    traversed_cost,
)
from tests.design.vasculature.oracles import volume
from tests.slower import first_of, first_rows


@pytest.fixture(scope="module")
def tissues():
    return KeptTissues(
        {
            "hollow sphere": surfaces.hollow_sphere,
            "torus": surfaces.torus,
            "nested shells": surfaces.nested_shells,
            "thin box": surfaces.thin_box,
            "block": lambda: block((20.0, 16.0, 12.0)),
            "annulus": lambda: annulus(30.0, 20.0, 6.0),
            "folded cortex": folded_cortex,
        }
    )


@pytest.fixture(scope="module")
def slit():
    return kept_tissue(surfaces.slit_block(), spacing_mm=0.3)


def slack_outside(tree, tissue, clearance_mm=0.0):
    """Least room between any lumen and the surface, by exact distances; the root apart."""
    exact = build_triangle_tree(tissue.surface.vertices, tissue.surface.faces)
    radius = tree_radii(tree)
    t = np.linspace(0, 1, 25)[None, :, None]
    axis = tree.proximal[1:, None] + t * (tree.distal - tree.proximal)[1:, None]
    away = nearest_distances(exact, axis.reshape(-1, 3)).reshape(axis.shape[:2]).min(axis=1)
    inside = tissue.contains(axis.reshape(-1, 3)).reshape(axis.shape[:2]).all(axis=1)
    return np.where(inside, away - radius[1:] - clearance_mm, -np.inf).min()


def check(tree, tissue, options):
    terminals = (tree.children[:, 0] < 0).sum()
    assert terminals == options.terminals
    assert len(tree.parent) == 2 * terminals - 1
    flows = oracles.terminal_flows(tree, tree_radii(tree))
    assert np.ptp(flows) < 1e-9 * flows.mean()
    assert flows.sum() == pytest.approx(options.flow_ul_s(tissue.volume_mm3))
    found = collisions(tree_to_network(tree), options.clearance_mm, options.clearance_ratio)
    assert found.count == 0
    assert slack_outside(tree, tissue, options.clearance_mm) > -1e-9
    radius = tree_radii(tree)
    assert oracles.parting(tree, radius, options.clearance_mm, options.clearance_ratio) > -1e-9
    length = np.linalg.norm(tree.distal - tree.proximal, axis=1)
    assert (length >= options.length_to_radius * radius * (1 - 1e-9)).all()


SHAPES = (
    "nested shells",
    "thin box",
    "hollow sphere",
    "torus",
    "block",
    "annulus",
    "folded cortex",
)


@pytest.mark.parametrize("seed", first_of(range(10)))
@pytest.mark.parametrize("name", first_of(SHAPES, 2))
def test_tree_stays_in_tissue_without_collisions(tissues, name, seed):
    options = GrowthOptions(terminals=60, seed=seed, clearance_mm=0.02)
    check(grow_tree(tissues[name], options), tissues[name], options)


@pytest.mark.slow
def test_printable_tree_fits_the_real_gyrus():
    path = shared("gyrus_patch_fsaverage5.stl")
    tissue = load_tissue(path, "mm")
    options = GrowthOptions(
        terminals=200, smallest_radius_mm=0.1, clearance_mm=0.1, root_at_top=True
    )
    tree = grow_tree(tissue, options)
    check(tree, tissue, options)
    np.testing.assert_array_equal(tree.proximal[0], tissue.top_vertex()[0])


@pytest.mark.slow
@pytest.mark.parametrize("seed", [0, *(pytest.param(s, marks=pytest.mark.slow) for s in (1, 2))])
@pytest.mark.parametrize("smallest", [pytest.param(None, marks=pytest.mark.slow), 0.01])
def test_trees_stay_out_of_a_slit_thinner_than_a_cell(slit, seed, smallest):
    options = GrowthOptions(
        terminals=8000,
        seed=seed,
        smallest_radius_mm=smallest,
        root_point_mm=(9.5, 6.0, 12.0),
        root_direction=(0.0, 0.0, -1.0),
    )
    assert lumens_outside(grow_tree(slit, options), slit) == 0


@pytest.mark.slow
def test_large_tree_stays_in_the_real_heart():
    path = shared("biventricle_svv.stl")
    tissue = load_tissue(path, "mm")
    tree = grow_tree(tissue, GrowthOptions(terminals=30_000))
    assert lumens_outside(tree, tissue) == 0


@pytest.mark.slow
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_stem_is_as_long_as_asked_with_its_final_radius(tissues, seed):
    options = GrowthOptions(terminals=100, seed=seed, murray_exponent=2.3, clearance_mm=0.02)
    tree = grow_tree(tissues["folded cortex"], options)
    length = np.linalg.norm(tree.distal - tree.proximal, axis=1)
    assert (length >= options.length_to_radius * tree_radii(tree)).all()


@pytest.mark.slow
def test_refusal_says_what_was_reserved_and_fewer_terminals_do_fit():
    cube = kept_tissue(block((10.0, 10.0, 10.0)))
    asked = {"smallest_radius_mm": 0.1, "clearance_mm": 0.1}
    with pytest.raises(GrowthError, match=r"reserved because 3000 terminals need it"):
        grow_tree(cube, GrowthOptions(terminals=3000, terminal_spread=1.7, **asked))
    options = GrowthOptions(terminals=100, **asked)
    check(grow_tree(cube, options), cube, options)


def test_same_seed_gives_the_same_bytes_and_another_seed_another_tree(tissues):
    one, two, other = (
        grow_tree(tissues["torus"], GrowthOptions(terminals=100, seed=seed)) for seed in (3, 3, 4)
    )
    assert one.distal.tobytes() == two.distal.tobytes()
    assert one.ratio.tobytes() == two.ratio.tobytes()
    assert one.distal.tobytes() != other.distal.tobytes()


def test_scaling_keeps_flows_and_lets_the_pressure_drop_follow(tissues):
    tree = grow_tree(tissues["torus"], GrowthOptions(terminals=30))
    scaled = scaled_to_smallest_radius(tree, 0.2)
    factor = tree_radii(scaled) / tree_radii(tree)
    np.testing.assert_allclose(factor, factor[0], rtol=1e-12)
    assert tree_radii(scaled).min() == pytest.approx(0.2)
    assert scaled.pressure_drop_pa == pytest.approx(tree.pressure_drop_pa / factor[0] ** 4)
    flows = oracles.terminal_flows(scaled, tree_radii(scaled))
    np.testing.assert_allclose(flows, tree.terminal_flow_ul_s, rtol=1e-11)
    with pytest.raises(GrowthError, match="isn't above 0"):
        scaled_to_smallest_radius(tree, 0.0)


def test_root_is_placed_where_the_user_says(tissues):
    options = GrowthOptions(
        terminals=20, root_point_mm=(10.0, 8.0, 0.0), root_direction=(0.0, 0.2, 1.0)
    )
    tree = grow_tree(tissues["block"], options)
    np.testing.assert_allclose(tree.proximal[0], [10, 8, 0])
    along = tree.distal[0] - tree.proximal[0]
    np.testing.assert_allclose(
        along / np.linalg.norm(along), np.array([0, 0.2, 1]) / np.sqrt(1.04), atol=1e-12
    )
    inward = GrowthOptions(terminals=20, root_point_mm=(10.0, 8.0, 0.0))
    along = grow_tree(tissues["block"], inward).distal[0] - [10, 8, 0]
    assert along[2] > 0.99 * np.linalg.norm(along)


@pytest.mark.parametrize(
    "root",
    [
        {"root_point_mm": (10.0, 8.0, -9.0), "root_direction": (0.0, 0.0, 1.0)},
        {"root_point_mm": (10.0, 8.0, 0.0), "root_direction": (0.0, 0.0, -1.0)},
    ],
)
def test_root_outside_the_tissue_is_refused(tissues, root):
    with pytest.raises(GrowthError, match=r"root at .*(outside|never enters)"):
        grow_tree(tissues["block"], GrowthOptions(terminals=20, **root))


def test_tissue_too_thin_for_a_vessel_is_refused():
    tissue = kept_tissue(block((20.0, 20.0, 0.4)))
    with pytest.raises(TissueError, match=r"tissue is too thin .* 0\.2 mm deep at most"):
        grow_tree(tissue, GrowthOptions(terminals=20, smallest_radius_mm=0.15))


@pytest.mark.parametrize(
    ("name", "value"),
    [("terminals", 0), ("murray_exponent", 4.0), ("viscosity_pa_s", 0.0), ("clearance_mm", -1.0)],
)
def test_impossible_options_are_refused(name, value):
    with pytest.raises(GrowthError, match=rf"{name} is .*; give a value from"):
        GrowthOptions(**{name: value})


def test_one_terminal_ends_in_the_middle_of_what_it_supplies(tissues):
    tree = grow_tree(tissues["block"], GrowthOptions(terminals=1))
    middle = tissues["block"].bounds.mean(axis=0)
    assert np.linalg.norm(tree.distal[0] - middle) < 1.0
    # A direction that is given is kept; where a hole is in the way, the vessel ends before it.
    kept = grow_tree(
        tissues["block"],
        GrowthOptions(terminals=1, root_point_mm=(10, 8, 12), root_direction=(1, 0, -1)),
    )
    np.testing.assert_allclose(kept.distal[0] - kept.proximal[0], [3, 0, -3], atol=0.3)
    ring = grow_tree(tissues["torus"], GrowthOptions(terminals=1))
    part = np.linspace(0.1, 1.0, 50)[:, None]
    way = ring.proximal[0] + part * (ring.distal[0] - ring.proximal[0])
    assert tissues["torus"].contains(way).all()


# Accuracy of the chosen bifurcation by tree depth, as in the paper's figure 2C.


def grown(terminals):
    return grow_tree(kept_tissue(block((10.0, 10.0, 10.0))), GrowthOptions(terminals=terminals))


@pytest.fixture(scope="module")
def measured():
    tree = grown(1500)
    cases, depth = cases_of(tree, 20)
    return accuracies(tree, cases), depth


@pytest.mark.slow
@pytest.mark.parametrize(
    ("low", "high", "median"), first_rows([(1, 6, 60), (6, 12, 90), (12, 99, 95)])
)
def test_chosen_bifurcation_gains_most_of_what_a_fine_search_does(measured, low, high, median):
    accuracy, depth = measured
    there = accuracy[(depth >= low) & (depth < high)]
    assert len(there) > 20
    assert accuracy.max() <= 100 + 1e-3
    assert np.median(there) >= median


# Limits on branching angles and flow split, in finished trees.

LIMITS = (
    {"branch_angle_degrees": (45.0, 90.0)},
    {"turn_angle_degrees": (0.0, 60.0)},
    {"turn_angle_degrees": (10.0, 90.0)},
    {"flow_ratio": 0.2},
    {"branch_angle_degrees": (30.0, 140.0), "turn_angle_degrees": (0.0, 80.0), "flow_ratio": 0.05},
)


def check_limits(tree, limits):
    branch, turn, ratio = oracles.joints(tree)
    low, high = limits.get("branch_angle_degrees", (0, 180))
    assert branch.min() >= low - 1e-4
    assert branch.max() <= high + 1e-4
    low, high = limits.get("turn_angle_degrees", (0, 180))
    assert turn.min() >= low - 1e-4
    assert turn.max() <= high + 1e-4
    assert ratio.min() >= limits.get("flow_ratio", 0) - 1e-9


@pytest.mark.parametrize("name", ["block", "annulus"])
@pytest.mark.parametrize("limits", LIMITS)
@pytest.mark.parametrize("seed", first_of(range(3)))
def test_every_joint_keeps_the_limits(tissues, name, limits, seed):
    options = GrowthOptions(terminals=120, seed=seed, clearance_mm=0.02, **limits)
    tree = grow_tree(tissues[name], options)
    assert (tree.children[:, 0] < 0).sum() == 120
    check_limits(tree, limits)


def test_printable_tree_keeps_them_through_pruning_and_new_tips(tissues):
    limits = {"branch_angle_degrees": (30.0, 120.0), "turn_angle_degrees": (0.0, 85.0)}
    options = GrowthOptions(terminals=100, smallest_radius_mm=0.08, clearance_mm=0.08, **limits)
    check_limits(grow_tree(tissues["block"], options), limits)


@pytest.mark.slow
def test_limits_that_leave_no_tree_are_told(tissues):
    # Of two branches 170 degrees apart one turns by 85 degrees at least.
    apart, turn = (170.0, 175.0), (0.0, 30.0)
    options = GrowthOptions(terminals=60, branch_angle_degrees=apart, turn_angle_degrees=turn)
    with pytest.raises(GrowthError):
        grow_tree(tissues["block"], options, attempts=1)


@pytest.mark.parametrize("name", ["branch_angle_degrees", "turn_angle_degrees"])
@pytest.mark.parametrize("value", [(90.0, 30.0), (-5.0, 30.0), (0.0, 190.0), (0.0,)])
def test_impossible_angles_are_refused(name, value):
    with pytest.raises(GrowthError, match=f"{name} is .*least and a greatest angle"):
        GrowthOptions(**{name: value})


def test_cost_by_traversals_is_the_volume():
    tree = grown(60)
    length = np.linalg.norm(tree.distal - tree.proximal, axis=1)
    cost = traversed_cost(order_down(tree.children, len(length)), tree.children, length, 3.0)
    unit = 8 * tree.viscosity_pa_s / np.pi * tree.terminal_flow_ul_s / tree.pressure_drop_pa
    assert np.pi * unit**0.5 * cost == pytest.approx(volume(tree), rel=1e-12)


# Largest printable trees: limits of lumen and wall kept.


@pytest.fixture(scope="module")
def slab():
    return kept_tissue(folded_cortex())


@pytest.fixture(scope="module")
def brick():
    return kept_tissue(block((6.0, 6.0, 4.0)))


@pytest.mark.slow
def test_says_how_far_it_grew(brick):
    options = GrowthOptions(
        terminals=30,
        smallest_radius_mm=0.2,
        clearance_mm=0.3,
        root_point_mm=tuple(brick.bounds.mean(axis=0) + [0.0, 0.0, 2.0]),
        root_direction=(0.0, 0.0, -1.0),
    )
    done = grow_printable(brick, options)
    assert 1 <= done.reached < 30
    assert f"grew {done.reached} of 30 terminals" in done.note
    check(done.tree, brick, done.options)
    assert tree_radii(done.tree).min() == pytest.approx(0.2)
    with pytest.raises(GrowthError):
        grow_printable(brick, GrowthOptions(terminals=5))


@pytest.mark.slow
def test_takes_a_deep_root_where_the_default_one_is_too_shallow():
    """Both ventricles, scaled to 60 mm: at the highest vertex the wall is too thin for a trunk."""
    path = shared("biventricle_svv.stl")
    mesh = read_solid(path, unit="mm")
    vertices = mesh.vertices * (60.0 / np.ptp(mesh.vertices, axis=0).max())
    tissue = tissue_from_surface(vertices, mesh.faces)
    options = GrowthOptions(terminals=300, smallest_radius_mm=0.2, clearance_mm=0.3)
    done = grow_printable(tissue, options)
    assert done.reached == 300
    assert done.options.root_point_mm is not None
    check(done.tree, tissue, done.options)


def test_a_printable_tree_reaches_the_whole_slab(slab):
    """Wide vessels reach what is far only if nearer places are held back until they have."""
    options = GrowthOptions(terminals=200, smallest_radius_mm=0.1, clearance_mm=0.1)
    network = tree_to_network(grow_printable(slab, options).tree)
    reach = measure_network(network, slab, MeasureOptions(seed=3))
    assert reach.supply.distance_p95_mm < 2.5


def test_a_tree_stuck_in_a_lobe_gives_way_to_one_from_a_deep_root():
    """Test a block with a ball on top, whose neck is too narrow for any vessel."""
    body = manifold3d.Manifold.cube((20.0, 20.0, 10.0))
    neck = manifold3d.Manifold.cylinder(2.5, 0.2, 0.2, 24).translate((5.0, 5.0, 9.5))
    ball = manifold3d.Manifold.sphere(3.0, 24).translate((5.0, 5.0, 14.0))
    mesh = (body + neck + ball).to_mesh()
    tissue = tissue_from_surface(np.asarray(mesh.vert_properties[:, :3], float), mesh.tri_verts)
    options = GrowthOptions(
        terminals=60, smallest_radius_mm=0.15, clearance_mm=0.1, root_at_top=True
    )
    tree = grow_tree(tissue, options, attempts=1)
    assert re.match(r"from a root at the highest point only \d terminals fit, so", tree.notes[0])
    assert tree.proximal[0, 2] <= 10.0
    check(tree, tissue, options)
    given = replace(options, root_at_top=False, root_point_mm=tuple(tissue.top_vertex()[0]))
    with pytest.raises(NoRoomError, match=r"only \d of 60 terminals"):
        grow_tree(tissue, given, attempts=1)


# Trees grown region by region: exact, and the same whoever grows the regions.


OPTIONS = GrowthOptions(terminals=1500)


@pytest.fixture
def small(monkeypatch):
    """Regions for trees that grow in a second."""
    small = region_split.REGIONS._replace(
        from_terminals=1000, early_terminals=200, region_terminals=250
    )
    for module in (regions, region_split):
        monkeypatch.setattr(module, "REGIONS", small)


def same(one, two):
    return all(
        np.array_equal(getattr(one, field.name), getattr(two, field.name)) for field in fields(one)
    )


def test_tree_grown_by_regions_is_exact_on_any_number_of_threads(small, box):
    with ThreadPoolExecutor(1) as pool:
        tree = grow_tree(box, OPTIONS, pool=pool)
    check(tree, box, OPTIONS)
    with ThreadPoolExecutor(5) as pool:
        assert same(tree, grow_tree(box, OPTIONS, pool=pool))


def test_what_a_region_falls_short_of_grows_elsewhere(small, box, monkeypatch):
    grow = TreeGrowth.grow_to
    monkeypatch.setattr(
        TreeGrowth,
        "grow_to",
        lambda self, goal: grow(
            self, goal if self.region is None or self.region.number else (2 * goal) // 3
        ),
    )
    check(grow_tree(box, OPTIONS), box, OPTIONS)


@pytest.mark.slow
def test_two_dask_workers_grow_the_same_tree(box):
    from distributed import Client, LocalCluster

    options = replace(OPTIONS, terminals=region_split.REGIONS.from_terminals)
    with (
        LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None) as cluster,
        Client(cluster) as client,
    ):
        tree = grow_tree(box, options, pool=ClusterPool(client))
    assert same(tree, grow_tree(box, options))
