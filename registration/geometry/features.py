"""Datum features as a scan shows them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from registration.alignment import Fit
from registration.errors import DatumError
from registration.geometry.faces import Face
from registration.geometry.filters import cells, open_filter
from registration.geometry.frame import motion
from registration.geometry.lumen import Lumen
from registration.geometry.nested import Rows
from registration.uncertainty import ScanErrors

FloatArray = NDArray[np.float64]

PATCH_MM = 0.5
"""Surface points nearer than this err together."""
MOUTH_DIAMETERS = 2.0
"""Of a vessel that its mouth is told from."""


@dataclass(frozen=True)
class Setting:
    """What all datum features of a scan share.

    Attributes
    ----------
    fit : Fit
        Scan to part, so far.
    errors : ScanErrors
    strains : tuple of (3, 3) float64
        See `frame.strains`.
    """

    fit: Fit
    errors: ScanErrors
    strains: tuple[FloatArray, ...]

    def stretched(self, place: FloatArray) -> list[FloatArray]:
        """Motion (3,) of a place by each stretch."""
        return [strain @ (place - self.fit.centre) for strain in self.strains]


def plane_rows(face: Face, there: Setting) -> Rows:
    """Return what a planar face asks: its least squares plane on the designed one.

    Two tilts, as motion at the face's edge, and the distance.

    Raises
    ------
    DatumError
        When the face isn't planar.
    """
    if face.normal is None:
        raise DatumError(f"{face.name} has no plane; name a planar face")
    normal = face.normal
    points = there.fit.apply(face.scanned)
    u, v = _across(normal)
    reach = face.size_mm / 2
    middle = points.mean(axis=0)
    away = points - middle
    design = np.column_stack([away @ u / reach, away @ v / reach, np.ones(len(points))])
    height = (points - face.point) @ normal
    bread = np.linalg.inv(design.T @ design)
    slope_u, slope_v, distance = bread @ (design.T @ height)
    # A point's height changes by n · (ω × (p - c) + t); the plane's numbers are linear in it.
    arm = middle - there.fit.centre
    at = normal @ motion(arm)
    tilt = [reach * (normal @ (motion(way) - motion(np.zeros(3)))) for way in (u, v)]
    matrix = np.vstack([*tilt, at])
    rest = height - design @ np.array([slope_u, slope_v, distance])
    patch = cells(points, PATCH_MM)
    noise = np.column_stack([np.bincount(patch, rest * column) for column in design.T]) @ bread
    light = float((normal @ (there.fit.rotation @ there.errors.beam)) ** 2)
    level = np.hypot(there.errors.outer_mm, there.errors.faint_mm)
    shared = np.array([[0, 0, level], [0, 0, light * there.errors.facing_mm]])
    strained = [
        [reach * (normal @ s @ u), reach * (normal @ s @ v), normal @ s @ arm]
        for s in there.strains
    ]
    return Rows(
        matrix,
        -np.array([slope_u, slope_v, distance]),
        -np.vstack([noise, shared]),
        -np.array(strained),
    )


def axis_rows(lumen: Lumen, there: Setting) -> Rows:
    """Return what a straight vessel's axis asks: its least squares line on the designed one."""
    first, last = lumen.line.points[0], lumen.line.points[-1]
    way = (last - first) / np.linalg.norm(last - first)
    u, v = _across(way)
    middle = lumen.raw.mean(axis=0)
    along = (lumen.raw - middle) @ way
    reach = lumen.line.length / 2
    design = np.column_stack([along / reach, np.ones(len(along))])
    weights = np.linalg.inv(design.T @ design) @ design.T
    arm = middle - there.fit.centre
    matrix, asked, pulls, strained = [], [], [], []
    for side in (u, v):
        off = weights @ ((lumen.raw - first) @ side)
        turn = reach * (side @ (motion(way) - motion(np.zeros(3))))
        matrix += [turn, side @ motion(arm)]
        asked += [-off[0], -off[1]]
        pulls += [lumen.shared(weights[0]), lumen.shared(weights[1])]
        strained.append([[reach * (side @ s @ way), side @ s @ arm] for s in there.strains])
    beside = _light_across(there, u, v)
    shared = np.array([[0, beside[0], 0, beside[1]]])
    return Rows(
        np.array(matrix), np.array(asked), np.vstack([np.diag(pulls), shared]),
        -np.concatenate([np.array(one) for one in strained], axis=1),
    )  # fmt: skip


