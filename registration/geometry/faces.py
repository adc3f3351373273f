"""Outer faces of a design, and what a scan shows of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from design.network import VesselNetwork
from registration.alignment import Fit
from registration.distance import ModelSurface
from registration.gauging.back import surface_points
from registration.gauging.near_lumen import near_lumen
from registration.segmentation import Segmentation

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

LEAST_SHARE = 0.01
"""Of the design's surface, below which a plane is no face."""
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
CURVED = "curved outer face"
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
    label, planes = _planes(surface)
    rim = max(RIM_BLURS * segmentation.field.blur_mm, RIM_MM)
    drawn = surface_points(surface)
    drawn = drawn[~near_lumen(drawn, network) & ~surface.near_rims(drawn, rim)]
    chosen = np.flatnonzero(segmentation.seen)
    chosen = chosen[:: max(1, len(chosen) // POINTS)]
    places = fit.apply(segmentation.vertices[chosen])
    kept = ~near_lumen(places, network) & ~surface.near_rims(places, rim)
    chosen, places = chosen[kept], places[kept]
    there, near = surface.query(drawn), surface.query(places)
    looks = segmentation.outward[chosen] @ fit.rotation.T
    normal = surface.normals[near.face, 0]
    good = (np.abs(near.distance) < REACH_MM) & ((looks * normal).sum(axis=1) > _TURNED)
    out = []
    for number, plane in enumerate([*planes, None]):
        index = number if plane is not None else -1
        own = good & (label[near.face] == index)
        design = drawn[label[there.face] == index]
        if len(design) < LEAST_SHARE * max(len(drawn), 1):
            continue
        out.append(
            Face(
                _name(plane, planes),
                None if plane is None else plane[0],
                design.mean(axis=0) if plane is None else plane[1],
                plane[2] if plane is not None else float(np.ptp(design, axis=0).max()),
                segmentation.vertices[chosen[own]],
                _seen(design, near.foot[own]),
            )
        )
    return tuple(out)


def _seen(design: FloatArray, feet: FloatArray) -> float:
    if not len(feet):
        return 0.0
    away, _ = cKDTree(feet).query(design, distance_upper_bound=SEEN_WITHIN_MM)
    return float(np.isfinite(away).mean())


Plane = tuple[FloatArray, FloatArray, float]
"""Unit normal, a point, mm, and the root of the area, mm."""


def _planes(surface: ModelSurface) -> tuple[IntArray, list[Plane]]:
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


def _name(plane: Plane | None, planes: Sequence[Plane]) -> str:
    """Say how a face looks; of several that look the same way also where it lies."""
    if plane is None:
        return CURVED
    normal, point, _ = plane
    axis = int(np.abs(normal).argmax())
    if abs(normal[axis]) < np.cos(np.deg2rad(1.0)):
        way = ", ".join(f"{v:.2f}".replace("-", "\N{MINUS SIGN}") for v in normal + 0.0)
        said = f"face ({way})"
    else:
        said = f"face {'+' if normal[axis] > 0 else chr(0x2212)}{'xyz'[axis]}"
    alike = [one for one in planes if one[0] @ normal > 0.9999]
    return said if len(alike) == 1 else f"{said} at {point @ normal:.2f} mm"
