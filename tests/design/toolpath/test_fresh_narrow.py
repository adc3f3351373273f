"""Walls and gaps that lines can't make are found, with their width and place."""

from __future__ import annotations

import pytest
from manifold3d import CrossSection

from design.solids import Solid, block_solid
from design.solids.snap import solid_from_manifold
from design.toolpath.fresh import FreshOptions, FreshReport, plan_fresh

OPTIONS = FreshOptions()


def report(section: CrossSection, options: FreshOptions = OPTIONS) -> FreshReport:
    return plan_fresh(solid_from_manifold(section.extrude(0.3), "part"), options).report


def square(low: tuple[float, float], high: tuple[float, float]) -> CrossSection:
    return CrossSection([[low, (high[0], low[1]), high, (low[0], high[1])]])


BODY = square((0, 0), (6, 4))


@pytest.mark.parametrize("width", [0.02, 0.05, 0.12])
def test_a_slit_is_told_with_its_width_and_place(width: float) -> None:
    found = report(BODY - square((2, 1), (2 + width, 3)))
    assert found.thin_walls is None
    assert found.narrow_gaps is not None
    assert found.narrow_gaps.width_mm == pytest.approx(width, rel=0.02)
    assert found.narrow_gaps.least_mm == OPTIONS.line_width_mm
    x, y, z = found.narrow_gaps.at_mm
    assert x == pytest.approx(2 + width / 2, abs=1e-3)
    assert 1 <= y <= 3
    assert 0 < z < 0.3
    assert found.narrow_gaps.layers == 1


def test_a_thin_wall_is_told_and_one_that_gets_a_line_isnt() -> None:
    least = OPTIONS.thinnest_wall_mm
    for width, missing in ((0.05, True), (0.95 * least, True), (1.1 * least, False)):
        found = report(BODY + square((6, 1), (9, 1 + width)))
        assert found.narrow_gaps is None
        assert (found.thin_walls is not None) == missing
        if found.thin_walls is not None:
            assert found.thin_walls.width_mm == pytest.approx(width, rel=0.02)
            assert found.thin_walls.least_mm == pytest.approx(least)
            assert f"{width:.3g} mm wide" in found.narrow_notes[0]
            assert f"{least:.3g} mm" in found.narrow_notes[0]


def test_what_gets_no_line_is_what_the_layers_lack() -> None:
    """The least that is named is the slicer's own."""
    for share, filled in ((0.95, False), (1.1, True)):
        width = share * OPTIONS.thinnest_wall_mm
        plan = plan_fresh(
            solid_from_manifold((BODY + square((6, 1), (9, 1 + width))).extrude(0.3), "part"),
            OPTIONS,
        )
        assert (plan.toolpath.end[:, 0].max() > 8) == filled


def test_holes_and_pins_are_narrow_all_round_and_corners_are_not() -> None:
    hole = report(BODY - CrossSection.circle(0.04, 24).translate((3, 2)))
    assert hole.narrow_gaps is not None
    assert hole.narrow_gaps.at_mm[:2] == pytest.approx((3, 2), abs=0.01)
    pin = report(BODY + CrossSection.circle(0.03, 24).translate((8, 2)))
    assert pin.thin_walls is not None
    triangle = CrossSection([[(0, 0), (6, 0), (3, 5)]])
    for sound in (BODY, triangle, BODY - triangle, BODY - CrossSection.circle(0.2, 40)):
        found = report(sound)
        assert (found.thin_walls, found.narrow_gaps) == (None, None)


def test_two_bodies_a_hair_apart_have_a_gap_between_them() -> None:
    both: list[Solid] = [block_solid((2, 2, 0.3)), block_solid((2, 2, 0.3), (2.05, 0, 0))]
    found = plan_fresh(both, OPTIONS).report.narrow_gaps
    assert found is not None
    assert found.width_mm == pytest.approx(0.05, abs=1e-3)
    touching = [block_solid((2, 2, 0.3)), block_solid((2, 2, 0.3), (2, 0, 0))]
    assert plan_fresh(touching, OPTIONS).report.narrow_gaps is None
