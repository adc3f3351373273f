"""Remesh a closed surface with even triangles of a locally prescribed size."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from design.errors import SolidError
from design.geometry.surface import Surface
from design.solids.remesh import passes
from design.solids.remesh.halfedges import leaving, twins_of
from kernels.arrays import FloatArray, IntArray

_SPLITS = 30
"""Passes of splitting at most in one round."""


@dataclass(frozen=True)
class LabelledSurface(Surface):
    """A closed triangle surface whose faces are told apart.

    Attributes
    ----------
    vertices : (n, 3) float64, mm
    faces : (f, 3) int64
        Outward by the right hand.
    label : (f,) int64
        Faces of one label make a smooth patch; patches meet in rims, which remeshing keeps.
    """

    faces: IntArray
    label: IntArray


class Shape(Protocol):
    """What a surface is to follow."""

    def size(self, points: FloatArray) -> FloatArray:
        """Wanted edge length at each point, (n,), mm."""
        ...

    def onto(self, points: FloatArray, patch: IntArray) -> FloatArray:
        """Points (n, 3) moved onto the shape.

        ``patch`` (n,) is the label of the patch that a point lies in; -1 - label on a rim, with
        the larger of the labels that meet there.
        """
        ...


def remesh(
    surface: LabelledSurface, shape: Shape, rounds: int = 10, growth: float = 0.4
) -> LabelledSurface:
    """Remake a surface of nearly equilateral triangles that follow ``shape``.

    Parameters
    ----------
    surface : LabelledSurface
        Near enough to the shape for `Shape.onto` to find its way, and joined up like it.
    shape : Shape
    rounds : int
        Of splitting, drawing in, turning and relaxing.
    growth : float
        Of the wanted edge length, per mm along the surface at most.

    Returns
    -------
    LabelledSurface
        Of the same number of handles and the same rims.

    Raises
    ------
    SolidError
        When the surface isn't closed, or a wanted length isn't above 0.
    """
    for _ in range(rounds):
        surface = _turned(_drawn_in(_split(surface, shape, growth), shape, growth))
        surface = _relaxed(surface, shape)
    return surface


def patches(surface: LabelledSurface) -> IntArray:
    """The patch of each vertex, as `Shape.onto` takes it, (n,)."""
    low = np.full(len(surface.vertices), np.iinfo(np.int64).max)
    high = np.full(len(surface.vertices), -1)
    for corner in surface.faces.T:
        np.minimum.at(low, corner, surface.label)
        np.maximum.at(high, corner, surface.label)
    return np.where(low == high, low, -1 - high)


def _wanted(surface: LabelledSurface, shape: Shape, growth: float) -> FloatArray:
    wanted = np.ascontiguousarray(shape.size(surface.vertices), dtype=np.float64)
    if not (np.isfinite(wanted).all() and (wanted > 0.0).all()):
        bad = int(np.flatnonzero(~(np.isfinite(wanted) & (wanted > 0.0)))[0])
        x, y, z = surface.vertices[bad]
        raise SolidError(
            f"the wanted edge length at {x:.4g}, {y:.4g}, {z:.4g} mm is {wanted[bad]:g} mm; the "
            "surface must lie near its shape, and lengths be above 0"
        )
    passes.level(surface.vertices, surface.faces, wanted, growth)
    return wanted


def _split(surface: LabelledSurface, shape: Shape, growth: float) -> LabelledSurface:
    for _ in range(_SPLITS):
        n, f = len(surface.vertices), len(surface.faces)
        wanted = _wanted(surface, shape, growth)
        # For each edge once; halves that are still too long come in the next pass.
        points, room = np.zeros((n + 3 * f // 2, 3)), f + 3 * f
        faces, label = np.zeros((room, 3), np.int64), np.zeros(room, np.int64)
        twin, sizes = np.zeros(3 * room, np.int64), np.zeros(len(points))
        points[:n], sizes[:n], faces[:f] = surface.vertices, wanted, surface.faces
        label[:f], twin[: 3 * f] = surface.label, twins_of(surface.faces)
        n2, f2 = passes.split_long(points, sizes, faces, label, twin, n, f)
        surface = LabelledSurface(points[:n2].copy(), faces[:f2].copy(), label[:f2].copy())
        if f2 == f:
            break
    return surface


def _drawn_in(surface: LabelledSurface, shape: Shape, growth: float) -> LabelledSurface:
    faces, count = surface.faces.copy(), len(surface.vertices)
    twin, out = twins_of(faces), leaving(faces, count)
    rim, dead = np.zeros(count, np.int64), np.zeros(len(faces), np.int64)
    passes.rims(faces, twin, surface.label, rim)
    wanted = _wanted(surface, shape, growth)
    passes.draw_in_short(surface.vertices, wanted, faces, surface.label, twin, out, rim, dead)
    return _packed(surface.vertices, faces[dead == 0], surface.label[dead == 0])


def _packed(points: FloatArray, faces: IntArray, label: IntArray) -> LabelledSurface:
    used, place = np.unique(faces, return_inverse=True)
    return LabelledSurface(points[used], place.reshape(-1, 3).astype(np.int64), label)


def _turned(surface: LabelledSurface) -> LabelledSurface:
    faces = surface.faces.copy()
    twin, out = twins_of(faces), leaving(faces, len(surface.vertices))
    for _ in range(3):
        if passes.turn(surface.vertices, faces, surface.label, twin, out) == 0:
            break
    return LabelledSurface(surface.vertices, faces, surface.label)


def _relaxed(surface: LabelledSurface, shape: Shape) -> LabelledSurface:
    count = len(surface.vertices)
    twin, out = twins_of(surface.faces), leaving(surface.faces, count)
    rim, moved = np.zeros(count, np.int64), np.empty((count, 3))
    passes.rims(surface.faces, twin, surface.label, rim)
    passes.relax(surface.vertices, surface.faces, surface.label, twin, out, rim, moved)
    points = shape.onto(moved, patches(surface))
    return LabelledSurface(np.ascontiguousarray(points), surface.faces, surface.label)
