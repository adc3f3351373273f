import numpy as np
import pytest

from registration.inspection.place.coarse_shift import coarse_shift

REACH = 10


def _areas(kind: str) -> tuple[np.ndarray, np.ndarray]:
    """The mask and a grey picture of it, moved by (6, -5) px, with noise."""
    mask = np.zeros((400, 400), np.uint8)
    if kind == "filled":
        mask[50:350, 60:340] = 1
    elif kind == "lines":
        mask[50:350:30, 60:340] = 1
        mask[51:351:30, 60:340] = 1
        mask[50:350, 60:64] = 1
    moved = np.roll(mask, (-5, 6), (0, 1))
    grey = 0.3 * moved + np.random.default_rng(3).normal(0, 0.05, mask.shape)
    return mask, grey[:, :, None].astype(np.float32)


@pytest.mark.parametrize("kind", ["filled", "lines"])
def test_a_shift_of_lines_and_of_a_filled_area_is_found(kind: str) -> None:
    mask, picture = _areas(kind)
    shift = coarse_shift(picture, mask, np.zeros_like(mask), (REACH, REACH))
    assert shift == pytest.approx((6, -5), abs=1)


def test_a_picture_without_ink_tells_no_shift() -> None:
    mask, picture = _areas("filled")
    empty = np.random.default_rng(4).normal(0, 0.05, picture.shape)
    assert coarse_shift(empty.astype(np.float32), mask, np.zeros_like(mask), (REACH, REACH)) is None


def test_a_shift_beyond_reach_along_rows_alone_is_not_taken() -> None:
    mask, picture = _areas("filled")
    shift = coarse_shift(picture, mask, np.zeros_like(mask), (4, REACH))
    assert shift is None or abs(shift[0]) <= 4
