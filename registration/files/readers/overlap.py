"""Find the positions of overlapping scans: correlate overlaps, then solve least squares."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.fft import irfftn, rfftn
from scipy.ndimage import gaussian_filter

from kernels.arrays import FloatArray, IntArray
from registration.files.readers.raw_result import Array

_LONGEST = 96
_ROUNDS = 4
_LEAST_OVERLAP = 6
_LEAST_CORRELATION = 0.3
_SCORE_ERROR = 0.01
"""Differences of the correlation below this come from shading and edges as well: the list, taken
as good to half its reach, then decides. Along a straight channel nothing else can."""


@dataclass(frozen=True)
class Placement:
    """Positions of overlapping scans.

    Attributes
    ----------
    at : (n, 3) float64, voxels
        Of each scan's first voxel, as x, y, z; the first stays where it was listed.
    moved : (n, 3) float64, voxels
        From where they were listed.
    left : (p, 3) float64, voxels
        By how much each overlap disagrees with that.
    blind : int
        Overlaps that show too little to tell.
    alone : tuple of int
        Scans that overlap no other where they are listed.
    """

    at: FloatArray
    moved: FloatArray
    left: FloatArray
    blind: int
    alone: tuple[int, ...]


def settle(volumes: Sequence[Array], listed: FloatArray, reach: FloatArray) -> Placement:
    """Move scans so that what they share agrees.

    Parameters
    ----------
    volumes : sequence of (nz, ny, nx)
        Grey values.
    listed : (n, 3) float64, voxels
        Where each is said to lie, x, y, z.
    reach : (3,) float64, voxels
        How far an overlap may move one against the other.
    """
    pairs, gaps, blind = [], [], 0
    touched: set[int] = set()
    for i, j in itertools.combinations(range(len(volumes)), 2):
        gap = listed[j] - listed[i]
        if not _overlaps(volumes[i], volumes[j], gap):
            continue
        touched |= {i, j}
        measured = _measured(volumes[i], volumes[j], gap, reach)
        if measured is None:
            blind += 1
        else:
            pairs.append((i, j))
            gaps.append(measured)
    alone = tuple(sorted(set(range(len(volumes))) - touched))
    at = _balanced(listed, pairs, np.array(gaps).reshape(-1, 3))
    left = [at[j] - at[i] - gap for (i, j), gap in zip(pairs, gaps, strict=True)]
    return Placement(at, at - listed, np.array(left).reshape(-1, 3), blind, alone)


def _balanced(listed: FloatArray, pairs: Sequence[tuple[int, int]], gaps: FloatArray) -> FloatArray:
    """Least squares of measured gaps; what no overlap ties stays as listed."""
    count = len(listed)
    rows = np.zeros((len(pairs) + count, count))
    for row, (i, j) in enumerate(pairs):
        rows[row, i], rows[row, j] = -1.0, 1.0
    # A faint pull to the list, full for the first, settles what is left free.
    rows[len(pairs) :] = np.eye(count) * 1e-4
    rows[len(pairs), 0] = 1e3
    wanted = np.concatenate([gaps, rows[len(pairs) :] @ listed])
    return np.asarray(np.linalg.lstsq(rows, wanted)[0], dtype=np.float64)


def _overlaps(first: Array, second: Array, gap: FloatArray) -> bool:
    low, high = _box(first, second, np.round(gap).astype(np.int64))
    return bool((high - low >= _LEAST_OVERLAP).all())


def _box(first: Array, second: Array, gap: IntArray) -> tuple[IntArray, IntArray]:
    """What both hold, in voxels x, y, z of the first."""
    size = np.array(first.shape[::-1])
    other = np.array(second.shape[::-1])
    return np.maximum(0, gap), np.minimum(size, gap + other)


def _measured(first: Array, second: Array, gap: FloatArray, reach: FloatArray) -> FloatArray | None:
    """The gap at which both agree best; None where they show nothing in common.

    Coarse voxels first: each round cuts the overlap anew where the last one put it.
    """
    now = np.round(gap).astype(np.int64)
    fine = now.astype(np.float64)
    for turn in range(_ROUNDS):
        low, high = _box(first, second, now)
        if (high - low < _LEAST_OVERLAP).any():
            return None
        most = _LONGEST if turn else _LONGEST // 2
        bins = np.maximum(1, -(-(high - low) // most))
        if ((high - low) // bins < 2).any():
            return None
        a, b = _cut(first, low, high, bins), _cut(second, low - now, high - now, bins)
        step, quality = _shift(a, b, (gap - now) / bins, reach / bins)
        fine = now + step * bins
        if quality < _LEAST_CORRELATION or (np.abs(fine - gap) > reach + 1).any():
            return None
        again = np.round(fine).astype(np.int64)
        if turn and (again == now).all():
            break
        now = again
    return fine


def _cut(volume: Array, low: IntArray, high: IntArray, bins: IntArray) -> FloatArray:
    """Part of a volume as z, y, x, averaged, and evened out: brightness fades with depth."""
    (bx, by, bz), (nx, ny, nz) = bins, (high - low) // bins
    part = volume[
        low[2] : low[2] + nz * bz, low[1] : low[1] + ny * by, low[0] : low[0] + nx * bx
    ].astype(np.float64)
    mean = part.reshape(nz, bz, ny, by, nx, bx).mean(axis=(1, 3, 5))
    mean = gaussian_filter(mean, 0.7)
    return np.asarray(mean - mean.mean(axis=(1, 2), keepdims=True))


def _shift(
    a: FloatArray, b: FloatArray, listed: FloatArray, reach: FloatArray
) -> tuple[FloatArray, float]:
    """Shift (x, y, z, in cells) that lays b over a, and how well they then agree.

    Normalised cross-correlation by FFT, padded against wrap-around, less a faint pull to where
    the scan is listed; a parabola gives the fraction. The agreement is Pearson's r of what then
    overlaps.
    """
    shape = [2 * n for n in a.shape]
    ones = np.ones(a.shape)
    cross = irfftn(rfftn(a, shape) * np.conj(rfftn(b, shape)), shape)
    power_a = irfftn(rfftn(a * a, shape) * np.conj(rfftn(ones, shape)), shape)
    power_b = irfftn(rfftn(ones, shape) * np.conj(rfftn(b * b, shape)), shape)
    shared = irfftn(rfftn(ones, shape) * np.conj(rfftn(ones, shape)), shape)
    scale = np.sqrt(np.maximum(power_a, 0) * np.maximum(power_b, 0))
    usable = (shared > 0.25 * a.size) & (scale > 1e-9 * max(1e-300, float(scale.max())))
    agreement = np.where(usable, cross / np.where(usable, scale, 1.0), -1.0)
    score = agreement - _SCORE_ERROR * _pull(agreement.shape, listed, reach)
    best = np.unravel_index(int(np.argmax(score)), score.shape)
    step = []
    for axis, at in enumerate(best):
        size = score.shape[axis]
        low, high = (
            float(score[tuple((p + s) % size if k == axis else p for k, p in enumerate(best))])
            for s in (-1, 1)
        )
        bend = low - 2 * float(score[best]) + high
        part = (low - high) / (2 * bend) if bend < 0 and min(low, high) > -1 else 0.0
        step.append((at if at < size // 2 else at - size) + part)
    return np.array(step[::-1]), float(agreement[best])


def _pull(shape: tuple[int, ...], at: FloatArray, reach: FloatArray) -> FloatArray:
    """For every shift (z, y, x) half the squared distance from the list, in halves of the reach."""
    total: FloatArray = np.zeros(shape)
    for axis, size in enumerate(shape):
        off = np.fft.fftfreq(size, 1 / size) - at[2 - axis]
        part = 0.5 * (off / max(1.0, reach[2 - axis] / 2)) ** 2
        total += part.reshape([-1 if k == axis else 1 for k in range(len(shape))])
    return total