@dataclass(frozen=True)
class Mouth:
    """Where a lumen's axis reaches its free end.

    Attributes
    ----------
    node, way : (3,) float64, mm
        As designed: the end of the axis, and the unit way out.
    off : (3,) float64, mm
        Measured less designed, across that way.
    noise_mm : float, mm
        Standard deviation of one coordinate.
    """

    node: FloatArray
    way: FloatArray
    off: FloatArray
    noise_mm: float


def mouth(lumen: Lumen, last: bool) -> Mouth | None:
    """Carry the axis on to a free end; None where no section near it was measured.

    A straight line through the offsets of the sections within two diameters of the end; the
    nearest must lie within one.
    """
    node, way, radius = lumen.line.end(last)
    from_end = lumen.line.length - lumen.along if last else lumen.along
    near = from_end < 2 * radius * MOUTH_DIAMETERS
    if near.sum() < 3 or from_end[near].min() > 2 * radius:
        return None
    off = lumen.raw - lumen.line.nearest(lumen.raw)[0]
    off = off - (off @ way)[:, None] * way
    weights = np.zeros(len(off))
    # Wide weights: a straight line through all of them.
    weights[near] = open_filter(from_end[near], 100.0 * radius, np.zeros(1))[0]
    return Mouth(node, way, weights @ off, lumen.shared(weights))


def mouth_rows(found: Mouth, face: Face | None, there: Setting) -> Rows:
    """Return what a mouth asks: its middle, and where it was seen the face around it."""
    u, v = _across(found.way)
    arm = found.node - there.fit.centre
    light = _light_across(there, u, v)
    matrix = [side @ motion(arm) for side in (u, v)]
    asked = [-(side @ found.off) for side in (u, v)]
    pulls = [[found.noise_mm, 0], [0, found.noise_mm], list(light)]
    strained = [[-(side @ s @ arm) for side in (u, v)] for s in there.strains]
    rows = Rows(np.array(matrix), np.array(asked), np.array(pulls), np.array(strained))
    if face is None or face.normal is None:
        return rows
    plane = plane_rows(face, there)
    # The plane's distance at the mouth, from that at its middle and both tilts.
    reach = face.size_mm / 2
    away = found.node - there.fit.apply(face.scanned).mean(axis=0)
    s, t = (away @ side / reach for side in _across(face.normal))
    here = np.array([s, t, 1.0])
    both = np.zeros((len(rows.pulls) + len(plane.pulls), 3))
    both[: len(rows.pulls), :2] = rows.pulls
    both[len(rows.pulls) :, 2] = plane.pulls @ here
    return Rows(
        np.vstack([rows.matrix, here @ plane.matrix]),
        np.append(rows.asked, here @ plane.asked),
        both,
        np.column_stack([rows.strained, plane.strained @ here]),
    )


def stacked(parts: list[Rows]) -> Rows:
    """Several features as one datum: all together by least squares."""
    width = sum(len(one.asked) for one in parts)
    blocks, at = [], 0
    for one in parts:
        block = np.zeros((len(one.pulls), width))
        block[:, at : at + len(one.asked)] = one.pulls
        blocks.append(block)
        at += len(one.asked)
    return Rows(
        np.vstack([one.matrix for one in parts]),
        np.concatenate([one.asked for one in parts]),
        np.vstack(blocks),
        np.hstack([one.strained for one in parts]),
    )


def light_shift(there: Setting) -> float:
    """Standard uncertainty of a lumen's middle along the light, mm.

    The wall above and the one below it face the light otherwise and may err apart: the middle is
    half of the difference of two errors.
    """
    return float(np.hypot(there.errors.level_mm, there.errors.facing_mm) / np.sqrt(2))


def _light_across(there: Setting, u: FloatArray, v: FloatArray) -> tuple[float, float]:
    beam = there.fit.rotation @ there.errors.beam
    size = light_shift(there)
    return float(size * (beam @ u)), float(size * (beam @ v))


def _across(way: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Two unit vectors across a direction."""
    u = np.cross(way, np.eye(3)[np.abs(way).argmin()])
    u = u / np.linalg.norm(u)
    return u, np.cross(way, u)
