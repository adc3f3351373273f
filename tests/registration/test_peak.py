"""Sizes of changes as short as a few blurs hold, whatever their shape; long ones stay as sure."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter1d

from kernels.arrays import FloatArray
from registration.measuring.gauging.changes import _defects, _Series, peak_of
from registration.measuring.gauging.defect import Defect
from registration.measuring.gauging.sections import RAYS
from tests.registration.phantom import CHANNEL, block, traces
from tests.slower import first_of

FINE, BLUR, NOISE = 0.001, 0.03, 0.003


def measured(shape: Callable[[FloatArray], FloatArray], along: FloatArray) -> FloatArray:
    """A change as sections show it: blurred along the vessel, sampled at stations."""
    fine = np.arange(along[0] - 1, along[-1] + 1, FINE)
    return np.interp(along, fine, gaussian_filter1d(shape(fine), BLUR / FINE, truncate=6))


def listed(shape: Callable[[FloatArray], FloatArray]) -> Defect:
    trace = traces(block())[CHANNEL]
    change = measured(shape, trace.along)
    nothing = np.zeros((len(change), RAYS))
    score = change / NOISE
    noise = np.full(len(change), NOISE)
    series = _Series(trace, change, noise, 0.0, nothing, score, nothing, 5.0, BLUR)
    (found,) = _defects(series)
    return found


@pytest.mark.parametrize("off", first_of([0.02, 0.0, 0.05]))
@pytest.mark.parametrize(
    "shape",
    [
        lambda z: -0.18 * (np.abs(z) < 0.1),
        lambda z: -0.18 * (np.abs(z) < 0.15),
        lambda z: 0.18 * np.clip((0.125 - np.abs(z)) / 0.05, 0, 1),
        lambda z: -0.18 * np.clip(1 - np.abs(z) / 0.25, 0, 1),
        lambda z: -0.18 * np.exp(-0.5 * (z / 0.1) ** 2),
        lambda z: 0.18 * np.exp(-0.5 * (z / 0.15) ** 2),
    ],
)
def test_a_short_change_lies_in_its_interval(
    shape: Callable[[FloatArray], FloatArray], off: float
) -> None:
    middle = 3.0 + off
    found = listed(lambda along: shape(along - middle))
    assert abs(abs(found.size_um) - 180) <= found.error_um < 45


@pytest.mark.parametrize("length", [0.6, 1.2])
def test_a_long_change_is_as_sure_as_its_sections(length: float) -> None:
    found = listed(lambda along: -0.05 * (np.abs(along - 3.0) < length / 2))
    assert found.error_um < 1.05 * 1.96e3 * NOISE
    assert found.size_um == pytest.approx(-50, abs=2)


def test_one_noisy_station_makes_no_long_change_short() -> None:
    along = 0.1 * np.arange(40)
    change = np.where(np.abs(along - 2) < 0.8, 0.05, 0.0)
    change[22] = 0.02
    peak = peak_of(change, along, 19, BLUR)
    assert peak.height == pytest.approx(0.05, abs=0.001)
    assert peak.standard < 0.001


def test_beside_a_gap_the_station_counts() -> None:
    change = np.array([np.nan, np.nan, 0.05, np.nan, np.nan])
    peak = peak_of(change, 0.1 * np.arange(5), 2, BLUR)
    assert (peak.height, peak.along, peak.standard) == (0.05, 0.2, 0.0)
