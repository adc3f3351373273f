"""Remove stray open pieces of a triangle surface that enclose no volume."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from design.tissue.closed import FaceArray, edges_of, enclosed_volume, face_areas
from design.tissue.shells import shells_of
from kernels.arrays import FloatArray

_OPEN = 0.6
"""Area that closes an open piece's rims, over its own, above which it is a sheet: 0.95 for a bent
one, 0.5 for half a ball, 0.2 for a box without lid."""

_FULL = 0.002
"""Compactness, 36 π V² / A³ (1 for a ball), below which it is one, too."""


_FLAT_SHARE = 2e-6
"""Height of a face taken for flat, of the mesh's extent: some steps of float32."""


def drop_sheets(points: FloatArray, faces: FaceArray) -> tuple[FaceArray, list[FloatArray], float]:
    """Leave out open pieces that enclose next to nothing, where others are closed.

    Returns
    -------
    faces : (k, 3) int32
    middles : list of (3,) float64
        Of the sheets left out.
    area : float
        Of them all.
    """
    edges = edges_of(faces)
    if not edges.open:
        return faces, [], 0.0
    shell = shells_of(points, faces)
    single = (edges.uses == 1)[edges.of_face].reshape(-1, 3).any(axis=1)
    opened = np.unique(shell[single])
    count = int(shell.max()) + 1
    if len(opened) == count:
        return faces, [], 0.0
    sheets = [n for n in opened if _is_sheet(points, faces[shell == n])]
    out: NDArray[np.bool_] = np.isin(shell, sheets)
    middles = [points[np.unique(faces[shell == n])].mean(axis=0) for n in sheets]
    return faces[~out], middles, float(face_areas(points, faces[out]).sum())


def drop_flat_faces(points: FloatArray, faces: FaceArray) -> tuple[FaceArray, int]:
    """Leave out faces without area whose three edges each have one face too many.

    Others without area stay: they may close a slit between edges that were split differently.
    """
    near = _FLAT_SHARE * float(np.ptp(points, axis=0).max())
    corners = points[faces]
    longest = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(axis=1)
    flat = 2.0 * face_areas(points, faces) <= near * longest
    if not flat.any():
        return faces, 0
    edges = edges_of(faces)
    odd = (edges.uses % 2 == 1)[edges.of_face].reshape(-1, 3).all(axis=1)
    out = flat & odd
    return faces[~out], int(out.sum())


def _is_sheet(points: FloatArray, faces: FaceArray) -> bool:
    """Whether an open piece, each rim closed by a point in its middle, is next to flat."""
    edges = edges_of(faces)
    ways = faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
    rim = ways[edges.uses[edges.of_face] == 1]
    used, number = np.unique(rim, return_inverse=True)
    ends = number.reshape(-1, 2)
    graph = coo_matrix((np.ones(len(ends)), ends.T), shape=(len(used),) * 2)
    count, group = connected_components(graph, directed=False)
    middles = np.stack([points[used[group == n]].mean(axis=0) for n in range(count)])
    lids = np.column_stack([rim[:, ::-1], len(points) + group[ends[:, 0]]])
    every = np.concatenate([points, middles])
    volume = enclosed_volume(every, np.concatenate([faces, lids]))
    area = float(face_areas(points, faces).sum())
    lid = float(face_areas(every, lids).sum())
    return lid > _OPEN * area or 36.0 * np.pi * volume**2 < _FULL * (area + lid) ** 3
