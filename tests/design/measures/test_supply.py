"""Supply measures (distances, vessels per section, oxygen), against closed forms and oracles."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from design.errors import DesignError
from design.measures import MeasureOptions, OxygenModel, Supply, measure_network, measures_dict
from design.measures.supply import build_lumens, krogh_erlang, nearest_walls, sample_tissue
from design.network import VesselNetwork
from design.tissue import Tissue, block, cylinder
from tests.design.measures.oracles import random_tree, tree_network, wall_distances
from tests.design.tissue.kept import kept_tissue
from tests.slower import examples

RADIUS, LENGTH, LUMEN = 4.0, 20.0, 0.5


@pytest.fixture(scope="module")
def rod() -> Tissue:
    surface = cylinder(2.0 * RADIUS, LENGTH, sides=720)
    return kept_tissue(surface)


def straight(radius: float = LUMEN, over: float = 1.0) -> VesselNetwork:
    """A vessel along the rod's axis, reaching ``over`` beyond both its ends."""
    nodes = np.array([[0.0, 0.0, -over], [0.0, 0.0, LENGTH + over]])
    return VesselNetwork.from_segments(
        nodes, np.array([[0, 1]]), np.array([radius]), np.zeros(1), np.zeros(1)
    )


def supply(network: VesselNetwork, tissue: Tissue, **options: object) -> Supply:
    measured = measure_network(network, tissue, MeasureOptions(**options)).supply  # type: ignore[arg-type]
    assert measured is not None
    return measured


@pytest.mark.slow
def test_a_straight_vessel_in_a_rod_has_the_distances_of_its_annulus(rod: Tissue) -> None:
    found = supply(straight(), rod, samples=100_000)
    area = RADIUS**2 - LUMEN**2
    mean = 2.0 / 3.0 * (RADIUS**3 - LUMEN**3) / area - LUMEN
    p95 = np.sqrt(LUMEN**2 + 0.95 * area) - LUMEN
    assert found.distance_mean_mm == pytest.approx(mean, rel=5e-3)
    assert found.distance_p95_mm == pytest.approx(p95, rel=5e-3)
    assert found.distance_max_mm == pytest.approx(RADIUS - LUMEN, rel=5e-3)
    for limit, share in zip((0.02, 0.1, 0.15, 0.2), found.beyond, strict=True):
        exact = (RADIUS**2 - (LUMEN + limit) ** 2) / area
        assert share == pytest.approx(exact, abs=4.0 * np.sqrt(exact * (1 - exact) / 1e5) + 1e-4)
    assert found.lumen_fraction == pytest.approx(LUMEN**2 / RADIUS**2, abs=2e-3)


def test_sections_agree_with_planes_cut_at_random() -> None:
    surface = block((10.0, 10.0, 10.0))
    cube = kept_tissue(surface)
    random = np.random.default_rng(3)
    network = tree_network(*random_tree(random, 40), np.full(40, 0.05))
    found = supply(network, cube, samples=100)
    start, end, *_ = network.pieces()
    planes = np.linspace(0.0, 10.0, 4001)
    for axis in range(3):
        low = np.minimum(start[:, axis], end[:, axis])
        high = np.maximum(start[:, axis], end[:, axis])
        crossings = [int(((low < h) & (h < high)).sum()) for h in planes]
        assert found.sections_per_mm2[axis] == pytest.approx(np.mean(crossings) / 100, rel=1e-2)


@settings(deadline=None, max_examples=examples(25))
@given(seed=st.integers(0, 2**32), vessels=st.integers(1, 30))
def test_nearest_wall_is_that_of_the_nearest_of_all_spheres(seed: int, vessels: int) -> None:
    random = np.random.default_rng(seed)
    parents, nodes = random_tree(random, vessels)
    network = tree_network(parents, nodes, np.ones(vessels))
    network = replace(network, radius=random.uniform(0.01, 1.5, len(network.radius)))
    points = random.uniform(-3.0, 13.0, (50, 3))
    start, end, ra, rb, _ = network.pieces()
    distance, radius = nearest_walls(build_lumens(start, end, ra, rb), points)
    slow = wall_distances(network, points)
    assert np.all(distance <= slow + 1e-9)
    np.testing.assert_allclose(distance, slow, atol=2e-4)
    assert radius.min() >= network.radius.min() - 1e-12
    assert radius.max() <= network.radius.max() + 1e-12


