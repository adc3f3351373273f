"""Stretches that changed a picture near their middle alone, among others like them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from kernels.arrays import BoolArray, FloatArray
from registration.inspection import ExpectedLines
from registration.inspection.over_ink.picture_change import ACROSS, Change
from registration.inspection.over_ink.thin_change import ThinChange, thin_by_change
from registration.inspection.values import FloatImage
from registration.inspection.ways import Seen, Ways, lay_ways

WIDTH, PITCH, SIZE, SCALE, COUNT = 0.4, 0.8, 12.0, 20.0, 260
LINE = 2
INK = 0.2


class _View:
    def to_pixels(self, points_mm: FloatArray) -> FloatArray:
        return np.asarray((points_mm[:, :2] + 0.5) * SCALE)


def _ways() -> Ways:
    """Five lines side by side."""
    y, number = PITCH * np.arange(5), np.arange(5)
    start = np.column_stack([np.zeros(5), y, np.zeros(5)])
    lines = ExpectedLines(
        start, start + (SIZE, 0.0, 0.0), np.full(5, WIDTH), number, number, np.ones(5, np.bool_)
    )
    return lay_ways(lines, 0.05)


def _profiles(ways: Ways, thin: BoolArray) -> FloatImage:
    """Change by level: as wide as the line, or 0.35 of it; and noise."""
    half = np.where(thin, 0.2, 0.5)[:, None]
    level = np.where(np.abs(ACROSS) < half, INK, 0.0)[:, :, None].repeat(3, axis=2)
    return (level + np.random.default_rng(4).normal(0.0, 0.01, level.shape)).astype(np.float32)


def _change(profiles: FloatImage, limit: float = 0.002) -> Change:
    count = len(profiles)
    full, all_ = np.full(count, INK), np.ones(count, np.bool_)
    energy = (profiles.astype(np.float64) ** 2).mean(axis=(1, 2))
    return Change(
        energy,
        full,
        full,
        full,
        np.full(count, limit),
        np.zeros(count),
        all_,
        all_,
        None,
        25,
        profiles,
        None,
    )


def _told(change: Change) -> ThinChange:
    ways = _ways()
    return thin_by_change(
        change, ways, Seen.of(ways, _View()), np.ones((COUNT, COUNT), dtype=np.uint8)
    )


def _within(ways: Ways, begin: float = 4.0, end: float = 10.0) -> BoolArray:
    on = (ways.stroke == LINE) & (ways.along > begin) & (ways.along < end)
    return np.asarray(on)


def test_a_clog_in_part_is_told_where_it_lies() -> None:
    """25 to 50 % of the ink for 6 to 20 mm over older ink went on without a word."""
    ways = _ways()
    thin = _within(ways)
    told = _told(_change(_profiles(ways, thin)))
    assert told.thin[thin].mean() > 0.8
    assert told.thin[~thin].mean() < 0.05
    assert told.told.all()


def test_a_line_that_differs_on_its_whole_length_is_not_told_as_thin() -> None:
    """A wall's line lies otherwise to the light than the others like it, sound ink or not."""
    ways = _ways()
    assert not _told(_change(_profiles(ways, _within(ways, 0.0, SIZE)))).thin.any()


def test_a_stretch_that_changed_less_throughout_is_not_told_as_thin() -> None:
    """Shade, opaque ink and highlights change the middle of a line as they do its edges."""
    ways = _ways()
    profiles = _profiles(ways, np.zeros(len(ways), np.bool_))
    profiles[_within(ways)] *= 0.4
    assert not _told(_change(profiles)).thin.any()


def test_ink_that_changes_hardly_more_than_ground_does_tells_no_thin_ink() -> None:
    """Of clear ink with highlights that wander."""
    ways = _ways()
    profiles = _profiles(ways, _within(ways))
    assert _told(_change(profiles)).thin.any()
    weak = _told(_change(profiles, limit=0.02))
    assert not weak.thin.any()
    assert not weak.told.any()


def test_lines_that_have_no_like_tell_no_thin_ink() -> None:
    ways = _ways()
    change = _change(_profiles(ways, _within(ways)))
    alone = np.where(ways.stroke == LINE, change.rms, np.nan)
    told = _told(replace(change, rms=alone))
    assert not told.thin.any()
