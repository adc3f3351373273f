"""Estimate an OCT's depth sensitivity (roll-off, focus), separately from attenuation by gel.

Gel's signal falls on the way down for two reasons. Light fades in the gel above, so that gel below
a lumen gets more of it; and the instrument shows less of whatever lies deep or out of focus. The
model of light (`light`) knows the first alone. What the instrument loses it took for the gel's
attenuation, and gel below a lumen, a leak or a hollow face, where less has faded than it thought,
looked like half gel or less: false pits in the foot, 0.2 to 0.5 mm deep, and walls astray.

Gel below a length G of gel sends back

    I = R(z) exp(-a G)

At one depth R is the same, so that a is the regression of ln I on G within each depth
(Beer-Lambert), and R what is left of the depth's mean. Gel isn't even and lumens are few, so a is
uncertain. Before any regression it lies anywhere from 0, where the instrument takes all, to what it
is where the instrument takes nothing (rectangular, GUM 4.3.7); the two are weighted by their
variances.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d

from kernels.arrays import BoolArray, Float32Array, FloatArray
from registration.segmentation.filters import bin_mean
from registration.segmentation.lighting.light import remaining_light, share_of_gel
from registration.segmentation.working import Working

COARSE_MM = (0.045, 0.09, 0.09)
"""Blocks that are averaged, z, y, x."""
SURE = 0.9
"""Share of gel around, for a block to tell the gel's signal."""
FEWEST = 50
"""Such blocks, for a depth to be known."""
ROUNDS = 3
"""Each finds more of the gel that the one before it lost in the dark."""
PATCH_MM = 1.0
"""Gel is uneven over about this length: only columns so wide err independently."""
SMOOTH_MM = 0.1
"""The response changes over no less: standard deviation of its average."""
HALVINGS = 14
"""Of the range that a can lie in: far below its error."""
MOST_FADING = 10.0
"""1/mm: nothing is left of the light behind half a millimetre of such gel."""
LEAST = 0.02
"""Of the most: deeper, noise would be taken for gel."""
STEEP_MM, STEEP = 0.2, 0.5
"""What falls to less over so short a way isn't an instrument (a Rayleigh range of 0.3 mm does
that), but liquid below the foot that the model of light took for gel."""


@dataclass(frozen=True)
class Gel:
    """Blocks that are surely gel.

    Attributes
    ----------
    sure : (nz, ny, nx) bool
    above : (nz, ny, nx) float64, mm
        Length of gel above each.
    """

    sure: BoolArray
    above: FloatArray


def depth_response(
    signal: Float32Array, noise: float, working: Working, depth_down: bool
) -> NDArray[np.float32]:
    """Return what the instrument shows of each depth, (nz,), 1 where it shows most.

    Parameters
    ----------
    signal : (nz, ny, nx) float32
        Linear intensity without noise floor and glare.
    noise : float
        The floor that was taken off.
    working : Working
    depth_down : bool
        Whether light runs along growing z.
    """
    voxel = working.voxel_mm[::-1]
    wanted = np.maximum(1, np.round(np.array(COARSE_MM) / voxel)).astype(int)
    fz, fy, fx = np.minimum(wanted, signal.shape).tolist()
    coarse = bin_mean(signal, (fz, fy, fx), False)
    down = coarse if depth_down else coarse[::-1]
    size = voxel * (fz, fy, fx)
    response = np.ones(len(down))
    for _ in range(ROUNDS):
        gel = _gel(down, response, noise / np.sqrt(fz * fy * fx), size)
        known = _known(down, gel.sure, noise, round(STEEP_MM / float(size[0])))
        if np.count_nonzero(known) < 2:
            return np.ones(len(signal), dtype=np.float32)
        level = _levels_without_gel(down, gel, known, size)
        response = _response(level, known, float(size[0]))
    response = response if depth_down else response[::-1]
    rows = (np.arange(len(signal)) + 0.5) / fz - 0.5
    return np.interp(rows, np.arange(len(response)), response).astype(np.float32)


def _gel(down: Float32Array, response: FloatArray, noise: float, size: FloatArray) -> Gel:
    """Blocks of gel by the model of light, with a response; `noise` is a block's."""
    even = (down / response[:, None, None]).astype(np.float32)
    light, typical = remaining_light(even, float(size[0]), 6 * noise, size[:0:-1], True)
    share = even / (light * np.float32(typical))
    gel = share > 0.5
    above = (np.cumsum(gel, axis=0) - 0.5 * gel) * float(size[0])
    return Gel(share_of_gel(share, 1.0) > SURE, above)


