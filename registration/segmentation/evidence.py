"""Evidence for gel at each voxel, from signal and glints."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from kernels.arrays import BoolArray, Float32Array, FloatArray
from registration.segmentation.filters import gaussian_weights, normalise, smooth
from registration.segmentation.volume import GelField, Strength, Volume, sample
from registration.segmentation.walls import local_level
from registration.segmentation.working import probe

GLINT = 15.0
"""Times the gel's mean. Of 3 million voxels of fully developed speckle, exponential, one lies above
it: ln(3e6) = 15."""
USUAL_PERCENT = 50.0
"""Of the A-scans' brightest voxels: what walls of this part send back where they face the light, as
its top does in nearly all A-scans. Air along a drained lumen fills many, but not half of them."""


@dataclass(frozen=True)
class Glints:
    """Glints of a scan.

    Attributes
    ----------
    place : (n, 3) float64, mm
        In the scan.
    share : (n,) float64
        Brightness, of the gel's mean.
    usual : float
        Brightness that half of the A-scans exceed somewhere.
    down : int
        1 where light runs towards larger z, else -1.
    """

    place: FloatArray
    share: FloatArray
    usual: float
    down: int


def find_glints(
    share: Float32Array, voxel_mm: FloatArray, origin_mm: FloatArray, depth_down: bool
) -> Glints:
    """Return the glints of a signal in units of the gel's mean, (nz, ny, nx), uncapped."""
    index = np.argwhere(share > GLINT)
    brightest = share.max(axis=0)
    return Glints(
        origin_mm + index[:, ::-1] * voxel_mm,
        share[tuple(index.T)].astype(np.float64),
        float(np.percentile(brightest, USUAL_PERCENT)),
        1 if depth_down else -1,
    )


def no_glints() -> Glints:
    """Return the glints of a volume that no light went through."""
    return Glints(np.empty((0, 3)), np.empty(0), 0.0, 1)


SURE_GEL = 0.7
"""Share of gel in the field above which a voxel tells what gel is like."""
MORE_GEL = 0.5
"""Average above which the first answer calls a place gel."""
AROUND_MM = (0.12, 0.25, 0.25)
"""Neighbourhood of the local mean (standard deviations), z, y, x."""
FEWEST = 0.02
"""A depth with gel in less than this share of its voxels has no mean of its own."""
BRIGHTEST = 1.0
"""A voxel counts at most so many times the gel's mean: what is brighter (speckle, particles,
reflections at walls) says nothing for liquid. Of an exponential variable the cap leaves a standard
deviation of 0.57 of the mean, √(2 - 4/e - (1 - 1/e)²) / (1 - 1/e), where all of it has 1."""
GLARE = 3.0
"""Times the gel's mean: 5 % of speckle lies above, and all of a bright line."""
SIGMA_MM = 0.055
"""Standard deviation of the averages: matched to a way 0.15 mm wide, of which it keeps 0.6."""
DECISIVE = 4.0
"""Gel and liquid are told apart where they lie this many standard deviations from each other."""
_MOST_STEPS = 30
_FINE = 1e-3
"""1/mm, of the regression on the liquid above: far below what moves an average."""


@dataclass(frozen=True)
class GelEvidence:
    """How much each place looks like gel: 1 on average in gel, less in liquid.

    Attributes
    ----------
    fine : Volume
        Grey values of which ``offset + slope * value`` is the share of gel, noise and all.
    smooth : Volume
        The same averaged over `SIGMA_MM`.
    slope, offset : float
    scatter : (nz,) float64
        Standard deviation of the averaged share in gel at each depth; NaN where gel is too little
        to know it.
    voxel_mm, origin_mm : (3,) float64, mm
        As of the segmented field, x, y, z.
    glints : Glints
        What may throw a shadow; of OCT alone.
    """

    fine: Volume
    smooth: Volume
    slope: float
    offset: float
    scatter: FloatArray
    voxel_mm: FloatArray
    origin_mm: FloatArray
    glints: Glints = field(default_factory=no_glints)

    @property
    def speckled(self) -> bool:
        """Whether the fine values have noise of their own, so that only averages of them count."""
        return self.fine is not self.smooth

    def at(self, points: FloatArray) -> FloatArray:
        """Return the averaged share at (..., 3) scan positions, mm; NaN outside the field."""
        return self._sampled(self.smooth, points)

    def fine_at(self, points: FloatArray) -> FloatArray:
        """Return the share at (..., 3) scan positions, mm; NaN outside the field."""
        return self._sampled(self.fine, points)

    def scatter_at(self, points: FloatArray) -> FloatArray:
        """Return the scatter in gel at the depth of (..., 3) scan positions, mm."""
        row = (np.asarray(points)[..., 2] - self.origin_mm[2]) / self.voxel_mm[2]
        return self.scatter[np.clip(np.round(row), 0, len(self.scatter) - 1).astype(np.int64)]

    def _sampled(self, values: Volume, points: FloatArray) -> FloatArray:
        where = (np.asarray(points, dtype=np.float64) - self.origin_mm) / self.voxel_mm
        flat = np.ascontiguousarray(where.reshape(-1, 3))
        sampled = sample(values, flat).reshape(where.shape[:-1])
        return np.asarray(self.offset + self.slope * sampled)


