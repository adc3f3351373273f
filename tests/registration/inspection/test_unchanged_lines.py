"""Lines over older ink that are told as unchanged: shade by direction, shadows that go."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from kernels.arrays import BoolArray, FloatArray
from registration.inspection import ExpectedLines
from registration.inspection.over_ink.picture_change import (
    Change,
    Unwritten,
    change_along,
    lay_older,
)
from registration.inspection.pictures.working import Mask, Working, WorkingFrame, drawn_lines
from registration.inspection.ways import Seen, Ways, lay_ways

WIDTH, PITCH, SIZE, SCALE, EDGE = 0.4, 0.8, 8.0, 30.0, 2.4
COUNT = round((SIZE + 2 * EDGE) * SCALE)
MISSING = 2
"""Line across x that isn't written."""


class _View:
    def to_pixels(self, points_mm: FloatArray) -> FloatArray:
        return np.asarray((points_mm[:, :2] + EDGE) * SCALE)


def _grid() -> ExpectedLines:
    """Older lines along and across x, also around the fresh ones on each second of them."""
    at = np.arange(0.5 * PITCH, SIZE, PITCH)
    starts, ends, fresh = [], [], []
    for axis in (0, 1):
        for new in (False, True):
            own = at[::2] if new else np.concatenate([[-1.6, -0.8], at, [SIZE + 0.8, SIZE + 1.6]])
            flat = np.column_stack([own, np.full(len(own), 0.3 * new)])
            starts.append(np.insert(flat, axis, 0.0, axis=1))
            ends.append(np.insert(flat, axis, SIZE, axis=1))
            fresh += [new] * len(own)
    number = np.arange(len(fresh))
    return ExpectedLines(
        np.concatenate(starts), np.concatenate(ends), np.full(len(number), WIDTH), number, number,
        np.array(fresh),
    )  # fmt: skip


@dataclass(frozen=True)
class _Scene:
    lines: ExpectedLines
    ways: Ways
    ground: Mask
    difference: FloatArray

    @classmethod
    def of(cls, along: float, across: float, lacking: BoolArray) -> _Scene:
        """Ridges whose two sides differ by logarithms, on lines that run along or across x."""
        lines = _grid()
        rows = np.flatnonzero(lines.fresh)
        ends = np.stack([_View().to_pixels(lines.start), _View().to_pixels(lines.end)], axis=1)
        drawn = drawn_lines((COUNT, COUNT), ends[rows], np.full(len(rows), WIDTH * SCALE))
        image = np.random.default_rng(3).normal(0.0, 0.004, (COUNT, COUNT))
        for row in rows[~lacking]:
            is_along = lines.start[row, 1] == lines.end[row, 1]
            for side in (-1, 1):
                off = side * 0.25 * WIDTH * SCALE * np.array([not is_along, is_along])
                one = drawn_lines(
                    (COUNT, COUNT), ends[row : row + 1] + off, np.array([0.4 * WIDTH * SCALE])
                )
                image[one > 0] += side * (along if is_along else across)
        grown = cv2.dilate(drawn, np.ones((9, 9), np.uint8))
        ways = lay_ways(lines, 0.05)
        return cls(lines, ways, np.asarray(1 - grown, np.uint8), image)

    def changed(self) -> Change:
        image = np.repeat(self.difference[:, :, None], 2, axis=2).astype(np.float32)
        none = np.zeros((COUNT, COUNT), np.bool_)
        work = Working(image, none, none, (0, 0), 1, SCALE, True, image[:, :, 1:])
        frame = WorkingFrame(_View(), (0, 0), 1)
        all_ = np.ones(len(self.ways), np.bool_)
        bare = Unwritten(
            all_, self.ground, np.ones((COUNT, COUNT), np.uint8), all_,
            np.ones(len(self.ways), np.int64),
        )  # fmt: skip
        older = lay_older(self.lines, np.zeros(len(self.lines), np.bool_), self.ways)
        return change_along(work, frame, self.ways, Seen.of(self.ways, frame), older, bare)

    def along(self) -> BoolArray:
        return np.asarray(np.abs(self.ways.normal[:, 1]) > 0.5)


def _none_missing() -> BoolArray:
    return np.zeros(10, np.bool_)


def _one_missing() -> BoolArray:
    return np.asarray(np.arange(10) == MISSING)


def test_ridges_along_the_light_that_change_nothing_are_not_told_as_unchanged() -> None:
    """Of a wall on itself two sides showed 0.09, and the others nothing: a sound print paused."""
    assert not _Scene.of(0.15, 0.0, _none_missing()).changed().still.any()


def test_a_line_that_is_missing_among_those_of_its_direction_is_unchanged() -> None:
    scene = _Scene.of(0.15, 0.0, _one_missing())
    still = scene.changed().still
    own = scene.ways.stroke == np.unique(scene.ways.stroke)[MISSING]
    assert still[own].mean() > 0.7
    assert not still[~own].any()


def _without_shadow(scene: _Scene, radius_mm: float, depth: float) -> _Scene:
    """The same after a picture with a shadow that has gone."""
    y, x = (np.mgrid[0:COUNT, 0:COUNT] / SCALE - EDGE - 0.5 * SIZE) / radius_mm
    gone = -np.log(1.0 - depth / (1.0 + np.exp((np.hypot(x, y) - 1.0) / 0.05)))
    return _Scene(scene.lines, scene.ways, scene.ground, scene.difference + gone)


def test_what_lies_outside_a_shadow_in_the_picture_before_is_not_told_as_unchanged() -> None:
    scene = _without_shadow(_Scene.of(0.02, 0.02, _none_missing()), 3.4, 0.3)
    assert not scene.changed().still.any()


def test_a_shadow_that_went_is_not_taken_for_ink() -> None:
    scene = _without_shadow(_Scene.of(0.15, 0.15, _one_missing()), 1.5, 0.6)
    own = scene.ways.stroke == np.unique(scene.ways.stroke)[MISSING]
    change = scene.changed()
    near = np.abs(scene.ways.point[:, 0] - 0.5 * SIZE) < 2.0  # beyond it other fresh lines cross
    assert not change.came[own & near].any()
    assert change.came[~own].mean() > 0.5


def test_a_missing_line_beside_ground_that_changed_is_unchanged() -> None:
    """Of clear ink 27 mm were missing, and nobody asked: rims beside them lit the ground anew."""
    scene = _Scene.of(0.15, 0.0, _one_missing())
    own = scene.ways.stroke == np.unique(scene.ways.stroke)[MISSING]
    y, x = np.mgrid[0:COUNT, 0:COUNT] / SCALE - EDGE
    across = np.abs(y - scene.ways.point[own, 1].mean())
    beside = (across > 0.8 * WIDTH) & (across < 1.3 * WIDTH)
    lit = np.where(beside, 0.03 * np.sin(2.0 * np.pi * x / WIDTH), 0.0)
    still = _Scene(scene.lines, scene.ways, scene.ground, scene.difference + lit).changed().still
    assert still[own].mean() > 0.7
    assert not still[~own].any()