def _known(down: Float32Array, sure: BoolArray, noise: float, reach: int) -> BoolArray:
    """Depths with enough gel that outshines the noise, (nz,), down to its foot."""
    count = np.maximum(sure.sum(axis=(1, 2)), 1)
    mean = np.where(sure, down, 0).sum(axis=(1, 2), dtype=np.float64) / count
    known = np.asarray((count >= FEWEST) & (mean > noise))
    for z in np.flatnonzero(known):
        below = np.s_[z + 1 : z + 1 + reach]
        if (mean[below][known[below]] < STEEP * mean[z]).any():
            known[z + 1 :] = False
            break
    return known


def _levels_without_gel(
    down: Float32Array, gel: Gel, known: BoolArray, size: FloatArray
) -> FloatArray:
    """Fit ln I on G by maximum likelihood, and return R of each known depth.

    Speckle's scatter grows with what comes back: a gamma likelihood with a logarithmic link, which
    is concave (McCullagh & Nelder 1989, 8.3), and takes noise in the dark, which has no logarithm.
    Its R is the mean of I exp(a G); its score, the sum of (G - its mean) (I exp(a G) / R - 1),
    grows with a. Beyond what a can be the nearer end is the likeliest.
    """
    sure, above, back = gel.sure[known], gel.above[known], down[known]
    count = sure.sum(axis=(1, 2))
    usual = np.where(sure, above, 0).sum(axis=(1, 2)) / count
    apart = np.where(sure, above - usual[:, None, None], 0)

    def scores(fades: float) -> tuple[FloatArray, FloatArray]:
        # Relative to the mean G, so that no exponential leaves the numbers' range.
        unfaded = np.where(sure, back * np.exp(fades * apart), 0)
        level = unfaded.sum(axis=(1, 2), dtype=np.float64) / count
        return apart * (unfaded / level[:, None, None]), level

    most = _without_instrument(back[sure].astype(np.float64), above[sure])
    fades = _rising(lambda at: float(scores(at)[0].sum()), most)
    score, _ = scores(fades)
    information = max(float((apart * score).sum()), 1e-12)
    excess = (score - apart).sum(axis=0)
    variance = float((_columns(excess, size) ** 2).sum()) / information**2
    trust = most**2 / 12 / (most**2 / 12 + variance)
    likely = trust * fades + (1 - trust) * most / 2
    return np.asarray(scores(likely)[1] * np.exp(likely * usual))


def _rising(score: Callable[[float], float], most: float) -> float:
    """Where a rising score is 0, between 0 and `most`; else the nearer end."""
    low, high = 0.0, most
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        low, high = (low, middle) if score(middle) > 0 else (middle, high)
    return low


def _columns(values: FloatArray, size: FloatArray) -> FloatArray:
    """Sums of (ny, nx) values over squares of `PATCH_MM`: errors within one aren't independent.

    Of a regression's scores their squares sum to its variance (Liang & Zeger 1986, robust).
    """
    every = np.maximum(1, np.round(PATCH_MM / size[1:])).astype(int)
    for axis in (0, 1):
        starts = np.arange(0, values.shape[axis], every[axis])
        values = np.add.reduceat(values, starts, axis=axis)
    return values


def _without_instrument(back: FloatArray, above: FloatArray) -> float:
    """How gel fades where the instrument takes nothing, 1/mm: one R for all depths."""
    apart = above - above.mean()

    def score(fades: float) -> float:
        unfaded = back * np.exp(fades * apart)
        return float((apart * unfaded).sum() / unfaded.mean())

    return max(_rising(score, MOST_FADING), 1e-3)


def _response(level: FloatArray, known: BoolArray, step_mm: float) -> FloatArray:
    """Response at every depth, (nz,), by the known ones' levels; beyond the gel as at its last."""
    rows = np.flatnonzero(known)
    smooth = gaussian_filter1d(
        np.interp(np.arange(len(known)), rows, np.log(level)),
        SMOOTH_MM / step_mm,
        mode="nearest",
    )
    return np.asarray(np.exp(np.maximum(smooth - smooth.max(), np.log(LEAST))))
