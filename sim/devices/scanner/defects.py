"""Plant print defects in a simulated deposit before scanning.

Modelled
--------
- Bulge: the lumen's wall stands back by `height_mm` round a place, all round or to one side, with
  a Gaussian profile of standard deviation `length_mm` / 4 along the axis (and of 45 degrees
  around it, where it is one-sided), so that nearly all of it lies within `length_mm`.
- Stenosis: the lumen's radius falls to a share of itself, with the same profile.
- Occlusion: the lumen is full of gel over a stretch with flat ends.
- Missing vessel: it is full of gel along a polyline.
- Leak: a straight round hole with flat ends through the gel.

Edges are drawn with the share of each voxel they cover. In a deposit of sacrificial ink
(`embedded`) the ink is the lumen-to-be, so gel is put there by taking ink away, and the other way
about. Shrinkage belongs to the placing (`Placing.shrink`).

Not modelled
------------
Debris loose in a lumen, collapse under gravity, delamination between layers, ragged edges.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from gcode.deposit.lay import Deposit
from kernels.arrays import FloatArray
from sim.errors import ScannerError

DefectKind = Literal["bulge", "stenosis", "occlusion", "missing", "leak"]

_SIDE = np.pi / 4
"""Standard deviation of a one-sided bulge around the axis, radians."""


@dataclass(frozen=True)
class Defect:
    """One defect, in the deposit's (the printer's) frame.

    Attributes
    ----------
    kind : str
        See the module.
    path : (n, 3) float64, mm
        Bulge, stenosis, occlusion: a stretch of the lumen's axis that holds all of it (the places
        it is applied to, from end to end, its middle at `at_mm`). Missing: the whole axis. Leak:
        the hole's axis, from lumen to where it leads.
    radius_mm : float, mm
        Of the lumen as printed (bulge, stenosis), of what is to be filled (occlusion, missing:
        take more than the lumen), or of the hole (leak).
    at_mm : float, mm
        Along `path`: the middle of a bulge, stenosis or occlusion.
    length_mm : float, mm
        Extent along the axis of a bulge, stenosis or occlusion.
    height_mm : float, mm
        Of a bulge.
    left : float
        Share of the radius that a stenosis leaves in its throat.
    side : (3,) float64 or None
        Direction of a one-sided bulge; None all round.
    """

    kind: DefectKind
    path: FloatArray
    radius_mm: float
    at_mm: float = 0.0
    length_mm: float = 0.0
    height_mm: float = 0.0
    left: float = 0.5
    side: FloatArray | None = None

    def __post_init__(self) -> None:
        if np.ndim(self.path) != 2 or len(self.path) < 2 or not np.isfinite(self.path).all():
            raise ScannerError(f"{self.kind}: path needs two or more places x, y, z in mm")
        if not self.radius_mm > 0:
            raise ScannerError(f"{self.kind}: radius_mm {self.radius_mm:g} mm isn't above 0")
        if self.kind in ("bulge", "stenosis", "occlusion") and not self.length_mm > 0:
            raise ScannerError(f"{self.kind}: length_mm {self.length_mm:g} mm isn't above 0")
        if self.kind == "stenosis" and not 0 <= self.left < 1:
            raise ScannerError(f"stenosis: left {self.left:g} must lie in [0, 1)")


def with_defects(deposit: Deposit, defects: Sequence[Defect]) -> Deposit:
    """The same deposit with defects in it, one after the other.

    Raises
    ------
    ScannerError
        When a defect lies outside the deposit.
    """
    volume = deposit.volume.copy()
    for defect in defects:
        box, places = _surroundings(deposit, defect)
        if defect.kind in ("bulge", "leak"):
            share = _coverage(_free(defect, places), deposit.voxel_mm)
            gel = False
        else:
            share = _coverage(_filled(defect, places), deposit.voxel_mm)
            gel = True
        # Gel is ink in layered writing; in an embedded print the ink is what becomes the lumen.
        ink = gel == (deposit.style == "layered")
        old = volume[box]
        volume[box] = np.maximum(old, share) if ink else np.minimum(old, 255 - share)
    return replace(deposit, volume=volume)


def _surroundings(
    deposit: Deposit, defect: Defect
) -> tuple[tuple[slice, slice, slice], FloatArray]:
    """The box of voxels that a defect can touch, and their places (nz, ny, nx, 3)."""
    around = defect.radius_mm + defect.height_mm + 2 * deposit.voxel_mm
    edge, shape = deposit.voxel_mm, np.array(deposit.volume.shape[::-1])
    path = _near(defect)
    low = np.floor((path.min(axis=0) - around - deposit.origin_mm) / edge).astype(int)
    high = np.ceil((path.max(axis=0) + around - deposit.origin_mm) / edge).astype(int) + 1
    low, high = np.clip(low, 0, shape), np.clip(high, 0, shape)
    if (high <= low).any():
        raise ScannerError(
            f"{defect.kind} at {np.round(path.mean(axis=0), 2).tolist()} mm lies outside the "
            "deposit; give its path in the printer's frame"
        )
    x, y, z = (deposit.origin_mm[k] + edge * np.arange(low[k], high[k]) for k in range(3))
    grid = np.stack(np.meshgrid(z, y, x, indexing="ij")[::-1], axis=-1)
    return (slice(low[2], high[2]), slice(low[1], high[1]), slice(low[0], high[0])), grid


def _near(defect: Defect) -> FloatArray:
    """The part of the path that the defect reaches, as places along it."""
    if defect.length_mm == 0:
        return defect.path
    steps = np.linalg.norm(np.diff(defect.path, axis=0), axis=1)
    upto = np.concatenate([[0.0], np.cumsum(steps)])
    along = defect.at_mm + np.linspace(-1, 1, 41) * defect.length_mm
    return np.stack([np.interp(along, upto, defect.path[:, k]) for k in range(3)], axis=1)


def _on_path(defect: Defect, places: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Of each place: how far along the path its nearest point is, and the way from there to it."""
    best = np.full(places.shape[:-1], np.inf)
    along, off = np.zeros_like(best), np.zeros_like(places)
    begun = 0.0
    last = len(defect.path) - 2
    for number, (a, b) in enumerate(zip(defect.path[:-1], defect.path[1:], strict=True)):
        length = float(np.linalg.norm(b - a))
        t = (places - a) @ (b - a) / length
        # Beyond the path's ends it goes straight on, so that flat ends are flat.
        t = np.clip(t, None if number == 0 else 0.0, None if number == last else length)
        way = places - a - t[..., None] * (b - a) / length
        away = np.linalg.norm(way, axis=-1)
        nearer = away < best
        best = np.where(nearer, away, best)
        along = np.where(nearer, begun + t, along)
        off = np.where(nearer[..., None], way, off)
        begun += length
    return along, off


