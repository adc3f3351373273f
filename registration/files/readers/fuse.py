"""Blend scans of known position into one volume."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from kernels.arrays import FloatArray
from registration.files.readers.raw_result import Array
from registration.files.readers.storage import empty

FloatVolume = NDArray[np.float32]
Kind = Literal["tiles", "depth", "layers"]

_FEATHER = 0.25
_LEAST = 1e-3
_SNAP = 0.05
"""So near to a whole voxel a scan is put on it: less error than interpolation's blur."""


def fuse(volumes: Sequence[Array], at: FloatArray, kind: Kind, path: Path) -> FloatVolume:
    """Blend scans by weights that fall towards their edges.

    Weights are a ramp over a quarter of the width along x and y; along z they are even for tiles,
    a ramp at both ends for depth mosaics (each is sharpest in its middle), and fall from the top
    down for layers (the layer just printed is seen best). Between voxels values are interpolated
    linearly. Places that nothing covers hold the least value.

    Parameters
    ----------
    volumes : sequence of (nz, ny, nx)
        Grey values, blended as they are (in dB where they are dB).
    at : (n, 3) float64, voxels
        Of each one's first voxel, x, y, z.
    kind : "tiles", "depth" or "layers"
    path : Path
        For messages.

    Raises
    ------
    ScanFileError
        When the whole would be larger than any scan.
    """
    places = at[:, ::-1] - at[0, ::-1]
    whole = np.round(places)
    places = np.where(np.abs(places - whole) < _SNAP, whole, places)
    low = np.floor(places.min(axis=0))
    ends = [p + np.array(v.shape) for p, v in zip(places, volumes, strict=True)]
    shape = tuple(int(n) for n in np.ceil(np.max(ends, axis=0) - low))
    total, weight = _zeros(shape, path), _zeros(shape, path)
    least = min(float(volume.min()) for volume in volumes)
    for volume, place in zip(volumes, places, strict=True):
        _add(total, weight, volume, place - low, kind)
    for z in range(shape[0]):
        seen = weight[z] > 0
        total[z] = np.where(seen, total[z] / np.where(seen, weight[z], 1), np.float32(least))
    return total


def _zeros(shape: tuple[int, ...], path: Path) -> FloatVolume:
    out: FloatVolume = empty(shape, np.dtype(np.float32), path).view(np.float32)
    out[...] = 0
    return out


def _add(
    total: FloatVolume, weight: FloatVolume, volume: Array, place: FloatArray, kind: Kind
) -> None:
    """Add one scan, depth by depth."""
    whole = np.floor(place).astype(int)
    part = place - whole
    nz, ny, nx = volume.shape
    across = np.outer(_ramp(ny), _ramp(nx)).astype(np.float32)
    along = _along(nz, kind).astype(np.float32)
    y0, x0 = whole[1], whole[2]
    above: FloatVolume | None = None
    for z in range(nz):
        here = _moved(volume[z].astype(np.float32), part[1], part[2])
        value = here
        if part[0] and above is not None:
            # Output depth z lies between the input's z - 1 and z.
            value = np.float32(part[0]) * above + np.float32(1 - part[0]) * here
        above = here
        own = across * along[z]
        where = (whole[0] + z, slice(y0, y0 + ny), slice(x0, x0 + nx))
        total[where] += own * value
        weight[where] += own


def _moved(plane: FloatVolume, down: float, right: float) -> FloatVolume:
    """A plane moved by parts of a voxel; the first row and column stay as they are."""
    out = plane
    if down:
        out = out.copy()
        out[1:] = np.float32(1 - down) * plane[1:] + np.float32(down) * plane[:-1]
    if right:
        moved = out.copy()
        moved[:, 1:] = np.float32(1 - right) * out[:, 1:] + np.float32(right) * out[:, :-1]
        out = moved
    return out


def _ramp(count: int) -> FloatArray:
    """1 in the middle, falling linearly over a quarter of the width at either end."""
    to_edge = np.minimum(np.arange(count), np.arange(count)[::-1]) + 1.0
    return np.asarray(np.clip(to_edge / max(1.0, _FEATHER * count), _LEAST, 1.0))


def _along(count: int, kind: Kind) -> FloatArray:
    if kind == "depth":
        return _ramp(count)
    if kind == "layers":
        return np.asarray(np.maximum(_LEAST, (1 - np.arange(count) / count) ** 4))
    return np.ones(count)
