"""Clean lumens in FRESH layers: leads into material, hops over lumens, shrinkage compensation."""

from __future__ import annotations

import numpy as np
import pytest
import shapely
from manifold3d import CrossSection, Manifold

from design.errors import ToolpathError
from design.toolpath import MoveKind
from design.toolpath.fresh import Compensation, FreshOptions
from tests.design.toolpath.plans import fresh_toolpath
from tests.design.toolpath.shapes import as_solid, rounded_width

LUMEN_MM = 0.5


def drilled(height: float = 0.3, wall: float | None = None) -> Manifold:
    outer = (
        CrossSection.square((6, 6), center=True)
        if wall is None
        else CrossSection.circle(LUMEN_MM + wall, 96)
    )
    return (outer - CrossSection.circle(LUMEN_MM, 96)).extrude(height)


def written(path):
    here = path.kind == MoveKind.WRITE
    width = rounded_width(path.volume_ul[here] / path.lengths[here], path.layer_height_mm)
    lines = np.stack([path.start[here, :2], path.end[here, :2]], axis=1)
    return shapely.linestrings(lines), width


def nearest_ink(path) -> float:
    lines, width = written(path)
    return float((shapely.distance(lines, shapely.Point(0, 0)) - width / 2).min())


def test_the_plunger_primes_and_relieves_away_from_the_lumen():
    path = fresh_toolpath(as_solid(drilled()), FreshOptions(lead_mm=0.2))
    standing = np.isin(path.kind, (MoveKind.PRIME, MoveKind.RETRACT))
    away = np.hypot(*path.end[standing, :2].T) - LUMEN_MM
    near = away[away < 0.5]
    assert len(near) >= 8
    # On the lumen's wall 0.2 mm off it; on the second wall, which needs no lead, where that stands.
    assert near.min() > 0.2


def test_a_lead_never_leaves_a_thin_wall():
    path = fresh_toolpath(as_solid(drilled(wall=0.16)), FreshOptions(lead_mm=0.3))
    radius = np.hypot(*path.end[path.end[:, 2] < 0.3 + 1e-9, :2].T)
    assert radius.max() < LUMEN_MM + 0.16
    assert radius.min() > LUMEN_MM


def test_what_shrinks_is_written_larger():
    shrunk = Compensation(shrink_percent=(2.0, 1.0, 5.0))
    plain = fresh_toolpath(as_solid(drilled(1.2)), FreshOptions())
    larger = fresh_toolpath(as_solid(drilled(1.2)), FreshOptions(compensation=shrunk))
    spans = []
    for path in (plain, larger):
        here = path.end[path.kind == MoveKind.WRITE]
        spans.append([*(np.ptp(here[:, :2], axis=0) + 0.15), here[:, 2].max()])
    ratio = np.array(spans[1]) / np.array(spans[0])
    assert ratio[:2] == pytest.approx([1 / 0.98, 1 / 0.99], abs=1e-3)
    assert ratio[2] == pytest.approx(1 / 0.95, abs=0.06 / 1.2)


@pytest.mark.parametrize("radial", [-0.03, 0.04])
def test_what_closes_in_is_written_wider(radial):
    options = FreshOptions(compensation=Compensation(radial_mm=radial))
    path = fresh_toolpath(as_solid(drilled()), options)
    assert nearest_ink(path) == pytest.approx(LUMEN_MM + radial, abs=2e-3)


def test_impossible_compensation_is_refused():
    with pytest.raises(ToolpathError, match="shrink_percent is 40"):
        Compensation(shrink_percent=(0.0, 40.0, 0.0))
    with pytest.raises(ToolpathError, match="radial_mm is nan"):
        Compensation(radial_mm=float("nan"))