def _free(defect: Defect, places: FloatArray) -> FloatArray:
    """Distance to where a bulge or leak frees space, negative inside, mm."""
    along, off = _on_path(defect, places)
    away = np.linalg.norm(off, axis=-1)
    if defect.kind == "leak":
        total = float(np.linalg.norm(np.diff(defect.path, axis=0), axis=1).sum())
        return np.asarray(np.maximum(away - defect.radius_mm, np.maximum(-along, along - total)))
    height = defect.height_mm * _profile(defect, along)
    if defect.side is not None:
        side = np.asarray(defect.side) / np.linalg.norm(defect.side)
        cosine = (off @ side) / np.maximum(away, 1e-9)
        height = height * np.exp(-0.5 * (np.arccos(np.clip(cosine, -1, 1)) / _SIDE) ** 2)
    # Without height nothing is freed: the lumen beside the bulge stays as it was printed.
    return np.where(height > 1e-4, away - defect.radius_mm - height, np.inf)


def _filled(defect: Defect, places: FloatArray) -> FloatArray:
    """Distance to where gel is put, negative inside, mm."""
    along, off = _on_path(defect, places)
    away = np.linalg.norm(off, axis=-1)
    if defect.kind == "stenosis":
        throat = defect.radius_mm * (1 - (1 - defect.left) * _profile(defect, along))
        inner = throat - away
        # Up to the printed wall and one voxel's worth beyond.
        return np.maximum(inner, away - 1.15 * defect.radius_mm)
    tube = away - defect.radius_mm
    if defect.kind == "missing":
        return np.asarray(tube)
    half = defect.length_mm / 2
    return np.asarray(np.maximum(tube, np.abs(along - defect.at_mm) - half))


def _profile(defect: Defect, along: FloatArray) -> FloatArray:
    return np.asarray(np.exp(-0.5 * ((along - defect.at_mm) / (defect.length_mm / 4)) ** 2))


def _coverage(distance: FloatArray, voxel: float) -> NDArray[np.uint8]:
    """Share of each voxel on the inner side of a wall at a distance from its centre, 0..255."""
    return np.round(255 * np.clip(0.5 - distance / voxel, 0, 1)).astype(np.uint8)
