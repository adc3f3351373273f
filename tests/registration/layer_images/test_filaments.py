"""Filaments in a bath: translucent lines of several widths and depths, in one picture."""

import cv2
import numpy as np
import pytest

from registration.layer_images import ExpectedLines, LayerFindings, see_layer
from registration.layer_images.values import FloatArray

PX_MM = 0.02
WIDTH = np.array([0.5, 0.35, 0.3])
DARK = np.array([0.8, 0.4, 0.22])
"""Logarithm in the middle: thick and shallow to thin and deep."""
START = np.array([[1.0, 1.0, -0.5], [1.0, 2.5, -1.5], [1.0, 4.0, -2.5]])
END = np.array([[5.0, 1.4, -0.5], [5.0, 2.9, -1.5], [5.0, 4.4, -2.5]])


class Flat:
    """A frame straight from above, which sees no depth."""

    def to_pixels(self, points_mm: FloatArray) -> FloatArray:
        """Pixels of places."""
        return np.asarray(points_mm)[:, :2] / PX_MM


def _look(bare: dict[int, tuple[float, float]] | None = None) -> LayerFindings:
    """Findings of a picture in which some filaments are bare from and to, mm along them."""
    rng = np.random.default_rng(3)
    y, x = np.mgrid[0:280, 0:320] * PX_MM
    texture = cv2.GaussianBlur(rng.normal(size=x.shape), (0, 0), 2.0)
    logs = np.log(140.0) + 0.02 * texture[..., None] / texture.std() * np.ones(3)
    hues = np.array([[0.2, 0.7, 1.0], [0.25, 0.75, 1.0], [0.3, 0.8, 1.0]])  # haze takes colour away
    for number, (begin, end) in enumerate(zip(START[:, :2], END[:, :2], strict=True)):
        length = float(np.linalg.norm(end - begin))
        way = (end - begin) / length
        along = (x - begin[0]) * way[0] + (y - begin[1]) * way[1]
        across = (x - begin[0]) * way[1] - (y - begin[1]) * way[0]
        thick = np.sqrt(np.clip(1.0 - (2.0 * across / WIDTH[number]) ** 2, 0.0, 1.0))
        low, high = (bare or {}).get(number, (9.0, 9.0))
        own = (along > 0) & (along < length) & ~((along > low) & (along < high))
        logs -= DARK[number] * (thick * own)[..., None] * hues[number]
    light = cv2.GaussianBlur(np.exp(logs), (0, 0), 1.0) + rng.normal(0, 1.0, logs.shape)
    count = np.arange(3)
    lines = ExpectedLines(START, END, WIDTH, count, count, np.ones(3, dtype=np.bool_))
    return see_layer(np.clip(light, 0, 255).astype(np.uint8), Flat(), lines)


def test_sound_filaments_of_all_depths_are_seen() -> None:
    found = _look()
    assert found.gaps == ()
    assert found.seen_share > 0.95
    assert found.coverage > 0.95


@pytest.mark.parametrize("number", [0, 1, 2])
@pytest.mark.parametrize("bare", [(1.5, 2.3), (-1.0, 9.0)], ids=["gap", "all of it"])
def test_missing_ink_of_any_depth_is_found(number: int, bare: tuple[float, float]) -> None:
    found = _look({number: bare})
    (gap,) = found.gaps
    assert gap.stroke == number
    begin, end = max(bare[0], 0.0), min(bare[1], 4.02)
    assert (gap.from_mm, gap.to_mm) == pytest.approx((begin, end), abs=0.1)


def _alone(dark: float, noise: float = 1.0) -> LayerFindings:
    """Findings of one filament that leads upwards, so that it grows darker; 0 for none."""
    rng = np.random.default_rng(5)
    y, x = np.mgrid[0:280, 0:320] * PX_MM
    texture = cv2.GaussianBlur(rng.normal(size=x.shape), (0, 0), 2.0)
    logs = np.log(140.0) + 0.1 * (x / 6.0) ** 2 + 0.02 * texture / texture.std()
    thick = np.sqrt(np.clip(1.0 - (2.0 * (y - 2.5) / 0.4) ** 2, 0.0, 1.0))
    logs -= dark * thick * np.clip((x - 1.0) / 2.0, 0.1, 2.0) * ((x > 1.0) & (x < 5.0))
    light = cv2.GaussianBlur(np.exp(logs), (0, 0), 1.0) + rng.normal(0, noise, logs.shape)
    ends = np.array([[1.0, 2.5, -2.0]]), np.array([[5.0, 2.5, -0.5]])
    one = np.zeros(1, dtype=np.int64)
    lines = ExpectedLines(*ends, np.array([0.4]), one, one, np.ones(1, dtype=np.bool_))
    return see_layer(np.clip(light, 0, 255).astype(np.uint8), Flat(), lines)


def test_a_filament_that_is_missing_altogether_is_bare() -> None:
    found = _alone(0.0)
    assert found.seen_share == 0.0
    assert found.bare == (0,)


@pytest.mark.parametrize("dark", [0.1, 0.3, 1.0])
def test_a_filament_that_shows_is_not_bare_though_it_may_not_be_judged(dark: float) -> None:
    assert _alone(dark).bare == ()
