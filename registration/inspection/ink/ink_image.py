"""Learn channel weights (Fisher's) and the cross-profile of a line that separate ink from bath.

The weights of the channels are Fisher's (1936, Ann. Eugen. 7, 179): the difference of the means
over the spread within, both of places as large as a part of a line, so that a bath's texture counts
as it will. Some of the lines may be missing: only those that look like ink are learned from.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import cv2
import numpy as np

from kernels.arrays import BoolArray, FloatArray
from registration.inspection.pictures.working import Mask
from registration.inspection.values import FloatImage
from registration.inspection.ways import Seen

ACROSS = np.linspace(-1.5, 1.5, 61)
"""Places across a line, in expected widths."""
WITHIN = np.abs(ACROSS) <= 0.5 + 1e-9
CORE = np.abs(ACROSS) <= 0.3 + 1e-9
"""What is looked at of filled lines: one that is thin is not a missing one."""
SMOOTH = 0.15
_RIDGE = 0.3
"""Of the bath's mean variance across: noise that its covariance doesn't know of."""
_STEEP = 0.6
_LEAST_ODD = 0.1
"""Of the even part's power; a smaller odd part is left out."""
_MOST = 20_000
_FEWEST = 60
_FEWEST_LINES = 8


@dataclass(frozen=True)
class BathNoise:
    """Spread of the bath in the smoothed channels: mean (c,), covariance (c, c)."""

    mean: FloatArray
    covariance: FloatArray

    @staticmethod
    def of(smooth: FloatImage, free: Mask, rng: np.random.Generator) -> BathNoise | None:
        """Measure it; None where there is too little bath."""
        places = np.flatnonzero(free.ravel())
        if len(places) < _FEWEST:
            return None
        some = rng.choice(places, min(_MOST, len(places)), replace=False)
        return BathNoise(*_spread(smooth.reshape(-1, smooth.shape[2])[some].astype(np.float64)))

    def widened(self, by: float) -> BathNoise:
        """Return it with more scatter in each channel."""
        return replace(self, covariance=self.covariance + by**2 * np.eye(len(self.mean)))


def smoothed(flat: FloatImage, width_px: float) -> FloatImage:
    """Channels smoothed over a part of a line's width."""
    out = cv2.GaussianBlur(flat, (0, 0), max(0.5, SMOOTH * width_px))
    return np.asarray(out.reshape(flat.shape))


def channel_mix(
    smooth: FloatImage, bath: BathNoise, seen: Seen, width: FloatArray, use: BoolArray
) -> FloatArray:
    """Weights (c,) of the channels by which ink and bath differ most."""
    count = smooth.shape[2]
    if count == 1 or use.sum() < _FEWEST:
        return np.ones(count) / np.sqrt(np.maximum(np.diag(bath.covariance), 1e-12))
    u = width[use, None] * np.array([[-0.4, -0.2, 0.0, 0.2, 0.4]])
    picked = Seen(seen.at[use], seen.across[use], seen.along[use])
    ink = np.stack(
        [
            picked.profiles(np.ascontiguousarray(smooth[:, :, c]), u).mean(axis=1)
            for c in range(count)
        ],
        axis=1,
    ).astype(np.float64)
    keep = np.ones(len(ink), dtype=np.bool_)
    mix: FloatArray = np.ones(count)
    for _ in range(4):
        mean, inner = _spread(ink[keep])
        within = bath.covariance + inner
        within += 0.02 * np.diag(np.diag(within)) + 1e-12 * np.eye(count)
        mix = np.asarray(np.linalg.solve(within, mean - bath.mean), dtype=np.float64)
        along = (ink - bath.mean) @ mix
        keep = along > 0.5 * np.percentile(along, 80)
        if keep.sum() < 20:
            break
    return np.asarray(mix)


def mixes_of(
    smooth: FloatImage, bath: BathNoise, seen: Seen, width: FloatArray, use: BoolArray
) -> list[FloatArray]:
    """Weights of the channels worth trying: Fisher's, and plain brightness."""
    first = channel_mix(smooth, bath, seen, width, use)
    if len(first) == 1:
        return [first]
    return [first, 1.0 / np.sqrt(np.maximum(np.diag(bath.covariance), 1e-12)) / len(first)]


