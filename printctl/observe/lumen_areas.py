"""Sections of a network's lumens at the height of a layer: areas where no ink may be."""

from __future__ import annotations

from typing import Final

import numpy as np
from shapely import MultiPoint, Polygon, unary_union
from shapely.geometry.base import BaseGeometry

from design.geometry.polyline import arc_lengths, places_along
from design.network import VesselNetwork
from kernels.arrays import FloatArray
from registration.inspection import Lumen

_STEP: Final = 0.25
"""Distance of the spheres that a tube is made of, in radii."""
_ROUND: Final = 24
"""Corners of a circle."""


def lumens_at(network: VesselNetwork, z_mm: float, least_mm: float) -> tuple[Lumen, ...]:
    """Return the sections of all vessels at one height; narrower ones than ``least_mm`` left out.

    Parameters
    ----------
    network : VesselNetwork
        In the printer's frame.
    z_mm : float, mm
        Middle of the layer.
    least_mm : float, mm
    """
    lumens = []
    for vessel, (points, radius) in enumerate(network.polylines()):
        near = np.abs(points[:, 2] - z_mm) - radius
        if near.min() > np.ptp(points[:, 2]):
            continue
        middle, half = _discs(points, radius, z_mm)
        for area, width in _areas(middle, half):
            if width >= least_mm:
                outline = np.asarray(area.exterior.coords)[:-1]
                level = np.full((len(outline), 1), z_mm)
                lumens.append(Lumen(str(vessel), np.hstack([outline, level]), width))
    return tuple(lumens)


def _discs(points: FloatArray, radius: FloatArray, z_mm: float) -> tuple[FloatArray, FloatArray]:
    """Centres (k, 2) and radii of the spheres' sections along a polyline; 0 where they miss."""
    way = arc_lengths(points)
    count = max(int(np.ceil(way[-1] / (_STEP * float(radius.min())))) + 1, 2)
    at = np.linspace(0.0, way[-1], count)
    place = places_along(points, way, at)
    wide = np.interp(at, way, radius)
    half = np.sqrt(np.maximum(wide**2 - (place[:, 2] - z_mm) ** 2, 0.0))
    return place[:, :2], half


def _areas(middle: FloatArray, half: FloatArray) -> list[tuple[Polygon, float]]:
    """Connected areas of the discs that there are, each with its typical width."""
    inside = half > 0
    edges = np.flatnonzero(np.diff(np.concatenate([[False], inside, [False]]).astype(np.int8)))
    areas = []
    for first, last in edges.reshape(-1, 2).tolist():
        area = _swept(middle[first:last], half[first:last])
        width = 2.0 * float(np.median(half[first:last]))
        areas += [(part, width) for part in _polygons(area)]
    return areas


def _swept(middle: FloatArray, half: FloatArray) -> BaseGeometry:
    angle = np.linspace(0.0, 2 * np.pi, _ROUND, endpoint=False)
    round_unit = np.column_stack([np.cos(angle), np.sin(angle)])
    rims = middle[:, None, :] + half[:, None, None] * round_unit
    pairs = [rims[:1]] if len(rims) == 1 else list(np.stack([rims[:-1], rims[1:]], axis=1))
    return unary_union([MultiPoint(one.reshape(-1, 2)).convex_hull for one in pairs])


def _polygons(area: BaseGeometry) -> list[Polygon]:
    parts = getattr(area, "geoms", [area])
    return [part for part in parts if isinstance(part, Polygon) and not part.is_empty]
