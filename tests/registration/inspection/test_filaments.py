"""Filaments in a bath: translucent lines of several widths and depths, in one picture."""

import cv2
import numpy as np
import pytest

from kernels.arrays import FloatArray
from registration.inspection import ExpectedLines, LayerFindings, see_layer
from tests.slower import first_of

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


def _look(
    bare: dict[int, tuple[float, float]] | None = None, end: FloatArray = END
) -> LayerFindings:
    """Findings of a picture in which some filaments are bare from and to, mm along them."""
    rng = np.random.default_rng(3)
    y, x = np.mgrid[0:280, 0:320] * PX_MM
    texture = cv2.GaussianBlur(rng.normal(size=x.shape), (0, 0), 2.0)
    logs = np.log(140.0) + 0.02 * texture[..., None] / texture.std() * np.ones(3)
    hues = np.array([[0.2, 0.7, 1.0], [0.25, 0.75, 1.0], [0.3, 0.8, 1.0]])  # haze takes colour away
    for number, (begin, stop) in enumerate(zip(START[:, :2], END[:, :2], strict=True)):
        length = float(np.linalg.norm(stop - begin))
        way = (stop - begin) / length
        along = (x - begin[0]) * way[0] + (y - begin[1]) * way[1]
        across = (x - begin[0]) * way[1] - (y - begin[1]) * way[0]
        thick = np.sqrt(np.clip(1.0 - (2.0 * across / WIDTH[number]) ** 2, 0.0, 1.0))
        low, high = (bare or {}).get(number, (9.0, 9.0))
        own = (along > 0) & (along < length) & ~((along > low) & (along < high))
        logs -= DARK[number] * (thick * own)[..., None] * hues[number]
    light = cv2.GaussianBlur(np.exp(logs), (0, 0), 1.0) + rng.normal(0, 1.0, logs.shape)
    count = np.arange(3)
    lines = ExpectedLines(START, end, WIDTH, count, count, np.ones(3, dtype=np.bool_))
    return see_layer(np.clip(light, 0, 255).astype(np.uint8), Flat(), lines)


def test_sound_filaments_of_all_depths_are_seen() -> None:
    found = _look()
    assert found.gaps == ()
    assert found.seen_share > 0.95
    assert found.coverage > 0.95


@pytest.mark.parametrize("number", first_of([1, 0, 2]))
@pytest.mark.parametrize("bare", [(1.5, 2.3), (-1.0, 9.0)], ids=["gap", "all of it"])
def test_missing_ink_of_any_depth_is_found(number: int, bare: tuple[float, float]) -> None:
    found = _look({number: bare})
    (gap,) = found.gaps
    assert gap.stroke == number
    begin, end = max(bare[0], 0.0), min(bare[1], 4.02)
    assert (gap.from_mm, gap.to_mm) == pytest.approx((begin, end), abs=0.1)


def _faint(
    dark: float, seed: int, bare: tuple[float, float] | None = None, before: bool = True
) -> LayerFindings:
    """Findings of one faint filament of 5 mm; with glints that moved since the picture before."""
    rng = np.random.default_rng(seed)
    y, x = np.mgrid[0:280, 0:380] * PX_MM
    texture = cv2.GaussianBlur(rng.normal(size=x.shape), (0, 0), 2.0)
    bath = np.log(140.0) + 0.05 * (x / 7.0) ** 2 + 0.02 * texture / texture.std()
    thick = np.sqrt(np.clip(1.0 - (2.0 * (y - 2.5) / 0.4) ** 2, 0.0, 1.0))
    low, high = bare or (9.0, 9.0)
    ink = bath - dark * thick * ((x > 1.0) & (x < 6.0) & ~((x > low) & (x < high)))
    pictures = []
    for moved, logs in ((0.0, bath), (0.06, ink)):
        glint = 400.0 * np.exp(-(((x - 5.0 - moved) ** 2 + (y - 4.5 - moved) ** 2) / 0.2**2))
        light = cv2.GaussianBlur(np.exp(logs) + glint, (0, 0), 1.0)
        pictures.append(np.clip(light + rng.normal(0, 1.5, x.shape), 0, 255).astype(np.uint8))
    ends = np.array([[1.0, 2.5, -1.0]]), np.array([[6.0, 2.5, -1.0]])
    one = np.zeros(1, dtype=np.int64)
    lines = ExpectedLines(*ends, np.array([0.4]), one, one, np.ones(1, dtype=np.bool_))
    return see_layer(pictures[1], Flat(), lines, before=pictures[0] if before else None)


@pytest.mark.parametrize("bare", [(2.6, 4.1), (3.5, 6.1)], ids=["1.5 mm", "half"])
@pytest.mark.parametrize("seed", first_of([1, 2, 3]))
def test_missing_ink_of_a_lone_faint_filament_is_found(seed, bare):
    found = _faint(0.04, seed, bare)
    (gap,) = found.gaps
    begin, end = bare[0] - 1.0, min(bare[1] - 1.0, 5.0)
    assert (gap.from_mm, gap.to_mm) == pytest.approx((begin, end), abs=0.3)


def test_what_is_too_faint_is_told_as_not_seen_over_its_whole_length() -> None:
    found = _faint(0.006, 7, (3.5, 6.1))
    assert found.gaps == ()
    assert sum(one.length_mm for one in found.unseen) == pytest.approx(5.0, abs=0.2)
    assert _faint(0.1, 7).unseen == ()
