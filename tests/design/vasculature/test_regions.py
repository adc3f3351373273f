from concurrent.futures import ThreadPoolExecutor
from dataclasses import fields

import numpy as np
import pytest

from design.tissue import block
from design.vasculature import GrowthOptions, grow_tree
from design.vasculature.growth.regions import large_growth
from tests.design.vasculature.test_grow import check, tissue_of

OPTIONS = GrowthOptions(terminals=3000)


@pytest.fixture(scope="module")
def tissue():
    return tissue_of(block((20.0, 16.0, 12.0)))


@pytest.fixture
def small(monkeypatch):
    """Regions for trees that grow in a second."""
    monkeypatch.setattr(large_growth, "LARGE", 1000)
    monkeypatch.setattr(large_growth, "EARLY", 300)
    monkeypatch.setattr(large_growth, "REGION", 400)


def test_tree_grown_by_regions_is_exact(small, tissue):
    tree = grow_tree(tissue, OPTIONS)
    check(tree, tissue, OPTIONS)


def same(one, two):
    return all(
        np.array_equal(getattr(one, field.name), getattr(two, field.name)) for field in fields(one)
    )


def test_tree_is_the_same_on_any_number_of_threads_and_in_other_processes(small, tissue):
    with ThreadPoolExecutor(1) as pool:
        one = grow_tree(tissue, OPTIONS, pool=pool)
    with ThreadPoolExecutor(5) as pool:
        assert same(one, grow_tree(tissue, OPTIONS, pool=pool))
