"""Remedies named where a template's terminals don't fit."""

from __future__ import annotations

import pytest

from design.anatomy.grown import AnatomicTrees
from design.anatomy.tried_fewer import grow_or_advise
from design.anatomy.trunk_count import trunk_ends
from design.errors import (
    LEAST_TERMINALS,
    CrowdedError,
    GrowthError,
    WideTrunkError,
)
from design.units import PA_PER_MMHG
from design.vasculature.options import GrowthOptions

FITS = AnatomicTrees((), (), (), ())


def asked(terminals: int) -> GrowthOptions:
    return GrowthOptions(terminals=terminals, pressure_drop_pa=10 * PA_PER_MMHG)


@pytest.mark.parametrize(("most", "advised"), [(491, 491), (400, 343)])
def test_fewer_terminals_are_advised_only_where_they_were_grown(most: int, advised: int) -> None:
    """A heart's advice of 982 terminals led to 547, then to 305; none was ever grown."""

    def grow(options: GrowthOptions) -> AnatomicTrees:
        if options.terminals > most:
            raise CrowdedError(491, options.terminals)
        return FITS

    with pytest.raises(CrowdedError, match=f"ask for {advised} terminals, which were tried"):
        grow_or_advise(grow, asked(540), LEAST_TERMINALS)
    assert grow_or_advise(grow, asked(most), LEAST_TERMINALS) is FITS


@pytest.mark.parametrize(("fits", "advised"), [(15, 15), (50, 60), (400, 480)])
def test_a_higher_drop_is_advised_only_where_it_was_grown(fits: float, advised: float) -> None:
    """24 terminals with the default drop were told to take a higher one, without a figure."""

    def grow(options: GrowthOptions) -> AnatomicTrees:
        if options.pressure_drop_pa < fits * PA_PER_MMHG:
            raise WideTrunkError("too wide", drop_factor=1.5)
        return FITS

    with pytest.raises(WideTrunkError, match=f"too wide; give a pressure_drop_mmhg of {advised} "):
        grow_or_advise(grow, asked(24), LEAST_TERMINALS)


def test_too_few_terminals_and_too_few_trunk_ends_are_told_apart() -> None:
    with pytest.raises(GrowthError, match=r"^3 terminals are too few .*; ask for 24 at least$"):
        trunk_ends(600, 3, "heart")
    with pytest.raises(GrowthError, match=r"^5 trunk_ends are too few .*; ask for 6 at least$"):
        trunk_ends(5, 400, "heart")
