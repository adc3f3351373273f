"""Remedies named where a template's terminals don't fit."""

from __future__ import annotations

import pytest

from design.anatomy.grown import AnatomicTrees
from design.anatomy.tried_fewer import grow_or_advise
from design.anatomy.trunk_count import trunk_ends
from design.errors import LEAST_TERMINALS, CrowdedError, GrowthError

FITS = AnatomicTrees((), (), (), ())


@pytest.mark.parametrize(("most", "advised"), [(491, 491), (400, 343)])
def test_fewer_terminals_are_advised_only_where_they_were_grown(most: int, advised: int) -> None:
    """A heart's advice of 982 terminals led to 547, then to 305; none was ever grown."""

    def grow(terminals: int) -> AnatomicTrees:
        if terminals > most:
            raise CrowdedError(491, terminals)
        return FITS

    with pytest.raises(CrowdedError, match=f"ask for {advised} terminals, which were tried"):
        grow_or_advise(grow, 540, LEAST_TERMINALS)
    assert grow_or_advise(grow, most, LEAST_TERMINALS) is FITS


def test_where_fewer_do_not_fit_either_they_are_not_advised() -> None:
    def grow(terminals: int) -> AnatomicTrees:
        raise CrowdedError(terminals // 2, terminals)

    with pytest.raises(CrowdedError) as refused:
        grow_or_advise(grow, 400, LEAST_TERMINALS)
    assert "ask for" not in str(refused.value)
    assert "200 and 140 were tried" in str(refused.value)


def test_fewer_than_a_template_takes_are_neither_tried_nor_advised() -> None:
    """A heart of 33 mm was told to ask for 13, and then that 13 are too few (2026-11-26)."""

    def grow(terminals: int) -> AnatomicTrees:
        assert terminals == 80
        raise CrowdedError(13, terminals)

    with pytest.raises(CrowdedError, match=f"takes {LEAST_TERMINALS} at least: take a larger"):
        grow_or_advise(grow, 80, LEAST_TERMINALS)


def test_a_smallest_diameter_is_named_as_it_leaves_no_pressure_drop_to_choose() -> None:
    assert "a smaller smallest_diameter_mm or, where that isn't given" in str(CrowdedError(30, 80))


def test_too_few_terminals_and_too_few_trunk_ends_are_told_apart() -> None:
    with pytest.raises(GrowthError, match=r"^3 terminals are too few .*; ask for 24 at least$"):
        trunk_ends(600, 3, "heart")
    with pytest.raises(GrowthError, match=r"^5 trunk_ends are too few .*; ask for 6 at least$"):
        trunk_ends(5, 400, "heart")
