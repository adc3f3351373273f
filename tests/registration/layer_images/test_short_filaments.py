"""Short filaments, and thin ones that join thick ones, among older ones in a bath."""

import cv2
import numpy as np
import pytest

from registration.layer_images import ExpectedLines, LayerFindings, SeeingOptions, see_layer
from registration.layer_images.line_levels import line_levels
from registration.layer_images.values import FloatArray
from registration.layer_images.ways import lay_ways

PX_MM = 0.025
Piece = tuple[float, float, float, float, float, float]
"""Begin and end, width, darkness."""


class Flat:
    """A frame straight from above, which sees no depth."""

    def to_pixels(self, points_mm: FloatArray) -> FloatArray:
        """Pixels of places."""
        return np.asarray(points_mm)[:, :2] / PX_MM


def _seen(
    pieces: list[Piece],
    stroke: list[int],
    fresh: list[bool],
    bare: tuple[float, float] = (9.0, 9.0),
    rough: float = 0.03,
) -> LayerFindings:
    """Findings of filaments; ``bare`` of the last piece, mm along it."""
    rng = np.random.default_rng(4)
    y, x = np.mgrid[0:240, 0:280] * PX_MM
    texture = cv2.GaussianBlur(rng.normal(size=x.shape), (0, 0), 3.0)
    dark = np.zeros(x.shape)
    for number, (x0, y0, x1, y1, width, strength) in enumerate(pieces):
        way = np.array([x1 - x0, y1 - y0])
        length = float(np.linalg.norm(way))
        along = ((x - x0) * way[0] + (y - y0) * way[1]) / length
        across = ((x - x0) * way[1] - (y - y0) * way[0]) / length
        beyond = np.maximum(np.maximum(-along, along - length), 0.0)
        own = strength * np.sqrt(
            np.clip(1.0 - (across**2 + beyond**2) / (width / 2) ** 2, 0.0, 1.0)
        )
        if number == len(pieces) - 1:
            own[(along > bare[0]) & (along < bare[1])] = 0.0
        dark = np.maximum(dark, own)
    logs = np.log(140.0) + rough * texture / texture.std() - dark
    logs = logs[..., None] - dark[..., None] * np.array([0.3, 0.1, 0.0])
    light = cv2.GaussianBlur(np.exp(logs), (0, 0), 1.0) + rng.normal(0, 1.0, logs.shape)
    at = np.array(pieces)
    z = np.where(at[:, 5] > 0.5, 3.0, 2.0)
    lines = ExpectedLines(
        np.column_stack([at[:, :2], z]), np.column_stack([at[:, 2:4], z]), at[:, 4],
        np.arange(len(at)), np.array(stroke), np.array(fresh),
    )  # fmt: skip
    options = SeeingOptions(shift_mm=0.2, unseen_mm=0.6)
    return see_layer(np.clip(light, 0, 255).astype(np.uint8), Flat(), lines, options=options)


OLDER: list[Piece] = [(1.0, 1.0, 6.0, 1.3, 0.5, 0.8), (1.0, 5.0, 6.0, 4.8, 0.5, 0.7)]
SHORT: Piece = (2.5, 3.0, 3.4, 3.1, 0.6, 0.8)


def test_a_thin_filaments_level_is_not_learned_in_the_thick_one_that_it_joins() -> None:
    """Beside the joint's ink the rest of it was a gap."""
    ends = np.array([[0, 0, 0], [1.5, 0, 0], [5, 0, 0]], dtype=float)
    number, both = np.arange(2), np.ones(2, dtype=np.bool_)
    lines = ExpectedLines(ends[:2], ends[1:], np.array([0.3, 0.9]), number, 0 * number, both)
    ways = lay_ways(lines, 0.05)
    shown = np.where(ways.point[:, 0] < 1.0, 0.3, 1.2)
    bath = np.random.default_rng(1).normal(0, 0.02, 800)
    level = line_levels(shown, ways, np.ones(len(ways), dtype=np.bool_), bath)
    assert level[ways.point[:, 0] < 1.0] == pytest.approx(0.3, abs=0.03)
    assert level[ways.point[:, 0] > 1.5] == pytest.approx(1.2, abs=0.03)


def test_a_short_filament_that_plainly_shows_is_not_asked_about() -> None:
    """It has too few places to learn ink from, and the operator was asked whether it was there."""
    found = _seen([*OLDER, SHORT], [0, 1, 2], [False, False, True])
    assert found.gaps == found.unseen == found.bare == ()


@pytest.mark.parametrize("bare", [(-1.0, 9.0), (0.45, 9.0)], ids=["all of it", "half"])
def test_a_short_filament_that_lacks_ink_is_not_passed(bare: tuple[float, float]) -> None:
    found = _seen([*OLDER, SHORT], [0, 1, 2], [False, False, True], bare)
    assert found.gaps or found.unseen or found.bare


@pytest.mark.parametrize("bare_mm", [0.0, 0.3, 0.4])
def test_bath_between_a_filaments_end_and_the_older_one_it_joins_is_not_passed(
    bare_mm: float,
) -> None:
    rim = 1.15 + 0.25
    joining: Piece = (3.5, 3.4, 3.5, 1.15, 0.4, 0.8)
    end = 3.4 - rim
    found = _seen([*OLDER, joining], [0, 1, 2], [False, False, True], (end - bare_mm, end + 0.2))
    assert bool(found.gaps or found.unseen) == (bare_mm > 0)
