"""Compensation: errors of one print told from errors of all; incompatible prints refused."""

from __future__ import annotations

import numpy as np
import pytest

from printctl.corrections.feedback import Choices, Mean, Print, estimate
from printctl.corrections.feedback.local import repeating
from printctl.errors import UsageError
from tests.printctl.corrections.feedback.lab import Lab

CALIBRATED = Choices(bias=Mean(0.0, 1e-3))
ALWAYS = {17: -0.04, 20: 0.04}
LOCAL_GAIN = 0.7


def prints_with_an_accident(count: int, always: dict[int, float], noise_mm: float) -> list[Print]:
    """Vessel 15 is 60 um too narrow over all of its length, in the first print alone."""
    lab = Lab(shrink=(1, 1, 1), noise_mm=noise_mm)
    made = []
    for number in range(count):
        lab.faults_mm = always | ({15: -0.06} if number == 0 else {})
        made.append(lab.print())
    return made


@pytest.mark.parametrize("count", [2, 3, 6])
@pytest.mark.parametrize("noise_mm", [0.002, 0.006])
def test_one_prints_accident_neither_is_corrected_nor_hides_what_repeats(
    count: int, noise_mm: float
) -> None:
    made = estimate(prints_with_an_accident(count, ALWAYS, noise_mm), CALIBRATED)
    change = {part.vessel: part.diameter_um for part in made.vessels}
    assert 15 not in change
    # Nearly all of the 40 um times the gain; the noise's mean is told in as many prints.
    slack = 2.5 + 3e3 * LOCAL_GAIN * noise_mm / count**0.5
    assert change[17] == pytest.approx(LOCAL_GAIN * 40, abs=slack)
    assert change[20] == pytest.approx(-LOCAL_GAIN * 40, abs=slack)
    assert made.radial.offset_um == 0
    assert made.radial.slope_um_per_mm == 0


def test_an_accident_changes_nothing_for_the_others() -> None:
    """Not their common size, nor how sure they are: as if that print hadn't had it."""
    with_it = estimate(prints_with_an_accident(3, ALWAYS, 0.002), CALIBRATED)
    lab = Lab(shrink=(1, 1, 1), faults_mm=ALWAYS)
    without = estimate([lab.print() for _ in range(3)], CALIBRATED)
    rows = [
        {row["vessel"]: row["excess_um"] for row in made.evidence["vessels"]}
        for made in (with_it, without)
    ]
    others = sorted(set(rows[0]) - {15})
    difference = [rows[0][vessel] - rows[1][vessel] for vessel in others]
    assert np.abs(difference).max() < 0.3
    assert rows[0][15] == pytest.approx(-20, abs=3)


def test_cochrans_test_finds_what_does_not_repeat() -> None:
    """Three of 3 prints each. Of variances 1, 1 and 30 the largest over the mean of the others is
    30; F(2, 4) exceeds 30 with a probability of (1 + 30 / 2)^-2 = 0.0039, times 3 vessels 0.012."""
    free = np.array([2, 2, 2])
    assert repeating(np.array([1.0, 1.0, 30.0]), free).all()
    # 40: (1 + 20)^-2 = 0.0023, times 3 is 0.0068.
    assert repeating(np.array([1.0, 1.0, 40.0]), free).tolist() == [True, True, False]
    assert repeating(np.zeros(4), np.zeros(4, dtype=np.int64)).all()
    assert repeating(np.zeros(3), free).all()


def test_prints_of_different_depth_are_not_pooled_without_a_standard() -> None:
    lab = Lab(depth_standard=True)
    first = estimate([lab.print()])
    assert first.stretch.factor[2] == pytest.approx(1 / 0.975, abs=2e-3)
    lab.depth_standard = False
    plain, higher, again = lab.print(), lab.print(first), lab.print(first)
    says = (
        r"run2 was written 1\.0000 times as high as designed, run3 1\.02\d\d times.*"
        r"no depth standard stands behind the scan of run2 and 1 more.*--depth-standard"
    )
    with pytest.raises(UsageError, match=says):
        estimate([plain, higher])
    # Alike, they are pooled, and their common depth is left as it was.
    assert estimate([higher, again]).stretch.factor[2] == first.stretch.factor[2]
    word = Choices(depth_standard="block of 3.00 mm by micrometer")
    both = estimate([plain, higher], word)
    assert both.stretch.factor[2] == pytest.approx(first.stretch.factor[2], abs=2e-3)
