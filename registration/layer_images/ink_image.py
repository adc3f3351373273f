"""Learn how ink differs from bath in a picture, and make one image of it: bath 0, ink about 1.

The weights of the channels are Fisher's (1936, Ann. Eugen. 7, 179): the difference of the means over
the spread within, both of places as large as a part of a line, so that a bath's texture counts as
it will. Some of the lines may be missing: only those that look like ink are learned from.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from registration.layer_images.values import BoolArray, FloatArray, FloatImage
from registration.layer_images.ways import Seen
from registration.layer_images.working import Mask

ACROSS = np.linspace(-1.5, 1.5, 61)
"""Places across a line, in expected widths."""
WITHIN = np.abs(ACROSS) <= 0.5 + 1e-9
_SMOOTH = 0.15
_MOST = 20_000
_FEWEST = 60


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


def smoothed(flat: FloatImage, width_px: float) -> FloatImage:
    """Channels smoothed over a part of a line's width."""
    out = cv2.GaussianBlur(flat, (0, 0), max(0.5, _SMOOTH * width_px))
    return np.asarray(out.reshape(flat.shape))


def channel_mix(
    smooth: FloatImage, bath: BathNoise, seen: Seen, width: FloatArray, use: BoolArray
) -> FloatArray:
    """Weights (c,) of the channels by which ink and bath differ most."""
    count = smooth.shape[2]
    if count == 1 or use.sum() < _FEWEST:
        return np.ones(count) / np.sqrt(np.maximum(np.diag(bath.covariance), 1e-12))
    u = width[use, None] * np.array([[-0.2, 0.0, 0.2]])
    picked = Seen(seen.at[use], seen.across[use], seen.along[use])
    ink = np.stack(
        [picked.profiles(np.ascontiguousarray(smooth[:, :, c]), u).mean(axis=1) for c in range(count)],
        axis=1,
    ).astype(np.float64)
    keep = np.ones(len(ink), dtype=np.bool_)
    mix = np.ones(count)
    for _ in range(4):
        mean, inner = _spread(ink[keep])
        within = bath.covariance + inner
        within += 0.02 * np.diag(np.diag(within)) + 1e-12 * np.eye(count)
        mix = np.linalg.solve(within, mean - bath.mean)
        along = (ink - bath.mean) @ mix
        keep = along > 0.5 * np.percentile(along, 80)
        if keep.sum() < 20:
            break
    return np.asarray(mix)


def _spread(values: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Mean and covariance without the outermost values."""
    middle = np.median(values, axis=0)
    scale = 1.4826 * np.median(np.abs(values - middle), axis=0) + 1e-9
    near = (np.abs(values - middle) < 4.0 * scale).all(axis=1)
    kept = values[near] if near.sum() > 20 else values
    return kept.mean(axis=0), np.atleast_2d(np.cov(kept.T))


@dataclass(frozen=True)
class Template:
    """What a sound line looks like across, over `ACROSS`; its strongest place is 1.

    Attributes
    ----------
    values : (61,) float64
    scale : float
        Of the mixed image: what was divided by.
    filled : bool
        Whether the middle is about as strong as the strongest place: ink is told by its level, and
        not by its edges alone.
    """

    values: FloatArray
    scale: float
    filled: bool

    @property
    def weight(self) -> FloatArray:
        """Of each place across for the presence, (61,); times a profile, summed: 1 for ink."""
        inner = np.where(WITHIN, self.values, 0.0)
        return np.asarray(inner / max(float(inner @ self.values), 1e-12))


def learn_template(profiles: FloatImage, usable: BoolArray) -> Template:
    """Learn it from profiles (n, 61), where usable (n, 61); some may be of missing lines."""
    values = np.where(usable, profiles, 0.0)
    known = usable.sum(axis=0)
    ink = np.ones(len(profiles), dtype=np.bool_)
    shape = np.zeros(len(ACROSS))
    for _ in range(5):
        count = usable[ink].sum(axis=0)
        shape = np.where(count > 0.02 * ink.sum(), values[ink].sum(axis=0) / np.maximum(count, 1), 0)
        inner = np.where(WITHIN, shape, 0.0)
        power = float(inner @ inner)
        if power <= 0 or not known.any():
            break
        present = profiles @ inner / power
        keep = present > 0.5 * np.percentile(present, 80)
        if keep.sum() < 10 or (keep == ink).all():
            break
        ink = keep
    smooth = np.convolve(np.pad(shape, 2, mode="edge"), np.ones(5) / 5, mode="valid")
    strongest = int(np.argmax(np.abs(np.where(np.abs(ACROSS) < 0.6, smooth, 0.0))))
    scale = float(smooth[strongest])
    core = float(smooth[np.abs(ACROSS) < 0.15].mean())
    if abs(scale) < 1e-12:
        return Template(np.where(WITHIN, 1.0, 0.0), 1.0, False)
    return Template(shape / scale, scale, core / scale > 0.6)
