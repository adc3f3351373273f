"""Vessels of one look that the view shows over each other."""

import cv2
import numpy as np
import pytest

from kernels.arrays import FloatArray
from registration.inspection import ExpectedLines, LayerFindings, see_layer

PX_MM = 0.025
LENGTH = 8.0
WIDE = 0.6
DARK = 0.8
"""Logarithm in a filament's middle."""


class Aslant:
    """A far camera that looks from above, or leans along y; higher places then lie further up."""

    def __init__(self, tilt: float = 0.0) -> None:
        self.tilt = tilt

    def to_pixels(self, points_mm: FloatArray) -> FloatArray:
        """Pixels of places."""
        x, y, z = np.asarray(points_mm).T
        return np.column_stack([x, y * np.cos(self.tilt) + z * np.sin(self.tilt)]) / PX_MM


def _look(
    angle_deg: float,
    bare: dict[int, tuple[float, float]],
    dark: float = DARK,
    tilt: float = 0.0,
    aside: float = 0.0,
    heights: tuple[float, float] = (-2.5, -1.2),
) -> LayerFindings:
    """Findings of a lower filament, an upper one that crosses its middle, and two alone."""
    turn = np.deg2rad(angle_deg)
    ahead = np.array([[1, 0], [np.cos(turn), np.sin(turn)], [1, 0], [1, 0]])
    middle = np.array([[5, 5], [5, 5 + aside], [5, 2], [5, 8.0]])
    height = np.array([[*heights, -1.2, -2.5]]).T
    start, end = (np.hstack([middle + by * LENGTH * ahead, height]) for by in (-0.5, 0.5))
    frame, rng = Aslant(tilt), np.random.default_rng(4)
    y, x = np.mgrid[0:400, 0:400]
    logs = np.log(150.0) + 0.01 * cv2.GaussianBlur(rng.normal(size=x.shape), (0, 0), 2.0)
    pairs = zip(frame.to_pixels(start), frame.to_pixels(end), strict=True)
    for number, (begin, stop) in enumerate(pairs):
        size = float(np.linalg.norm(stop - begin))
        way = (stop - begin) / size
        along = (x - begin[0]) * way[0] + (y - begin[1]) * way[1]
        across = ((x - begin[0]) * way[1] - (y - begin[1]) * way[0]) * PX_MM
        low, high = (size / LENGTH * at for at in bare.get(number, (99.0, 99.0)))
        own = (along > 0) & (along < size) & ~((along > low) & (along < high))
        logs -= dark * own * np.sqrt(np.clip(1.0 - (2.0 * across / WIDE) ** 2, 0.0, 1.0))
    light = cv2.GaussianBlur(np.exp(logs), (0, 0), 1.0) + rng.normal(0, 0.7, logs.shape)
    count = np.arange(4)
    lines = ExpectedLines(start, end, np.full(4, WIDE), count, count, np.ones(4, dtype=np.bool_))
    return see_layer(np.clip(light, 0, 255).astype(np.uint8), frame, lines)


def _seen(found: LayerFindings, stroke: int, low: float, high: float) -> float:
    """Share of the stations there that are seen."""
    at = found.stations
    return float(at.seen[(at.stroke == stroke) & (at.along_mm > low) & (at.along_mm < high)].mean())


@pytest.mark.parametrize(("angle_deg", "gap_mm"), [(0, 3), (0, 8), (8, 3), (15, 2), (30, 1)])
def test_what_an_upper_filament_of_the_look_hides_is_not_seen(angle_deg, gap_mm):
    """It was marked as seen, with all of its ink."""
    low, high = (LENGTH - gap_mm) / 2, (LENGTH + gap_mm) / 2
    found = _look(angle_deg, {0: (low, high)})
    assert _seen(found, 0, low, high) == 0.0
    assert found.gaps == ()
    assert any(one.stroke == 0 and one.from_mm < 4 < one.to_mm for one in found.unseen)


def test_what_is_hidden_hangs_on_where_the_camera_stands() -> None:
    """Aslant by 30 degrees, the upper one shows 0.75 mm further aside than from above."""
    by = 1.3 * np.tan(np.deg2rad(30.0))
    hidden = _look(0, {0: (2.5, 5.5)}, tilt=np.deg2rad(30.0), aside=-by)
    assert _seen(hidden, 0, 2.5, 5.5) == 0.0
    open_to_it = _look(0, {0: (2.5, 5.5)}, tilt=np.deg2rad(30.0))
    assert [gap.stroke for gap in open_to_it.gaps] == [0]


@pytest.mark.parametrize("angle_deg", [0, 10])
def test_a_sound_lower_filament_has_no_gap_where_the_upper_one_has(angle_deg: float) -> None:
    """3.6 mm of it were to be written again."""
    found = _look(angle_deg, {1: (2.5, 5.5)}, dark=0.3)
    assert all(gap.stroke == 1 for gap in found.gaps)
    told = [*found.gaps, *found.unseen]
    assert sum(max(0.0, min(g.to_mm, 5.5) - max(g.from_mm, 2.5)) for g in told if g.stroke == 1) > 2


def test_where_translucent_inks_densities_add_both_are_seen() -> None:
    sound = _look(15, {}, dark=0.3)
    assert sound.unseen == ()
    assert _seen(sound, 0, 3, 5) > 0.7
    assert _seen(_look(15, {0: (3.0, 5.0)}, dark=0.3), 0, 3.2, 4.8) == 0.0
