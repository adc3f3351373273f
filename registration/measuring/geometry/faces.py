"""Find a design's plane outer faces and the scanned points of each."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from design.network import VesselNetwork
from kernels.arrays import FloatArray, IntArray
from registration.alignment import Fit
from registration.alignment.distance import ModelSurface
from registration.measuring.gauging.design_to_scan import surface_points
from registration.measuring.gauging.deviation import near_lumen
from registration.segmentation import Segmentation

LEAST_SHARE = 0.01
"""Of the design's surface, below which a plane is no face."""
CURVED = "curved outer face"
Plane = tuple[FloatArray, FloatArray, float]
"""Unit normal, a point, mm, and the root of the area, mm."""


def large_planes(surface: ModelSurface) -> tuple[IntArray, list[Plane]]:
    """Number of the large plane that each triangle lies in, -1 for none; the planes."""
    a, b, c = (surface.triangles[:, k] for k in range(3))
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1) / 2
    normal, middle = surface.normals[:, 0], (a + b + c) / 3
    offset = (normal * middle).sum(axis=1)
    key = np.round(np.column_stack([500 * normal, 200 * offset])).astype(np.int64)
    _, group = np.unique(key, axis=0, return_inverse=True)
    group = group.reshape(-1)
    total = np.bincount(group, area)
    label = np.full(len(area), -1, dtype=np.int64)
    planes: list[Plane] = []
    for g in np.argsort(-total, kind="stable"):
        if total[g] < LEAST_SHARE * area.sum():
            break
        first = int(np.flatnonzero(group == g)[0])
        if label[first] >= 0:
            continue
        # Rounding may have parted a plane: all that lies in it is gathered.
        own = (normal @ normal[first] > 0.9999) & (np.abs(offset - offset[first]) < 0.005)
        point = np.average(middle[own], axis=0, weights=area[own])
        planes.append((normal[first], point, float(np.sqrt(area[own].sum()))))
        label[own] = len(planes) - 1
    return label, planes


def plane_name(plane: Plane | None, planes: Sequence[Plane]) -> str:
    """Say how a face looks; of several that look the same way also where it lies."""
    if plane is None:
        return CURVED
    normal, point, _ = plane
    axis = int(np.abs(normal).argmax())
    if abs(normal[axis]) < np.cos(np.deg2rad(1.0)):
        way = ", ".join(f"{v:.2f}".replace("-", "\N{MINUS SIGN}") for v in normal + 0.0)
        name = f"face ({way})"
    else:
        name = f"face {'+' if normal[axis] > 0 else chr(0x2212)}{'xyz'[axis]}"
    alike = [one for one in planes if one[0] @ normal > 0.9999]
    return name if len(alike) == 1 else f"{name} at {point @ normal:.2f} mm"


POINTS = 60_000
"""Scanned places that are looked at."""
REACH_MM = 0.5
"""Surface farther from its face than this isn't taken for it."""
RIM_BLURS = 3.0
"""So many standard deviations of the blur a face is rounded off beside a sharp edge ..."""
RIM_MM = 0.2
"""... and so far the filter over a face reaches beyond it; the larger is left out."""
SEEN_WITHIN_MM = 0.3
"""A place of the design is seen where the scan has a point of its face this near along it."""
_TURNED = 0.7
"""Cosine between the scanned and the designed face."""


@dataclass(frozen=True)
class Face:
    """One outer face as designed, and the scanned places that belong to it.

    Attributes
    ----------
    name : str
        ``face +x`` where it looks that way within 1 degree; else by its normal.
    normal : (3,) float64 or None
        Unit vector out of the gel; None of the curved ones together.
    point : (3,) float64, mm
        On it.
    size_mm : float, mm
        Root of its area.
    scanned : (k, 3) float64, mm
        Places of the scanned surface, in the scan's frame.
    seen : float
        Share of the face, edges left out, beside which there are such places.
    """

    name: str
    normal: FloatArray | None
    point: FloatArray
    size_mm: float
    scanned: FloatArray
    seen: float


def outer_faces(
    surface: ModelSurface, network: VesselNetwork, segmentation: Segmentation, fit: Fit
) -> tuple[Face, ...]:
    """Return the outer faces, the largest first, with the scanned places nearest to each.

    Parameters
    ----------
    surface : ModelSurface
        Of the construct.
    network : VesselNetwork
        Its lumens' walls aren't outer faces.
    segmentation : Segmentation
    fit : Fit
        Scan to part, the scaled one, so that edges lie on the edges of the print.
    """
    label, planes = large_planes(surface)
    rim = max(RIM_BLURS * segmentation.field.blur_mm, RIM_MM)
    drawn = surface_points(surface)
    drawn = drawn[_outside(drawn, surface, network, rim)]
    shown = _shown(surface, network, segmentation, fit, rim)
    label_drawn, label_shown = label[surface.query(drawn).face], label[shown.face]
    out = []
    for index, plane in [*enumerate(planes), (-1, None)]:
        design, own = drawn[label_drawn == index], label_shown == index
        if len(design) < LEAST_SHARE * max(len(drawn), 1):
            continue
        out.append(_face(plane, planes, design, shown.scanned[own], shown.foot[own]))
    return tuple(out)


@dataclass(frozen=True)
class _Shown:
    """Scanned places (k, 3), mm, scan's frame, feet on the design, and triangles of those (k,)."""

    scanned: FloatArray
    foot: FloatArray
    face: IntArray


def _outside(
    places: FloatArray, surface: ModelSurface, network: VesselNetwork, rim: float
) -> NDArray[np.bool_]:
    """Which places lie off lumens and off edges."""
    return ~near_lumen(places, network) & ~surface.near_rims(places, rim)


def _shown(
    surface: ModelSurface,
    network: VesselNetwork,
    segmentation: Segmentation,
    fit: Fit,
    rim: float,
) -> _Shown:
    """Return what the scan shows of outer faces: near the design, and turned as it is."""
    chosen = np.flatnonzero(segmentation.seen)
    chosen = chosen[:: max(1, len(chosen) // POINTS)]
    places = fit.apply(segmentation.surface.vertices[chosen])
    kept = _outside(places, surface, network, rim)
    chosen, near = chosen[kept], surface.query(places[kept])
    looks = segmentation.outward[chosen] @ fit.rotation.T
    turned = (looks * surface.normals[near.face, 0]).sum(axis=1) > _TURNED
    good = (np.abs(near.distance) < REACH_MM) & turned
    return _Shown(segmentation.surface.vertices[chosen[good]], near.foot[good], near.face[good])


def _face(
    plane: Plane | None,
    planes: list[Plane],
    design: FloatArray,
    scanned: FloatArray,
    feet: FloatArray,
) -> Face:
    name, seen = plane_name(plane, planes), _seen(design, feet)
    if plane is None:
        size = float(np.ptp(design, axis=0).max())
        return Face(name, None, design.mean(axis=0), size, scanned, seen)
    normal, point, size = plane
    return Face(name, normal, point, size, scanned, seen)


def _seen(design: FloatArray, feet: FloatArray) -> float:
    if not len(feet):
        return 0.0
    away, _ = cKDTree(feet).query(design, distance_upper_bound=SEEN_WITHIN_MM)
    return float(np.isfinite(away).mean())