def test_samples_are_uniform_and_repeatable(rod: Tissue) -> None:
    points = sample_tissue(rod, 20_000, 7)
    np.testing.assert_array_equal(points, sample_tissue(rod, 20_000, 7))
    assert rod.contains(points).all()
    np.testing.assert_allclose(points.mean(axis=0), [0, 0, LENGTH / 2], atol=0.15)
    assert np.hypot(*points[:, :2].T).mean() == pytest.approx(2.0 / 3.0 * RADIUS, rel=1e-2)


def test_printable_lumens_alone_are_those_at_least_as_wide(rod: Tissue) -> None:
    nodes = np.array([[0.0, 0, 1], [0, 0, 10], [2.0, 0, 15], [-2.0, 0, 15]])
    radius = np.array([0.5, 0.25, 0.2])
    network = VesselNetwork.from_segments(
        nodes, np.array([[0, 1], [1, 2], [1, 3]]), radius, np.zeros(3), np.zeros(3)
    )
    wide = VesselNetwork.from_segments(
        nodes[:3], np.array([[0, 1], [1, 2]]), radius[:2], np.zeros(2), np.zeros(2)
    )
    options = MeasureOptions(samples=2000, printable_diameter_mm=0.5)
    assert measure_network(network, rod, options).printable == supply(wide, rod, samples=2000)
    none = measure_network(network, rod, replace(options, printable_diameter_mm=1.1))
    assert none.printable is None


def test_oxygen_in_a_rod_is_kroghs(rod: Tissue) -> None:
    model = OxygenModel(cells_per_ml=1e5)
    found = supply(straight(over=0.0), rod, samples=100_000, oxygen=model).oxygen
    r = np.sqrt(np.linspace(LUMEN**2, RADIUS**2, 200_001))
    exact = krogh_erlang(r, np.full_like(r, LUMEN), np.full_like(r, RADIUS), model)
    assert exact.min() > 0.0
    assert found.anoxic == 0.0
    assert found.mean_millimolar == pytest.approx(exact.mean(), rel=2e-3)
    assert found.p5_millimolar == pytest.approx(np.percentile(exact, 5), rel=2e-3)
    assert found.least_millimolar == pytest.approx(exact[-1], rel=2e-3)


def test_krogh_erlang_solves_its_equation() -> None:
    model = OxygenModel()
    r = np.linspace(0.05, 0.3, 4001)
    c = krogh_erlang(r, np.full_like(r, 0.05), np.full_like(r, 0.3), model)
    flux = r * np.gradient(c, r)
    left = model.diffusivity_mm2_s * np.gradient(flux, r) / r
    assert c[0] == model.lumen_millimolar
    assert flux[-1] == pytest.approx(0.0, abs=1e-4)
    np.testing.assert_allclose(left[5:-5], model.uptake_millimolar_s, rtol=1e-3)


@pytest.mark.parametrize(
    "options", [{"samples": 0}, {"murray_exponent": 0.0}, {"printable_diameter_mm": -1.0}]
)
def test_impossible_options_are_refused(options: dict[str, float]) -> None:
    with pytest.raises(DesignError, match="measures"):
        MeasureOptions(**options)  # type: ignore[arg-type]


def test_the_dictionary_is_plain_json(rod: Tissue) -> None:
    options = MeasureOptions(samples=500, printable_diameter_mm=0.3)
    measured = measure_network(straight(), rod, options, flow=np.array([1.0]))
    table = json.loads(json.dumps(measures_dict(measured), allow_nan=False))
    assert table["supply"]["beyond"].keys() == {"20_um", "100_um", "150_um", "200_um"}
    assert table["printable"] == table["supply"]
    assert table["morphometry"]["artery"]["strahler"]["segments"] == [1]
    assert table["volume_mm3"] == pytest.approx(np.pi * LUMEN**2 * (LENGTH + 2))
    assert table["surface_mm2"] == pytest.approx(2 * np.pi * LUMEN * (LENGTH + 2))


def test_sections_count_the_vessels_that_cross_them(rod: Tissue) -> None:
    found = supply(straight(over=0.0), rod, samples=1000)
    area = rod.volume_mm3 / LENGTH
    np.testing.assert_allclose(found.sections_per_mm2, [0, 0, 1 / area], rtol=1e-9)
    assert found.vessels_per_mm2 == pytest.approx(0.5 / area)
