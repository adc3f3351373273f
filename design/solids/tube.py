"""Sweep a polyline with radii to a closed triangle mesh, mitred at bends."""

from __future__ import annotations

from itertools import pairwise
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from design.geometry.polyline import vectors_across
from design.solids.facets import area_factor, dome_profile
from kernels.arrays import FloatArray

FaceArray = NDArray[np.int64]
EndShape = Literal["flat", "round"]


def tube_mesh(
    points: FloatArray, radius: FloatArray, facets: int, ends: tuple[EndShape, EndShape]
) -> tuple[FloatArray, FaceArray]:
    """Mesh of a tube through ``points``.

    Cross-sections are regular polygons of the circle's area. Rings at inner points lie in the
    plane that halves the bend, so both neighbouring pieces keep their cross-section up to it.

    Parameters
    ----------
    points : (k, 3) float64, mm
        Axis; no two neighbours equal, no bend of 180°.
    radius : (k,) float64, mm
        At each point, linear between.
    facets : int
        Sides of the polygon.
    ends : pair of "flat" or "round"
        Disc or half ball beyond the first and last point.

    Returns
    -------
    vertices : (n, 3) float64, mm
    faces : (m, 3) int64
        Outward.
    """
    direction = np.diff(points, axis=0)
    direction /= np.linalg.norm(direction, axis=1)[:, None]
    unit = unit_rings(direction, facets)
    # Each ring as seen from the piece that follows it (the last: from the piece before).
    rings = points[:, None] + area_factor(facets) * radius[:, None, None] * unit
    head, head_apex = _cap(ends[0], points[0], -direction[0], radius[0], rings[0], facets)
    tail, tail_apex = _cap(ends[1], points[-1], direction[-1], radius[-1], rings[-1], facets)
    stack = np.concatenate([head[::-1], rings, tail])
    vertices = np.concatenate([stack.reshape(-1, 3), [head_apex, tail_apex]])
    return vertices, _faces(len(stack), facets)


def straight_tubes(
    points: FloatArray, radius: FloatArray, facets: int, ends: tuple[EndShape, EndShape]
) -> tuple[FloatArray, FaceArray]:
    """Meshes of many tubes of one piece, alike but for place, length and radius.

    A grown tree has thousands: made one by one by `tube_mesh`, they take twenty times as long.

    Parameters
    ----------
    points : (n, 2, 3) float64, mm
    radius : (n, 2) float64, mm
    facets, ends
        As `tube_mesh`, the same for all.

    Returns
    -------
    vertices : (n, v, 3) float64, mm
    faces : (m, 3) int64
        Of each tube, by its own vertices' numbers.
    """
    direction = points[:, 1] - points[:, 0]
    direction /= np.linalg.norm(direction, axis=1)[:, None]
    first, second = vectors_across(direction)
    angle = 2.0 * np.pi * np.arange(facets)[:, None] / facets
    across = np.cos(angle) * first[:, None] + np.sin(angle) * second[:, None]
    rings = points[:, :, None] + area_factor(facets) * radius[:, :, None, None] * across[:, None]
    head, head_apex = _cap(ends[0], points[:, 0], -direction, radius[:, 0], rings[:, 0], facets)
    tail, tail_apex = _cap(ends[1], points[:, 1], direction, radius[:, 1], rings[:, 1], facets)
    stack = np.concatenate([head[:, ::-1], rings, tail], axis=1)
    apexes = np.stack([head_apex, tail_apex], axis=1)
    vertices = np.concatenate([stack.reshape(len(points), -1, 3), apexes], axis=1)
    return vertices, _faces(stack.shape[1], facets)


def unit_rings(direction: FloatArray, facets: int) -> FloatArray:
    """Vectors from the axis to each ring's vertices for radius 1, (k + 1, facets, 3).

    At a bend the frame is carried on by reflection in the bisecting plane: it leaves the ring's
    vertices, which lie in that plane, where they are, and twists nothing.
    """
    angle = 2.0 * np.pi * np.arange(facets) / facets
    along = np.empty((len(direction) + 1, facets, 3))
    first, second = vectors_across(direction[0])
    across = np.cos(angle)[:, None] * first + np.sin(angle)[:, None] * second
    along[0] = across
    for bend, (before, after) in enumerate(pairwise(direction), 1):
        normal = before + after
        normal /= np.linalg.norm(normal)
        lean = across @ normal
        along[bend] = across - np.outer(lean / (before @ normal), before)
        across = across - 2.0 * np.outer(lean, normal)
    along[-1] = across
    return along


def _cap(
    shape: EndShape,
    centre: FloatArray,
    outward: FloatArray,
    radius: FloatArray,
    rim: FloatArray,
    facets: int,
) -> tuple[FloatArray, FloatArray]:
    """Further rings beyond ``rim`` (..., j, facets, 3), and the apex (..., 3)."""
    if shape == "flat":
        return np.empty((*centre.shape[:-1], 0, facets, 3)), centre
    across, along = dome_profile(facets)
    steps = np.asarray(radius)[..., None, None] * along[:, None] * outward[..., None, :]
    middle = centre[..., None, None, :]
    flat = middle + across[:-1, None, None] * (rim[..., None, :, :] - middle)
    return flat + steps[..., :-1, None, :], centre + steps[..., -1, :]


def _faces(rings: int, facets: int) -> FaceArray:
    """Side quads halved, and a fan to either apex (the last two vertices)."""
    here = np.arange(facets)
    following = (here + 1) % facets
    base = facets * np.arange(rings - 1)[:, None]
    a, b = base + here, base + following
    c, d = a + facets, b + facets
    sides = np.stack([np.stack([a, b, d], -1), np.stack([a, d, c], -1)]).reshape(-1, 3)
    head, tail = rings * facets, rings * facets + 1
    top = (rings - 1) * facets
    head_fan = np.stack([following, here, np.full(facets, head)], -1)
    tail_fan = np.stack([top + here, top + following, np.full(facets, tail)], -1)
    return np.concatenate([sides, head_fan, tail_fan])
