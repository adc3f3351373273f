"""Mosaic: place overlapping scans of one sample and fuse them into one volume."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np
import yaml
from scipy.fft import irfftn, rfftn
from scipy.ndimage import gaussian_filter

from firmware_profiles.yaml_file import read_yaml
from kernels.arrays import Float32Array, FloatArray, IntArray
from registration.errors import ScanFileError
from registration.files.readers.common import Array, empty
from registration.files.readers.metadata import ScanOverrides
from registration.files.readers.read import read_scan
from registration.json_ready import is_number
from registration.scan import Scan

Kind = Literal["tiles", "depth", "layers"]
_FEATHER = 0.25
_LEAST = 1e-3
_SNAP = 0.05
"""So near to a whole voxel a scan is put on it: less error than interpolation's blur."""


def fuse(volumes: Sequence[Array], at: FloatArray, kind: Kind, path: Path) -> Float32Array:
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


def _zeros(shape: tuple[int, ...], path: Path) -> Float32Array:
    out: Float32Array = empty(shape, np.dtype(np.float32), path).view(np.float32)
    out[...] = 0
    return out


def _add(
    total: Float32Array, weight: Float32Array, volume: Array, place: FloatArray, kind: Kind
) -> None:
    """Add one scan, depth by depth."""
    whole = np.floor(place).astype(int)
    part = place - whole
    nz, ny, nx = volume.shape
    across = np.outer(_ramp(ny), _ramp(nx)).astype(np.float32)
    along = _along(nz, kind).astype(np.float32)
    y0, x0 = whole[1], whole[2]
    above: Float32Array | None = None
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


def _moved(plane: Float32Array, down: float, right: float) -> Float32Array:
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


_SUFFIXES = (".yaml", ".yml")
_KINDS: tuple[Kind, ...] = ("tiles", "depth", "layers")
_KEYS = ("mosaic", "settle_um", "scans")
_MOST_SCANS = 1000
_MOST_BYTES = 1 << 20


@dataclass(frozen=True)
class _Listed:
    kind: Kind
    settle_mm: float
    files: tuple[Path, ...]
    at_mm: FloatArray


def is_mosaic(path: Path) -> bool:
    """Whether a path is a mosaic's list, by its name."""
    return path.suffix.lower() in _SUFFIXES


def read_mosaic(path: Path, overrides: ScanOverrides | None = None) -> Scan:
    """Read every scan of a list, find how they lie by their overlap, and fuse them.

    The notes say how far scans were moved and by how much pairs still disagree. The result has
    the first scan's voxels and is float32.

    Raises
    ------
    ScanFileError
        When the list or a scan can't be read, their voxels differ, or one overlaps no other.
    """
    listed = _parsed(path)
    scans = [read_scan(file, overrides) for file in listed.files]
    _check_alike(scans)
    voxel = np.array(scans[0].geometric_voxel_mm[::-1])
    placed = settle([scan.volume for scan in scans], listed.at_mm / voxel, listed.settle_mm / voxel)
    if placed.alone:
        raise ScanFileError(
            f"{path}: {listed.files[placed.alone[0]].name} overlaps none of the others; check "
            "at_mm (mm, x, y, z)"
        )
    volume = fuse([scan.volume for scan in scans], placed.at, listed.kind, path)
    return replace(
        scans[0],
        volume=volume,
        came_from=path,
        space=None,
        notes=(*scans[0].notes, _note(placed, voxel, len(scans), listed.kind)),
    )


def listed_files(path: Path) -> tuple[Path, ...]:
    """The scans that a list names.

    Raises
    ------
    ScanFileError
        When the list can't be read.
    """
    return _parsed(path).files


def _note(placed: Placement, voxel: FloatArray, count: int, kind: str) -> str:
    """What the overlaps have shown, for people."""
    text = f"{count} scans fused ({kind}), {len(placed.left)} overlaps"
    if len(placed.left):
        left = 1e3 * np.linalg.norm(placed.left * voxel, axis=1)
        moved = 1e3 * np.linalg.norm(placed.moved * voxel, axis=1)
        text += (
            f"; moved by up to {moved.max():.0f} µm, pairs then disagree by "
            f"{math.sqrt(float(np.mean(left**2))):.1f} µm (RMS), {left.max():.1f} at most"
        )
    if placed.blind:
        text += f"; {placed.blind} overlaps show too little to tell and were left as listed"
    return text


def _parsed(path: Path) -> _Listed:
    if not path.is_file() or path.stat().st_size > _MOST_BYTES:
        raise ScanFileError(f"{path}: no list of scans there; check the path")
    try:
        data = read_yaml(path.read_text(encoding="utf-8"))
    except (yaml.YAMLError, UnicodeDecodeError) as exc:
        raise ScanFileError(f"{path}: not YAML ({exc}); mend it") from exc
    if not isinstance(data, dict) or set(data) - set(_KEYS) or data.get("mosaic") not in _KINDS:
        raise ScanFileError(
            f"{path}: isn't a mosaic's list; it has the keys {', '.join(_KEYS)}, and mosaic is one "
            f"of {', '.join(_KINDS)}"
        )
    scans, settle_um = data.get("scans"), data.get("settle_um", 200)
    if not isinstance(scans, list) or not 2 <= len(scans) <= _MOST_SCANS:
        raise ScanFileError(f"{path}: scans must list 2 to {_MOST_SCANS} scans")
    if not is_number(settle_um) or not 0 <= settle_um <= 5000:
        raise ScanFileError(f"{path}: settle_um is {settle_um!r}; it must lie in 0 to 5000")
    entries = [_entry(item, path) for item in scans]
    places = np.array([at for _, at in entries], dtype=np.float64)
    return _Listed(data["mosaic"], settle_um * 1e-3, tuple(f for f, _ in entries), places)


def _entry(item: Any, path: Path) -> tuple[Path, list[float]]:
    good = isinstance(item, dict) and set(item) == {"file", "at_mm"}
    at = item["at_mm"] if good else None
    if not (good and isinstance(item["file"], str) and isinstance(at, list) and len(at) == 3):
        raise ScanFileError(f"{path}: {item!r} isn't {{file: NAME, at_mm: [x, y, z]}}")
    if not all(is_number(value) and abs(value) <= 1000 for value in at):
        raise ScanFileError(f"{path}: at_mm {at!r} must be three numbers within ± 1000 mm")
    return path.parent / item["file"], [float(value) for value in at]


def _check_alike(scans: list[Scan]) -> None:
    first = scans[0]
    for scan in scans[1:]:
        same = (scan.scale, scan.modality, scan.depth_down, scan.optical_depth) == (
            first.scale, first.modality, first.depth_down, first.optical_depth
        )  # fmt: skip
        if not same or not np.allclose(
            [*scan.voxel_mm, scan.refractive_index], [*first.voxel_mm, first.refractive_index], 1e-3
        ):
            raise ScanFileError(
                f"{scan.came_from}: its voxels of {scan.voxel_mm} mm ({scan.scale}, index "
                f"{scan.refractive_index:g}) aren't those of {first.came_from.name}: "
                f"{first.voxel_mm} mm ({first.scale}, index {first.refractive_index:g}); scan all "
                "parts alike"
            )
