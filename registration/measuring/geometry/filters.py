"""Gaussian profile filters (ISO 16610-21, -28)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from kernels.arrays import FloatArray

ALPHA = float(np.sqrt(np.log(2) / np.pi))
"""A wave of the cut-off's length keeps half of its amplitude (ISO 16610-21:2011, 4.2)."""


def closed_transmission(rays: int, cut_off: float) -> FloatArray:
    """Amplitude that each harmonic of a closed profile keeps, (rays // 2 + 1,).

    exp(-π (α k / k_c)²), k undulations per revolution, cut-off k_c (ISO 16610-21:2011, 4.3).
    """
    order = np.arange(rays // 2 + 1)
    return np.asarray(np.exp(-np.pi * (ALPHA * order / cut_off) ** 2))


def closed_filtered(profile: FloatArray, cut_off: float) -> FloatArray:
    """Return closed profiles (..., rays) without waves beyond the cut-off."""
    rays = profile.shape[-1]
    keep = closed_transmission(rays, cut_off)
    return np.fft.irfft(np.fft.rfft(profile, axis=-1) * keep, rays, axis=-1)


def cells(places: FloatArray, edge_mm: float) -> NDArray[np.int64]:
    """Number of the cube of `edge_mm` that each place (n, 3) lies in, from 0 without gaps."""
    index = np.floor(places / edge_mm).astype(np.int64)
    index -= index.min(axis=0)
    size = index.max(axis=0) + 1
    flat = (index[:, 0] * size[1] + index[:, 1]) * size[2] + index[:, 2]
    return np.asarray(np.unique(flat, return_inverse=True)[1]).reshape(-1)


def open_filter(along: FloatArray, cut_off: float, at: FloatArray | None = None) -> FloatArray:
    """Matrix (m, n) that filters values at n places `along` a line, for places `at` (its own).

    Weights exp(-π (x / (α λ))²) about a straight line fitted there: a slope passes whole, to the
    ends (ISO 16610-28:2016, moment criterion of first order). Where fewer than two places weigh
    the nearest counts.
    """
    at = along if at is None else at
    off = along - at[:, None]
    weight = np.exp(-np.pi * np.minimum((off / (ALPHA * cut_off)) ** 2, 200.0))
    weight = np.maximum(weight, 1e-12 * np.exp(-np.abs(off) / cut_off))
    s0, s1, s2 = ((weight * off**k).sum(axis=1)[:, None] for k in (0, 1, 2))
    det = s0 * s2 - s1**2
    line = weight * (s2 - s1 * off) / np.where(det > 1e-9 * s0 * s2, det, np.inf)
    return np.asarray(np.where(det > 1e-9 * s0 * s2, line, weight / s0))
