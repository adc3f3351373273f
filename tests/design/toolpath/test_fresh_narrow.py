"""Walls and gaps that lines can't make are found, with their width and place."""

from __future__ import annotations

import pytest
from manifold3d import CrossSection, Manifold

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


def chambers(*spans: tuple[float, float]) -> FreshReport:
    """A block of 6 × 4 × 1.2 mm with chambers of 4 × 2 mm between heights."""
    body = Manifold.cube((6, 4, 1.2))
    for low, high in spans:
        body -= Manifold.cube((4, 2, high - low)).translate((1, 1, low))
    return plan_fresh(solid_from_manifold(body, "part"), LEVEL_OPTIONS).report


LEVEL_OPTIONS = FreshOptions(line_width_mm=0.15, layer_height_mm=0.1)


@pytest.mark.parametrize("height", [0.02, 0.05, 0.1, 0.14])
def test_a_membrane_between_layers_is_named_and_counts_as_unfilled(height: float) -> None:
    found = chambers((0.2, 0.6 - height / 2), (0.6 + height / 2, 1))
    assert found.low_gaps is None
    assert found.low_walls is not None
    assert found.low_walls.width_mm == pytest.approx(height, abs=1e-5)
    assert found.low_walls.area_mm2 == pytest.approx(8, rel=0.15)
    assert found.low_walls.at_mm[2] == pytest.approx(0.6, abs=1e-4)
    assert found.low_walls.least_mm == pytest.approx(0.1)
    assert found.part_ul == pytest.approx(28.8 - 8 * (0.8 - height), rel=1e-5)
    if height < 0.1:
        assert found.unfilled_fraction == pytest.approx(8 * height / found.part_ul, abs=0.003)