def are_separable(
    gel: FloatArray | float, liquid: FloatArray | float, scatter: FloatArray | float
) -> NDArray[np.bool_]:
    """Return whether two levels lie far enough from each other, in standard deviations.

    `DECISIVE` 4 leaves each of them two from the middle: either is rejected with a probability of
    0.02 where it is true, and one place alone isn't yet called a defect by that.
    """
    with np.errstate(invalid="ignore"):
        return np.asarray(np.subtract(gel, liquid) >= DECISIVE * np.asarray(scatter))


def gel_evidence(
    field: GelField, strength: Strength | None, depth_down: bool = True
) -> GelEvidence:
    """Return the evidence for gel of a segmented scan.

    Parameters
    ----------
    field : GelField
        The segmented scan.
    strength : Strength or None
        OCT: the signal; None takes the field's own grey values, linear between the two levels.
    depth_down : bool
        Whether light runs towards larger z.
    """
    if strength is None:
        return _of_grey_values(field)
    values = np.asarray(field.values, dtype=np.float32)
    gel = values > SURE_GEL
    way = slice(None, None, 1 if depth_down else -1)
    share = strength.signal.copy()
    share[way] /= _predicted(strength.signal[way], values[way], gel[way], field.voxel_mm[::-1])
    # Of the bright lines at faces (many times the gel) little must get into the mean around them.
    _even(share, np.minimum(share, np.float32(GLARE)), gel, field.voxel_mm[::-1])
    glints = find_glints(share, field.voxel_mm, field.origin_mm, depth_down)
    np.clip(share, -BRIGHTEST, BRIGHTEST, out=share)
    averaged = np.empty_like(share)
    z, y, x = (gaussian_weights(SIGMA_MM / size) for size in field.voxel_mm[::-1])
    # Where the field lost the gel in the dark the evidence's own first answer finds it again.
    for _ in range(2):
        _even(share, share, gel, field.voxel_mm[::-1])
        smooth(share, averaged, (z, y, x), 0.0)
        gel = averaged > MORE_GEL
    scatter = _towards_light(_scatter(averaged, gel), field.voxel_mm[2], way)
    return GelEvidence(share, averaged, 1.0, 0.0, scatter, field.voxel_mm, field.origin_mm, glints)


def _of_grey_values(field: GelField) -> GelEvidence:
    """Evidence linear in the field's own, already smoothed values, between its two levels."""
    above = field.sign * probe(field.values)
    above = above[above > field.level]
    gel = float(np.median(above)) if len(above) else field.level + 1.0
    half = max(gel - field.level, 1e-9)
    spread = 1.4826 * float(np.median(np.abs(above - gel))) if len(above) else np.inf
    scatter = np.full(len(field.values), spread / (2 * half))
    slope, offset = field.sign / (2 * half), 0.5 - field.level / (2 * half)
    return GelEvidence(
        field.values, field.values, slope, offset, scatter, field.voxel_mm, field.origin_mm
    )


