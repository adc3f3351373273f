"""Sample brightness across printed lines in a picture; find the ink's signal height and middle."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

import cv2
import numpy as np
from scipy.ndimage import gaussian_filter1d, uniform_filter1d

from kernels.arrays import BoolArray, Float32Array, FloatArray
from registration.devices.lens.perspective import mapped, slopes
from registration.errors import PictureError

OUTER: Final = 0.25
"""Of a profile's half, at its end: taken as ground."""
LEAST_OF_INK: Final = 0.4
"""Of a line's usual contrast that a place must have to be ink."""
_STEP_PX: Final = 0.5
_ALONG_PX: Final = 2.0
_FEWEST_STEPS: Final = 12


@dataclass(frozen=True)
class ScanLine:
    """Places along a line at which it is looked across.

    Attributes
    ----------
    along_mm : (n,) float64, mm
        From its begin.
    points, normals : (n, 2) float64, mm
        There, and the direction across, to the left.
    step_mm : float, mm
        Between two: what one place is the mean of.
    """

    along_mm: FloatArray
    points: FloatArray
    normals: FloatArray
    step_mm: float

    @staticmethod
    def of(corners: FloatArray, step_mm: float) -> ScanLine:
        """Along a polyline (k, 2), mm, in equal steps of about ``step_mm``."""
        ends = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(corners, axis=0).T))])
        count = max(1, round(ends[-1] / step_mm))
        along = (np.arange(count) + 0.5) * ends[-1] / count
        row = np.clip(np.searchsorted(ends, along, side="right") - 1, 0, len(corners) - 2)
        way = np.diff(corners, axis=0)[row]
        length = np.hypot(*way.T)
        unit = way / length[:, None]
        points = corners[row] + unit * (along - ends[row])[:, None]
        return ScanLine(along, points, np.column_stack([-unit[:, 1], unit[:, 0]]), ends[-1] / count)

    @staticmethod
    def straight(begin: FloatArray, end: FloatArray, step_mm: float) -> ScanLine:
        """From one place to another."""
        return ScanLine.of(np.array([begin, end]), step_mm)


@dataclass(frozen=True)
class Profiles:
    """Brightness across a line at its places, the ground taken off.

    Attributes
    ----------
    across_mm : (m,) float64, mm
        From the line as designed, to the left.
    values : (n, m) float64
        Higher where there is ink; 0 of the ground.
    inside : (n,) bool
        Whether all of it lies in the picture.
    """

    across_mm: FloatArray
    values: FloatArray
    inside: BoolArray

    @property
    def step_mm(self) -> float:
        """Between two samples."""
        return float(self.across_mm[1] - self.across_mm[0])

    def smoothed(self, blur_mm: float) -> Profiles:
        """With a Gaussian of that deviation run across."""
        values = gaussian_filter1d(self.values, blur_mm / self.step_mm, axis=1, mode="nearest")
        return replace(self, values=np.asarray(values))


def profiles_along(
    image: Float32Array,
    matrix: FloatArray,
    way: ScanLine,
    reach_mm: float,
    coarse: float = 1.0,
) -> Profiles:
    """Sample across, averaging along over each place's own step; ``coarse`` times fewer samples.

    Raises
    ------
    PictureError
        When the reach is less than a few pixels.
    """
    px_per_mm = float(np.sqrt(abs(np.linalg.det(slopes(matrix, way.points[:1])[0]))))
    count = round(2 * reach_mm * px_per_mm / (_STEP_PX * coarse))
    if count < _FEWEST_STEPS:
        raise PictureError(
            f"a pixel is {1e3 / px_per_mm:.0f} µm, too coarse for what is to be measured "
            f"({reach_mm * 1e3:.0f} µm to either side); take a picture with more pixels"
        )
    across = np.linspace(-reach_mm, reach_mm, count | 1)
    sub = max(1, round(way.step_mm * px_per_mm / (_ALONG_PX * coarse)))
    shift = ((np.arange(sub) + 0.5) / sub - 0.5) * way.step_mm
    unit = np.column_stack([way.normals[:, 1], -way.normals[:, 0]])
    places = (
        way.points[:, None, None]
        + shift[None, :, None, None] * unit[:, None, None]
        + across[None, None, :, None] * way.normals[:, None, None]
    )
    seen = mapped(matrix, places.reshape(-1, 2)).astype(np.float32)
    # OpenCV takes pictures of at most 2^15 samples a side.
    rows = seen.reshape(len(way.points) * sub, len(across), 2)
    values = np.concatenate([
        cv2.remap(image, part, None, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE)
        for part in np.array_split(rows, len(rows) // 20_000 + 1)
    ])  # fmt: skip
    high, wide = image.shape
    fits = np.asarray(((rows >= 0) & (rows <= (wide - 1, high - 1))).all(axis=(1, 2)))
    mean = values.reshape(len(way.points), sub, -1).astype(np.float64).mean(axis=1)
    inside = np.asarray(fits.reshape(len(way.points), sub).all(axis=1), dtype=np.bool_)
    return Profiles(across, mean - _ground(mean, across), inside)


def _ground(values: FloatArray, across: FloatArray) -> FloatArray:
    """Straight line from the middle of what lies outside on one side to that on the other."""
    reach = float(across[-1])
    left, right = across < -(1 - OUTER) * reach, across > (1 - OUTER) * reach
    low, high = np.median(values[:, left], axis=1), np.median(values[:, right], axis=1)
    share = (across + (1 - OUTER / 2) * reach) / ((2 - OUTER) * reach)
    return low[:, None] + (high - low)[:, None] * share


def peaks(seen: Profiles, width_mm: float) -> FloatArray:
    """Profiles (n, m) with what is much narrower than a line smoothed away."""
    wide = max(3, round(0.5 * width_mm / seen.step_mm))
    return np.asarray(uniform_filter1d(seen.values, wide, axis=1, mode="nearest"))


def usual_height(seen: Profiles, width_mm: float) -> float:
    """Height that a quarter of the places reach: of a line that is mostly missing, too."""
    return float(np.percentile(peaks(seen, width_mm).max(axis=1), 75))


def middles(seen: Profiles, width_mm: float, least: float = 0.0) -> tuple[FloatArray, BoolArray]:
    """Middle of the ink at each place, (n,), mm across, and whether there is some, (n,).

    The centre of gravity of what is above half of the peak around it. Ink is what reaches a part of
    the line's usual height, and ``least``.
    """
    smooth = peaks(seen, width_mm)
    top = smooth.argmax(axis=1)
    height = smooth[np.arange(len(top)), top]
    usual = float(np.median(height))
    has_ink = seen.inside & (height > max(LEAST_OF_INK * usual, least)) & (height > 0)
    above = seen.values > 0.5 * height[:, None]
    # Only what hangs together with the peak.
    index = np.arange(seen.values.shape[1])
    broken = np.where(above, -1, index)
    left = np.where(index <= top[:, None], broken, -1).max(axis=1)
    right = np.where((index >= top[:, None]) & ~above, index, seen.values.shape[1]).min(axis=1)
    own = (index > left[:, None]) & (index < right[:, None])
    weight = np.where(own, np.maximum(seen.values, 0.0), 0.0)
    total = np.maximum(weight.sum(axis=1), 1e-12)
    at = (weight * seen.across_mm).sum(axis=1) / total
    return at, has_ink & own.any(axis=1)
