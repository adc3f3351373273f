"""Adaptive layer heights: stair-step limit, floors met exactly, volume by height."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from manifold3d import Manifold

from design.toolpath import MoveKind
from design.toolpath.fresh import Adaptive, FreshLayers, FreshOptions
from design.toolpath.fresh.levels import adaptive_levels
from tests.design.toolpath.shapes import along_x, as_solid, block
from tests.slower import examples

FINE = Adaptive(0.02, 0.02, 0.0025)
OPTIONS = FreshOptions(adaptive=FINE, clear_mm=0.0015, least_move_mm=0.0875)


def wedge(degrees: float) -> Manifold:
    """A block 1 mm high with one side so far off the upright."""
    away = np.tan(np.radians(degrees))
    points = [(0, 0, 0), (3, 0, 0), (0, 2, 0), (3, 2, 0)]
    points += [(0, 0, 1), (3 + away, 0, 1), (0, 2, 1), (3 + away, 2, 1)]
    return Manifold.hull_points(np.array(points, dtype=float))


def foot() -> Manifold:
    """Upright for 0.6 mm, then 50° off the upright for 1 mm."""
    return block(3, 2, 0.6) + wedge(50.0).translate([0, 0, 0.6])


def area_at(z: float) -> float:
    return 2 * (3 + max(z - 0.6, 0.0) * np.tan(np.radians(50.0)))


@pytest.mark.parametrize("degrees", [20.0, 45.0, 60.0])
def test_a_slanted_wall_s_stair_is_no_deeper_than_asked(degrees: float) -> None:
    levels = adaptive_levels([as_solid(wedge(degrees))], 0.06, FINE)
    stair = np.diff(levels) * np.sin(np.radians(degrees))
    assert stair.max() < 0.02 + FINE.step_mm
    assert np.quantile(stair, 0.8) < 0.02 + 1e-6
    # And the layers are no thinner than that asks for, but for the last ones.
    assert np.median(stair) > 0.02 - 0.0026
    assert levels[[0, -1]] == pytest.approx([0.0, 1.0])


def test_a_layer_ends_at_each_floor() -> None:
    body = block(4, 4, 0.5) + block(2, 4, 0.7775)
    levels = adaptive_levels([as_solid(body)], 0.06, FINE)
    assert np.abs(levels - 0.5).min() < 1e-6
    assert levels[-1] == pytest.approx(0.7775)


@settings(max_examples=examples(40), deadline=None)
@given(
    height=st.floats(0.1, 2.0),
    radius=st.floats(0.15, 0.6),
    thinnest=st.sampled_from([0.01, 0.02, 0.03, 0.05]),
    stair=st.floats(0.005, 0.06),
)
def test_heights_stay_within_their_limits_and_fill_the_part(height, radius, thinnest, stair):
    body = block(3, 3, height) - along_x(1.5, height / 2, 2 * radius)
    if body.is_empty():
        return
    solid = as_solid(body)
    levels = adaptive_levels([solid], 0.06, Adaptive(thinnest, stair, 0.0025))
    heights = np.diff(levels)
    assert heights.min() > thinnest - 1e-9
    assert heights.max() < max(0.06, 2 * thinnest) + 1e-9
    assert levels[-1] - levels[0] == pytest.approx(np.ptp(solid.bounds[:, 2]), abs=0.00126)
    assert heights / 0.0025 == pytest.approx(np.rint(heights / 0.0025), abs=1e-6)


def test_each_layer_s_lines_hold_its_own_height() -> None:
    """Volume of a layer: its section's area times its height."""
    found = list(FreshLayers(as_solid(foot()), OPTIONS))
    assert len({path.layer_height_mm for path in found}) > 1
    for path in found[1:-1:5]:
        middle = path.end[path.kind == MoveKind.WRITE, 2].max() - path.layer_height_mm / 2
        wrote = path.kind == MoveKind.WRITE
        assert path.volume_ul[wrote].sum() == pytest.approx(
            area_at(middle) * path.layer_height_mm, rel=0.02
        )
        (height,) = path.heights_mm.values()
        assert height == path.layer_height_mm
