"""Offset a scanned lumen's surface to the vessel diameters that registration measured."""

from __future__ import annotations

from typing import Final

import numpy as np
from manifold3d import Manifold
from scipy.spatial import cKDTree

from design.geometry.polyline import arc_lengths, vectors_across
from design.hemodynamics.probes import clear_parts
from design.hemodynamics.three_d.mesh import manifold_arrays
from design.hemodynamics.three_d.surface import axis_places, corner_normals
from design.network import VesselNetwork
from design.solids.manifolds import to_manifold
from kernels.arrays import FloatArray

_APART: Final = 0.25
_SECTIONS: Final = 5
"""Of a vessel."""

_LEAST_CLEAR: Final = 0.3
"""Share of a vessel that is clear of junctions, from which on it is cut."""

_NEAR: Final = 0.3
"""Radii off the measured wall beyond which a section isn't the vessel's own."""


def set_out(lumen: Manifold, network: VesselNetwork) -> Manifold:
    """The lumen with its wall where registration measured it.

    A field blurred by a standard deviation σ has its surface σ²/2r inwards of the wall;
    registration's diameters have that undone, and say how large σ² is.
    """
    squared = blur_squared(lumen, network)
    points, faces = manifold_arrays(lumen)
    axis, apart, _ = axis_places(network, _APART)
    radius = apart[cKDTree(axis).query(points, workers=1)[1]] / _APART
    normals, at_faces = np.zeros_like(points), corner_normals(points, faces)
    for k in range(3):
        np.add.at(normals, faces[:, k], at_faces[:, k])
    normals /= np.maximum(np.linalg.norm(normals, axis=1), 1e-300)[:, None]
    moved = points + (squared / (2.0 * radius))[:, None] * normals
    return to_manifold(moved, faces, "the scanned lumen")


def blur_squared(lumen: Manifold, network: VesselNetwork) -> float:
    """σ² by which sections of equal area fall short of the measured radii, mm²; 0 if none is clear.

    The median over all sections; below 0 where the surface is wider than the wall.
    """
    variances = []
    for vessel in range(network.vessel_count):
        first, last = clear_parts(network)[vessel]
        if last - first < _LEAST_CLEAR:
            continue
        way, radii = network.polyline(vessel)
        path = arc_lengths(way)
        for at in np.linspace(first, last, _SECTIONS) * path[-1]:
            piece = min(int(np.searchsorted(path, at, side="right")) - 1, len(path) - 2)
            step = way[piece + 1] - way[piece]
            place = way[piece] + (at - path[piece]) * step / np.linalg.norm(step)
            radius = float(np.interp(at, path, radii))
            seen = _section_radius(lumen, place, step / np.linalg.norm(step))
            if abs(seen / radius - 1.0) < _NEAR:
                variances.append(2.0 * radius * (radius - seen))
    return float(np.median(variances)) if variances else 0.0


def facing(lumen: Manifold, place: FloatArray, way: FloatArray) -> tuple[Manifold, FloatArray]:
    """The lumen seen from a place along the unit vector ``way``, and the (3, 4) that takes back."""
    turn = np.column_stack([*vectors_across(way), way])
    return lumen.transform(np.column_stack([turn.T, -turn.T @ place])), np.column_stack(
        [turn, place]
    )


def _section_radius(lumen: Manifold, place: FloatArray, way: FloatArray) -> float:
    """Of the circle as large as the section around a place, mm; 0 where there is none."""
    here, _ = facing(lumen, place, way)
    areas = []
    for part in here.slice(0.0).decompose():
        low_x, low_y, high_x, high_y = part.bounds()
        if low_x < 0.0 < high_x and low_y < 0.0 < high_y:
            areas.append(part.area())
    return float(np.sqrt(min(areas) / np.pi)) if areas else 0.0
