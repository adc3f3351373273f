"""Ends of gaps by a profiler's heights, and how sure they are."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.checkers.profiler_painter import Kind, profiled
from benchmarks.observe_laser import expected, planted
from registration.files.readers.heights import HeightMap
from registration.inspection import surface_of
from registration.inspection.gaps.height_ends import HeightsAlong, Section
from registration.inspection.pictures.working import prepare
from registration.inspection.values import Gap
from registration.inspection.ways import Seen, lay_ways


@pytest.mark.parametrize("kind", ["plate", "lattice", "solid"])
def test_ends_lie_within_their_uncertainty(kind: Kind) -> None:
    for seed in range(300_000, 300_004):
        found, stroke, (_, begin, end) = planted(seed, kind, 0.5)
        (gap,) = [one for one in found.gaps if one.stroke == stroke]
        assert max(abs(gap.from_mm - begin), abs(gap.to_mm - end)) < 2.0 * gap.u_mm
        assert abs(gap.length_mm - 0.5) < 3.0 * gap.u_length_mm
        assert gap.u_tip_mm < 0.12


def test_a_gap_reaches_over_what_was_not_told_up_to_the_ink() -> None:
    """Beside turns and rims a part of a bare stretch wasn't told, and its ends were 1 mm off."""
    begin, end = 1.5, 4.0
    map_ = profiled(2, "solid", ((4, begin, end),))
    lines, thick = expected(map_), map_.thickness
    at = HeightMap(map_.heights, (map_.px, map_.px))
    surface = surface_of(at, map_.to_map, map_.middle_z, thick, lines)
    ways = lay_ways(lines, 0.05)
    work, frame = prepare(surface.picture, surface.frame, ways, 0.2, surface.hidden)
    assert work.height is not None
    ends = HeightsAlong(
        work.height / np.float32(thick), work.hidden, ways, Seen.of(ways, frame),
        Section.of_widths(np.full(3, np.nan)), thick, 1.0 / work.px_per_mm,
    )  # fmt: skip
    stroke = int(np.flatnonzero(map_.layer == map_.layer.max())[4])
    bare = (ways.stroke == stroke) & (ways.along > begin) & (ways.along < end)
    part = Gap(stroke, 2.7, 3.4, (0.0, 0.0), (1.0, 0.0), 0.1, 1e-9)
    (gap,) = ends.measured([part], ~bare, np.zeros(len(ways), np.bool_))
    assert (gap.from_mm, gap.to_mm) == pytest.approx((begin, end), abs=0.1)
    other = replace(part, from_mm=3.6, to_mm=3.9)
    (both,) = ends.measured([part, other], ~bare, np.zeros(len(ways), np.bool_))
    assert (both.from_mm, both.to_mm) == pytest.approx((begin, end), abs=0.1)
