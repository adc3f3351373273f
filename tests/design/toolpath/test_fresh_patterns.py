"""Infill patterns: correct surface, requested density, inside the walls."""

from __future__ import annotations

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from manifold3d import CrossSection

from design.errors import ToolpathError
from design.toolpath.fresh import Filling, FreshOptions, plan_fresh
from design.toolpath.fresh.patterns import gyroid_lines
from tests.design.toolpath.shapes import as_solid
from tests.slower import examples

SIDE_MM = 8.0


def body(height: float = 1.2):
    square = CrossSection.square((SIDE_MM, SIDE_MM))
    return as_solid((square - CrossSection.circle(1.0, 64).translate((4, 4))).extrude(height))


@given(z=st.floats(0, 3))
@settings(max_examples=examples(60), deadline=None)
def test_gyroid_lines_lie_on_the_gyroid_and_none_is_missing(z):
    period = 1.5
    low, high = np.array([-1.0, 0.3]), np.array([2.0, 2.9])
    turn = 2 * np.pi / period

    def height(x, y):
        x, y, up = turn * x, turn * y, turn * z
        return np.sin(x) * np.cos(y) + np.sin(y) * np.cos(up) + np.sin(up) * np.cos(x)

    lines = gyroid_lines(low, high, z, period)
    for line in lines:
        assert np.abs(height(*line.T)).max() < 1e-9
    # Between two places of unlike sign there is a line.
    rng = np.random.default_rng(1)
    from_, to = (low + rng.random((60, 2)) * (high - low) for _ in range(2))
    drawn = shapely.multilinestrings([shapely.linestrings(line) for line in lines])
    here, there = height(*from_.T), height(*to.T)
    unlike = (here * there < 0) & (np.minimum(np.abs(here), np.abs(there)) > 0.1)
    ways = shapely.linestrings(np.stack([from_, to], axis=1)[unlike])
    assert shapely.intersects(drawn, ways).all()


@pytest.mark.parametrize("infill", ["lines", "concentric", "gyroid"])
@pytest.mark.parametrize("density", [0.15, 0.5])
def test_infill_is_as_dense_as_asked(infill, density):
    options = FreshOptions(filling=Filling(infill, density), walls=1)
    plan = plan_fresh(body(), options)
    section = SIDE_MM**2 - np.pi
    # The wall's own ink, and the rest at the density asked for.
    wall = 0.15 * (4 * (SIDE_MM - 0.15) + 2 * np.pi * 1.075)
    expected = (wall + density * (section - wall)) * 1.2
    assert plan.report.written_ul == pytest.approx(expected, rel=0.04)


def test_solid_concentric_infill_leaves_little_bare():
    report = plan_fresh(body(0.06), FreshOptions(filling=Filling("concentric"))).report
    assert report.unfilled_fraction < 0.02
    assert report.written_ul == pytest.approx(report.material_ul, rel=0.02)


def test_a_solid_gyroid_is_refused():
    with pytest.raises(ToolpathError, match=r"meet above 0\.7"):
        Filling("gyroid", 1.0)
