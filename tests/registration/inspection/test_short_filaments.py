"""Short filaments, and thin ones that join thick ones, among older ones in a bath."""

import cv2
import numpy as np
import pytest

from kernels.arrays import FloatArray
from registration.inspection import ExpectedLines, LayerFindings, SeeingOptions, see_layer

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
    unseen_mm: float = 0.6,
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
    options = SeeingOptions(shift_mm=0.2, unseen_mm=unseen_mm)
    return see_layer(np.clip(light, 0, 255).astype(np.uint8), Flat(), lines, options=options)


OLDER: list[Piece] = [(1.0, 1.0, 6.0, 1.3, 0.5, 0.8), (1.0, 5.0, 6.0, 4.8, 0.5, 0.7)]
SHORT: Piece = (2.5, 3.0, 3.4, 3.1, 0.6, 0.8)


def test_a_short_filament_that_plainly_shows_is_not_asked_about() -> None:
    """It has too few places to learn ink from, and the operator was asked whether it was there."""
    found = _seen([*OLDER, SHORT], [0, 1, 2], [False, False, True])
    assert found.gaps == found.unseen == found.bare == ()


@pytest.mark.parametrize("bare", [(-1.0, 9.0), (0.45, 9.0)], ids=["all of it", "half"])
def test_a_short_filament_that_lacks_ink_is_not_passed(bare: tuple[float, float]) -> None:
    found = _seen([*OLDER, SHORT], [0, 1, 2], [False, False, True], bare)
    assert found.gaps or found.unseen or found.bare


LONE: Piece = (2.5, 3.0, 3.7, 3.15, 0.35, 0.8)
"""1.2 mm long."""


@pytest.mark.parametrize("bare", [(0.45, 0.8), (-1.0, 0.55), (0.6, 9.0)])
def test_a_gap_of_a_short_filament_alone_in_a_bath_is_found(bare: tuple[float, float]) -> None:
    """It left too few places with ink, and its rims made them scatter: nothing was told."""
    (gap,) = _seen([LONE], [0], [True], bare).gaps
    ends = max(bare[0], 0.0), min(bare[1], 1.21)
    assert (gap.from_mm, gap.to_mm) == pytest.approx(ends, abs=0.1)


@pytest.mark.parametrize("rough", [0.03, 0.1])
def test_a_sound_short_filament_alone_in_a_bath_is_not_asked_about(rough: float) -> None:
    found = _seen([LONE], [0], [True], rough=rough)
    assert found.gaps == found.unseen == ()
