"""Sizes of changes as short as a few blurs hold, whatever their shape; long ones stay as sure."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter1d

from kernels.arrays import FloatArray
from registration.measuring.gauging.changes import _defects, _Series
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
def test_a_short_change_lies_in_its_interval(shape, off):
    middle = 3.0 + off
    found = listed(lambda along: shape(along - middle))
    assert abs(abs(found.size_um) - 180) <= found.error_um < 45
