"""Simplify a surface to a limited number of triangles, for display on a web page.

Vertices that share a cell of a cubic grid become one (Rossignac & Borrel 1993, "Multi-resolution
3D approximations for rendering complex scenes", doi 10.1007/978-3-642-78114-8_29). A vertex moves
by less than the cell's diagonal. Good for pictures; no number of the report is taken from it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from design.geometry.surface import Surface
from report.surface import ReportSurface

_MOST_KEYED = 2_000_000
"""Vertices of which three numbers fit into one of 64 bits: several times as fast to sort."""


@dataclass(frozen=True)
class DisplaySurface:
    """A surface for display.

    Attributes
    ----------
    surface : Surface
    scalar : (n,) float64 or None
        Mean of the merged vertices' finite values.
    cell_mm : float, mm
        Edge of the grid's cells; 0 when the surface was small enough as it came.
    """

    surface: Surface
    scalar: NDArray[np.float64] | None
    cell_mm: float


def simplify(surface: ReportSurface, max_faces: int) -> DisplaySurface:
    """Cluster vertices until at most ``max_faces`` triangles are left.

    Parameters
    ----------
    surface : ReportSurface
    max_faces : int
        At least 1.

    Returns
    -------
    DisplaySurface
        The surface itself when it is small enough. Parts thinner than a cell vanish, so a limit
        of some tens of triangles may leave none.
    """
    vertices = np.asarray(surface.surface.vertices, dtype=np.float64)
    faces = np.asarray(surface.surface.faces, dtype=np.int64)
    scalar = None if surface.scalar is None else np.asarray(surface.scalar, dtype=np.float64)
    if len(faces) <= max_faces:
        return DisplaySurface(Surface(vertices, faces), scalar, 0.0)
    cell = first_cell(vertices, faces, max_faces)
    while True:
        cluster, count = cluster_vertices(vertices, cell)
        kept = whole_faces(cluster[faces])
        if len(kept) <= max_faces:
            kept = distinct_faces(kept)
            merged = Surface(mean_per_cluster(vertices, cluster, count), kept)
            value = None if scalar is None else mean_per_cluster(scalar[:, None], cluster, count)
            return DisplaySurface(merged, None if value is None else value[:, 0], cell)
        # Triangles go with 1 / cell²; the margin makes the last step a sure one.
        cell *= 1.03 * float(np.sqrt(len(kept) / max_faces))


def first_cell(vertices: NDArray[np.float64], faces: NDArray[np.int64], max_faces: int) -> float:
    """Cell whose grid would cover the surface in about ``max_faces`` triangles, mm."""
    every = max(1, len(faces) // 50_000)
    a, b, c = (vertices[faces[::every, k]] for k in range(3))
    area = 0.5 * every * float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum())
    reach = float(np.ptp(vertices, axis=0).max())
    # A surface without area can't be sized by it; a fraction of its extent starts the search.
    return float(np.sqrt(2.0 * area / max_faces)) or max(reach, 1e-6) / 1000.0


def cluster_vertices(
    vertices: NDArray[np.float64], cell_mm: float
) -> tuple[NDArray[np.int64], int]:
    """Number of the occupied grid cell of each vertex, (n,), and how many there are."""
    place = np.floor((vertices - vertices.min(axis=0)) / cell_mm).astype(np.int64)
    shape = place.max(axis=0) + 1
    key = (place[:, 0] * shape[1] + place[:, 1]) * shape[2] + place[:, 2]
    occupied, cluster = np.unique(key, return_inverse=True)
    return cluster.astype(np.int64), len(occupied)


def whole_faces(faces: NDArray[np.int64]) -> NDArray[np.int64]:
    """Faces with three different corners."""
    a, b, c = faces.T
    return faces[(a != b) & (b != c) & (c != a)]


def distinct_faces(faces: NDArray[np.int64]) -> NDArray[np.int64]:
    """Each face once, in its first place and orientation; corners begin at the lowest number."""
    turned = np.argmin(faces, axis=1)[:, None]
    same_start = np.take_along_axis(faces, (turned + np.arange(3)) % 3, axis=1)
    count = int(faces.max(initial=0)) + 1
    if count > _MOST_KEYED:
        _, first = np.unique(same_start, axis=0, return_index=True)
    else:
        a, b, c = same_start.T
        _, first = np.unique((a * count + b) * count + c, return_index=True)
    return same_start[np.sort(first)]


def mean_per_cluster(
    values: NDArray[np.floating[Any]], cluster: NDArray[np.int64], count: int
) -> NDArray[np.float64]:
    """Mean of each column of ``values`` (n, k) over each cluster's finite entries, (count, k)."""
    result = np.full((count, values.shape[1]), np.nan)
    for k in range(values.shape[1]):
        ok = np.isfinite(values[:, k])
        total = np.bincount(cluster[ok], weights=values[ok, k], minlength=count)
        number = np.bincount(cluster[ok], minlength=count)
        np.divide(total, number, out=result[:, k], where=number > 0)
    return result