def _predicted(
    signal: Float32Array, values: Float32Array, gel: BoolArray, voxel: FloatArray
) -> Float32Array:
    """Signal of gel at each voxel; sizes (3,) mm, as z, y, x."""
    liquid = _liquid_above(values, float(voxel[0]))
    count = np.maximum(gel.sum(axis=(1, 2)), 1)
    mean = _depth_means(signal, gel)
    usual = np.where(gel, liquid, 0).sum(axis=(1, 2), dtype=np.float64) / count
    known = (count > FEWEST * gel[0].size) & (mean > 0)
    if not known.any():
        return np.full(signal.shape, np.inf, dtype=np.float32)
    rows = np.arange(len(mean))
    mean = np.exp(np.interp(rows, rows[known], np.log(mean[known])))
    usual = np.interp(rows, rows[known], usual[known])
    liquid -= usual.astype(np.float32)[:, None, None]
    base = np.exp(np.float32(_saved(signal, mean, liquid, gel)) * liquid)
    base *= mean.astype(np.float32)[:, None, None]
    return base


def _depth_means(signal: Float32Array, gel: BoolArray) -> FloatArray:
    """Mean of gel at each depth, (nz,), without glare; 0 where there is no gel.

    What counts as glare goes by the median, which of an exponential variable is ln 2 of the mean.
    """
    out = np.zeros(len(signal))
    for z in range(len(signal)):
        chosen = signal[z][gel[z]]
        if len(chosen):
            out[z] = np.minimum(chosen, GLARE * np.median(chosen) / np.log(2)).mean()
    return out


def _even(share: Float32Array, values: Float32Array, gel: BoolArray, voxel: FloatArray) -> None:
    """Divide in place by the mean of `values` over sure gel around; far from any, of all gel."""
    around = np.array(AROUND_MM) / voxel
    z, y, x = np.clip(np.round(around / 3), 1, gel.shape).astype(int).tolist()
    usual = float(values[gel].mean()) if gel.any() else 1.0
    level = local_level(values, gel, (z, y, x), around / (z, y, x), usual, False)
    normalise(share, np.zeros_like(level), level, (z, y, x))


def _liquid_above(values: Float32Array, step: float) -> Float32Array:
    """Length of liquid above each voxel, mm: what of its depth isn't gel.

    The bath counts: a channel that opens towards the light saves as much of it as one with gel
    above, and gel beside it is held against both.
    """
    free = np.clip(1 - values, 0, 1)
    return np.cumsum(free, axis=0, dtype=np.float32) * np.float32(step)


def _saved(signal: Float32Array, mean: FloatArray, liquid: Float32Array, gel: BoolArray) -> float:
    """Regression of the signal on exp(b (L - mean L)), 1/mm, at least 0.

    Solves the sum of l (r exp(-b l) - 1) = 0 over gel by Newton, r the ratio signal/mean and l the
    length less its mean: below wide lumens b l is too large for its first order alone, which
    takes b for twice what it is.
    """
    every = max(1, gel.size // 2_000_000)
    chosen = np.flatnonzero(gel.ravel()[::every]) * every
    length = liquid.ravel()[chosen].astype(np.float64)
    ratio = signal.ravel()[chosen] / mean[chosen // gel[0].size]
    saved = 0.0
    for _ in range(_MOST_STEPS):
        even = ratio * np.exp(-saved * length)
        slope = float((length**2 * even).sum())
        if slope <= 0:
            return 0.0
        step = float((length * (even - 1)).sum()) / slope
        saved = max(saved + step, 0.0)
        if abs(step) < _FINE or saved == 0:
            break
    return saved


def _towards_light(scatter: FloatArray, step: float, way: slice) -> FloatArray:
    """Fill in depths with too little gel to know its scatter, as at a round part's summit.

    Nearer to the light than any known depth gel is lit as well as there. Elsewhere a depth is like
    one that lies in the neighbourhood over which the gel's mean is taken (`AROUND_MM`); what lies
    farther away from the light stays unknown.
    """
    known = np.flatnonzero(np.isfinite(scatter[way]))
    if not len(known):
        return scatter
    out = scatter.copy()
    down = out[way]
    every = np.arange(len(down))
    nearest = known[np.abs(every[:, None] - known).argmin(axis=1)]
    like = (every < known[0]) | (np.abs(every - nearest) * step <= AROUND_MM[0])
    down[like] = down[nearest[like]]
    return out


def _scatter(mean: Float32Array, gel: BoolArray) -> FloatArray:
    """Robust standard deviation over sure gel at each depth."""
    out = np.full(len(mean), np.nan)
    for z in range(len(mean)):
        chosen = mean[z][gel[z]]
        if len(chosen) >= FEWEST * gel[z].size:
            out[z] = 1.4826 * float(np.median(np.abs(chosen - np.median(chosen))))
    return out
