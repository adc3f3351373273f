"""Bare stretches are told by the ridges of older lines that still cross them."""

from __future__ import annotations

import numpy as np
import pytest

from kernels.arrays import BoolArray, FloatArray
from registration.inspection import ExpectedLines
from registration.inspection.over_ink.older_pattern import older_pattern_shows, only_crossed
from registration.inspection.pictures.working import Working, WorkingFrame
from registration.inspection.ways import Seen, Ways, lay_ways

WIDTH, SIZE, SCALE, EDGE = 0.3, 6.0, 40.0, 1.0
COUNT = round((SIZE + 2 * EDGE) * SCALE)
LINE, BEGIN, END = 9, 2.0, 5.0


class _View:
    def to_pixels(self, points_mm: FloatArray) -> FloatArray:
        return np.asarray((points_mm[:, :2] + EDGE) * SCALE)


def _filled(axis: int) -> Ways:
    """A layer filled with touching lines along an axis, each a stroke."""
    at = np.arange(0.5 * WIDTH, SIZE, WIDTH)
    flat = np.column_stack([at, np.zeros(len(at))])
    start, end = np.insert(flat, axis, 0.0, axis=1), np.insert(flat, axis, SIZE, axis=1)
    number = np.arange(len(at))
    full = np.full(len(at), WIDTH)
    return lay_ways(ExpectedLines(start, end, full, number, number, number >= 0), 0.05)


def _ridges(axis: int) -> FloatArray:
    at = np.mgrid[0:COUNT, 0:COUNT][1 - axis] / SCALE - EDGE
    return np.asarray(0.2 * np.abs(np.sin(np.pi * at / WIDTH)))


def _shows(own_axis: int, covered: float) -> tuple[Ways, BoolArray]:
    """What is told of a layer along y over one along x; ``covered`` of a stretch isn't bare."""
    y, x = np.mgrid[0:COUNT, 0:COUNT] / SCALE - EDGE
    rng = np.random.default_rng(5)
    before = _ridges(0) + rng.normal(0.0, 0.01, (COUNT, COUNT))
    fresh = _ridges(1) + 0.2 * before
    bare = (np.abs(x - (LINE + 0.5) * WIDTH) < 0.5 * WIDTH) & (y > BEGIN) & (y < END)
    now = np.where(bare, covered * fresh + (1.0 - covered) * (1.6 * before - 0.3), fresh)
    now += rng.normal(0.0, 0.01, (COUNT, COUNT))
    ways, frame = _filled(1), WorkingFrame(_View(), (0, 0), 1)
    image, earlier = (one[:, :, None].astype(np.float32) for one in (now, before))
    none = np.zeros((COUNT, COUNT), np.bool_)
    channels = np.concatenate([image, image - earlier], axis=2)
    work = Working(channels, none, none, (0, 0), 1, SCALE, True, earlier)
    crossed = only_crossed(ways, _filled(own_axis))
    return ways, older_pattern_shows(work, ways, Seen.of(ways, frame), crossed)


def _bare(ways: Ways) -> BoolArray:
    on = ways.stroke == LINE
    return np.asarray(on & (ways.along > BEGIN) & (ways.along < END))


def test_a_bare_stretch_beside_fresh_lines_is_told_by_the_ridges_that_cross_it() -> None:
    """Of a solid layer of clear ink 13 mm were bare, and "the picture changed as by fresh ink"."""
    ways, shows = _shows(0, 0.0)
    assert shows[_bare(ways)].mean() > 0.7
    near = (ways.stroke == LINE) & (ways.along > BEGIN - 0.7) & (ways.along < END + 0.7)
    assert not shows[~near].any()


@pytest.mark.parametrize(("own_axis", "covered"), [(0, 1.0), (1, 0.0)])
def test_covered_lines_and_such_along_older_ones_tell_nothing(own_axis, covered) -> None:
    assert not _shows(own_axis, covered)[1].any()
