"""Trunk branches in each other's way fork later, or are left away."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from design.anatomy.clear_trunks import clear_trunks
from design.anatomy.grown import AnatomicTrees, grow_or_advise
from design.anatomy.presets import trunk_ends
from design.anatomy.trunk_lines import TrunkLines
from design.errors import (
    LEAST_TERMINALS,
    CrowdedError,
    GrowthError,
    NoRoomError,
    WideTrunkError,
)
from design.tissue import Tissue, tissue_from_surface
from design.tissue.shapes import block
from design.units import PA_PER_MMHG
from design.vasculature.options import GrowthOptions

OPTIONS = GrowthOptions(terminals=100, clearance_mm=0.2)


@cache
def tissue() -> Tissue:
    shape = block((40.0, 40.0, 20.0))
    return tissue_from_surface(shape.vertices, shape.faces)


def forked(degrees: float, steps: int = 12) -> tuple[TrunkLines, np.ndarray]:
    """A stem along x in the block's middle that forks into two, a millimetre from node to node."""
    low, high = tissue().bounds
    middle = 0.5 * (low + high)
    begin = np.array([low[0] + 2.0, middle[1], middle[2]])
    half = np.radians(degrees / 2)
    points = [begin + [k, 0, 0] for k in range(6)]
    parent = [-1, *range(5)]
    for side in (1, -1):
        for k in range(1, steps + 1):
            parent.append(5 if k == 1 else len(points) - 1)
            points.append(points[5] + k * np.array([np.cos(half), side * np.sin(half), 0]))
    share = np.array([1.0] * 6 + [0.6] * steps + [0.4] * steps)
    lines = TrunkLines(np.array(points), np.array(parent), np.zeros(len(points), int), share)
    return lines, 0.8 * share ** (1 / OPTIONS.murray_exponent)


def cleared(lines: TrunkLines, radius: np.ndarray) -> tuple[TrunkLines, np.ndarray]:
    """As often as something is in the way."""
    while (found := clear_trunks(tissue(), lines, lines, radius, OPTIONS)) is not None:
        lines, radius = found
    return lines, radius


@pytest.mark.parametrize("degrees", [20.0, 30.0, 45.0])
def test_narrow_forks_move_on_and_no_end_is_lost(degrees):
    before, radius = forked(degrees)
    after, wide = cleared(before, radius)
    assert (after.child_count() == 0).sum() == 2
    assert (after.parent < np.arange(len(after.parent))).all()
    fork = int(np.flatnonzero(after.child_count() == 2)[0])
    assert after.points[fork, 0] > before.points[5, 0]
    # What was the larger branch carries both up to the fork.
    np.testing.assert_allclose(wide[fork], wide[0], rtol=1e-9)
    np.testing.assert_allclose(after.share[fork], 1.0)


def test_a_tree_that_keeps_no_trunk_is_an_error():
    """It said that the trunk has no segments, and to grow without."""
    one, radius = forked(100.0)
    away = one.points + [0, 0, 300.0]
    two = TrunkLines(
        np.concatenate([one.points, away]),
        np.concatenate([one.parent, np.where(one.parent >= 0, one.parent + len(away), -1)]),
        np.repeat([0, 1], len(away)),
        np.tile(one.share, 2) / 2,
    )
    with pytest.raises(GrowthError, match="trunks don't fit"):
        cleared(two, np.tile(radius, 2))


# Remedies named where a template's terminals don't fit.

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


def _crowds(options: GrowthOptions) -> CrowdedError:
    return CrowdedError(options.terminals // 2, options.terminals)


@pytest.mark.parametrize(
    ("change", "refuses", "error", "advice"),
    [
        ({}, lambda o: True, _crowds, r"^(?!.*ask for).*200 and 140 were tried"),
        (
            {},
            lambda o: o.pressure_drop_pa < 25 * PA_PER_MMHG,
            _crowds,
            "give a pressure_drop_mmhg of 40, which was tried",
        ),
        (
            {"smallest_radius_mm": 0.25},
            lambda o: (o.smallest_radius_mm or 0.0) > 0.21,
            lambda o: NoRoomError("too wide", drop_factor=2.0),
            "give a smallest_diameter_mm of 0.42 or less, which",
        ),
        (
            {"clearance_mm": 1.0},
            lambda o: o.clearance_mm > 0.25,
            lambda o: NoRoomError("no room", placed=10),
            "give a clearance_mm of 0.2 or less, which",
        ),
    ],
    ids=["nothing fits", "drop", "diameter", "clearance"],
)
def test_only_what_was_grown_is_advised(change, refuses, error, advice) -> None:
    def grow(options: GrowthOptions) -> AnatomicTrees:
        if refuses(options):
            raise error(options)
        return FITS

    with pytest.raises((CrowdedError, NoRoomError), match=advice):
        grow_or_advise(grow, replace(asked(400), **change), LEAST_TERMINALS)