def _spread(values: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Mean and covariance without the outermost values."""
    middle = np.median(values, axis=0)
    scale = 1.4826 * np.median(np.abs(values - middle), axis=0) + 1e-9
    near = (np.abs(values - middle) < 4.0 * scale).all(axis=1)
    kept = values[near] if near.sum() > 20 else values
    return kept.mean(axis=0), np.atleast_2d(np.cov(kept.T))


@dataclass(frozen=True)
class Template:
    """What a sound line looks like across, by the direction in which the picture shows it.

    A line that is lit from the side is brighter on one side: m(u) = m0(u) + m1(u) cos a + m2(u)
    sin a, a the direction of "to the left" in the picture. m0 is even in u, m1 and m2 are odd.

    Attributes
    ----------
    terms : (3, 61) float64
        m0, m1, m2 over `ACROSS`; the strongest place is 1.
    scale : float
        Of the mixed image: what was divided by.
    slant : float
        Root of the power of the odd part over that of the even one: light from the side.
    filled : bool
        Whether the middle is about as strong as the strongest place: ink is told by its level, and
        not by its edges alone.
    """

    terms: FloatArray
    scale: float
    filled: bool
    slant: float = 0.0

    @property
    def by_edges(self) -> bool:
        """Whether ink is told by its edges or slopes, and not by its level."""
        return not self.filled or self.slant > _STEEP

    @property
    def values(self) -> FloatArray:
        """m0, (61,)."""
        return np.asarray(self.terms[0])

    @property
    def one_sided(self) -> bool:
        """Whether it hangs on the direction of a line."""
        return bool(np.any(self.terms[1:]))

    @property
    def even(self) -> Template:
        """The same without light from the side."""
        return replace(self, terms=self.terms * np.array([[1.0], [0.0], [0.0]]), slant=0.0)

    def rows(self, angle: FloatArray) -> FloatArray:
        """Template of each direction, (n, 61); 0 outside the line."""
        turned = np.column_stack([np.ones_like(angle), np.cos(angle), np.sin(angle)])
        return np.asarray(turned @ np.where(WITHIN, self.terms, 0.0))

    def weights(self, angle: FloatArray, noise: FloatArray | None) -> tuple[FloatArray, FloatArray]:
        """Weights for the presence (n, 61), and the strength of each direction's template, (n,).

        A profile times its weights, summed, is 1 for ink and 0 for bath. Ink that is told by its
        edges is weighted against the bath's own texture (``noise``, covariance (61, 61)): a matched
        filter.
        """
        rows = self.rows(angle)
        weights = np.where(CORE, rows, 0.0) if self.filled else rows
        if not self.filled and noise is not None:
            inner = np.where(WITHIN[:, None] & WITHIN, noise, 0.0)
            ridge = _RIDGE * float(np.trace(inner)) / int(WITHIN.sum())
            weights = np.linalg.solve(inner + ridge * np.eye(len(ACROSS)), rows.T).T
        power = (rows * weights).sum(axis=1)
        strength = np.sqrt((rows**2).sum(axis=1))
        return weights / np.maximum(power, 1e-12)[:, None], strength


def angle_of(seen: Seen) -> FloatArray:
    """Direction of "to the left" in the picture, (n,)."""
    return np.nan_to_num(np.arctan2(seen.across[:, 1], seen.across[:, 0]))


def learn_template(profiles: FloatImage, usable: BoolArray, angle: FloatArray) -> Template:
    """Learn it from profiles (n, 61), where usable (n, 61); some may be of missing lines."""
    values = np.where(usable, profiles, 0.0)
    ink = np.ones(len(profiles), dtype=np.bool_)
    terms, slant = np.zeros((3, len(ACROSS))), 0.0
    for _ in range(5):
        terms, slant = _terms(values[ink], usable[ink], angle[ink])
        weights, _ = Template(terms, 1.0, True).weights(angle, None)
        present = (profiles * weights).sum(axis=1)
        keep = present > 0.5 * np.percentile(present, 80)
        if keep.sum() < _FEWEST_LINES or (keep == ink).all():
            break
        ink = keep
    return replace(_scaled(terms), slant=slant)


def _terms(values: FloatImage, usable: BoolArray, angle: FloatArray) -> tuple[FloatArray, float]:
    """Least squares of all three terms, each profile taken from both of its sides; the slant."""
    turned = np.column_stack([np.ones_like(angle), np.cos(angle), np.sin(angle)])
    back = turned * (1.0, -1.0, -1.0)
    both, mask = turned.T @ values + back.T @ values[:, ::-1], usable
    number = np.maximum(mask.sum(axis=0) + mask[:, ::-1].sum(axis=0), 1)
    even = both[0] / number
    odd = np.zeros((2, len(ACROSS)))
    power = turned[:, 1:].T @ turned[:, 1:] / len(turned)
    inner = np.linalg.pinv(power + 1e-6 * np.eye(2), rcond=0.05)
    odd = inner @ (both[1:] / number)
    power_odd, power_even = (float((v[..., WITHIN] ** 2).sum()) for v in (odd, even))
    slant = float(np.sqrt(power_odd / max(power_even, 1e-12)))
    if slant**2 < _LEAST_ODD:
        odd[:] = 0.0
    return np.where(mask.mean(axis=0) > 0.02, np.vstack([even, odd]), 0.0), slant


def _scaled(terms: FloatArray) -> Template:
    smooth = np.convolve(np.pad(terms[0], 2, mode="edge"), np.ones(5) / 5, mode="valid")
    near = np.abs(ACROSS) < 0.6
    strongest = float(smooth[np.argmax(np.abs(np.where(near, smooth, 0.0)))])
    odd = float(np.sqrt((terms[1:, near] ** 2).sum(axis=0)).max())
    core = float(smooth[np.abs(ACROSS) < 0.15].mean())
    scale = strongest if abs(strongest) > odd else odd
    if abs(scale) < 1e-12:
        return Template(
            np.vstack([np.where(WITHIN, 1.0, 0.0), np.zeros((2, len(ACROSS)))]), 1.0, False
        )
    return Template(terms / scale, scale, abs(core) > 0.6 * max(abs(strongest), odd))
