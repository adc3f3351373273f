"""Trees grown region by region: exact, and the same whoever grows the regions."""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import fields, replace

import numpy as np
import pytest

from design.tissue import block
from design.vasculature import ClusterPool, GrowthOptions, grow_tree
from design.vasculature.growth import large_growth, region_growth
from tests.design.tissue.kept import kept_tissue
from tests.design.vasculature.test_grow import check

OPTIONS = GrowthOptions(terminals=1500)


@pytest.fixture(scope="module")
def tissue():
    return kept_tissue(block((20.0, 16.0, 12.0)))


@pytest.fixture
def small(monkeypatch):
    """Regions for trees that grow in a second."""
    monkeypatch.setattr(large_growth, "LARGE", 1000)
    monkeypatch.setattr(large_growth, "EARLY", 200)
    monkeypatch.setattr(large_growth, "REGION", 250)


def same(one, two):
    return all(
        np.array_equal(getattr(one, field.name), getattr(two, field.name)) for field in fields(one)
    )


def test_tree_grown_by_regions_is_exact_on_any_number_of_threads(small, tissue):
    with ThreadPoolExecutor(1) as pool:
        tree = grow_tree(tissue, OPTIONS, pool=pool)
    check(tree, tissue, OPTIONS)
    with ThreadPoolExecutor(5) as pool:
        assert same(tree, grow_tree(tissue, OPTIONS, pool=pool))


def test_what_a_region_falls_short_of_grows_elsewhere(small, tissue, monkeypatch):
    grow = region_growth.RegionGrowth.grow_to
    monkeypatch.setattr(
        region_growth.RegionGrowth,
        "grow_to",
        lambda self, goal: grow(self, goal if self.job.number else (2 * goal) // 3),
    )
    check(grow_tree(tissue, OPTIONS), tissue, OPTIONS)


@pytest.mark.slow
def test_two_dask_workers_grow_the_same_tree(tissue):
    from distributed import Client, LocalCluster

    options = replace(OPTIONS, terminals=large_growth.LARGE)
    with (
        LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None) as cluster,
        Client(cluster) as client,
    ):
        tree = grow_tree(tissue, options, pool=ClusterPool(client))
    assert same(tree, grow_tree(tissue, options))
