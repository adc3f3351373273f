from pathlib import Path

import numpy as np
import pytest

from benchmarks.checkers.containment import surface_tree, to_surface, winding_numbers
from design.errors import GrowthError, TissueError
from design.geometry import build_triangle_tree, nearest_distances
from design.tissue import annulus, block, folded_cortex, load_tissue
from design.vasculature import (
    GrowthOptions,
    collisions,
    grow_tree,
    scaled_to_smallest_radius,
    tree_radii,
    tree_to_network,
)
from tests.design.tissue import surfaces
from tests.design.tissue.kept import KeptTissues, kept_tissue
from tests.design.vasculature import oracles
from tests.design.vasculature.bifurcation_places import (
    accuracies,
    cases_of,
    order_down,
    traversed_cost,
)
from tests.design.vasculature.oracles import volume
from tests.slower import first_of, first_rows

SHARED = Path(__file__).parents[4] / "shared" / "data"


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
    shape = surfaces.slit_block()
    return kept_tissue(shape, spacing_mm=0.3)


def slack_outside(tree, tissue, clearance_mm=0.0):
    """Least room between any lumen and the surface, by exact distances; the root apart."""
    exact = build_triangle_tree(tissue.surface.vertices, tissue.surface.faces)
    radius = tree_radii(tree)
    t = np.linspace(0, 1, 25)[None, :, None]
    axis = tree.proximal[1:, None] + t * (tree.distal - tree.proximal)[1:, None]
    away = nearest_distances(exact, axis.reshape(-1, 3)).reshape(axis.shape[:2]).min(axis=1)
    inside = tissue.contains(axis.reshape(-1, 3)).reshape(axis.shape[:2]).all(axis=1)
    return np.where(inside, away - radius[1:] - clearance_mm, -np.inf).min()


def outside_exactly(tree, tissue):
    """Segments whose lumen isn't in the tissue by an independent checker; the root apart."""
    corners = tissue.surface.vertices[tissue.surface.faces]
    exact = surface_tree(corners)
    start, end, radius = tree.proximal[1:], tree.distal[1:], tree_radii(tree)[1:] - 1e-9
    away = to_surface(start, end, radius, exact, corners[exact.order])
    return ((away < radius) | (winding_numbers(end, corners, exact) <= 0)).sum()


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
    path = SHARED / "gyrus_patch_fsaverage5.stl"
    if not path.is_file():
        pytest.skip("no shared data beside the repository")
    tissue = load_tissue(path, "mm")
    options = GrowthOptions(terminals=200, smallest_radius_mm=0.1, clearance_mm=0.1)
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
    assert outside_exactly(grow_tree(slit, options), slit) == 0


@pytest.mark.slow
def test_large_tree_stays_in_the_real_heart():
    path = SHARED / "biventricle_svv.stl"
    if not path.is_file():
        pytest.skip("no shared data beside the repository")
    tissue = load_tissue(path, "mm")
    tree = grow_tree(tissue, GrowthOptions(terminals=30_000))
    assert outside_exactly(tree, tissue) == 0


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
    check(
        grow_tree(cube, GrowthOptions(terminals=100, **asked)),
        cube,
        GrowthOptions(terminals=100, **asked),
    )


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


@pytest.fixture(scope="module")
def tissues_limits():
    shapes = {"block": lambda: block((20, 16, 12)), "annulus": lambda: annulus(30, 20, 6)}
    return KeptTissues(shapes)


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
def test_every_joint_keeps_the_limits(tissues_limits, name, limits, seed):
    options = GrowthOptions(terminals=120, seed=seed, clearance_mm=0.02, **limits)
    tree = grow_tree(tissues_limits[name], options)
    assert (tree.children[:, 0] < 0).sum() == 120
    check_limits(tree, limits)


def test_printable_tree_keeps_them_through_pruning_and_new_tips(tissues_limits):
    limits = {"branch_angle_degrees": (30.0, 120.0), "turn_angle_degrees": (0.0, 85.0)}
    options = GrowthOptions(terminals=100, smallest_radius_mm=0.08, clearance_mm=0.08, **limits)
    check_limits(grow_tree(tissues_limits["block"], options), limits)


@pytest.mark.slow
def test_limits_that_leave_no_tree_are_told(tissues_limits):
    options = GrowthOptions(terminals=60, branch_angle_degrees=(170.0, 175.0))
    with pytest.raises(GrowthError):
        grow_tree(tissues_limits["block"], options, attempts=1)


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
