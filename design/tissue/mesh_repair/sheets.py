"""Remove stray open pieces of a triangle surface that enclose no volume."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from design.geometry.mesh import connected_parts, edges_of
from design.tissue.closed import FaceArray, enclosed_volume, face_areas
from design.tissue.mesh_repair.holes import open_sides
from design.tissue.mesh_repair.limits import LIMITS
from design.tissue.parts import shells_of
from kernels.arrays import FloatArray


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
    near = LIMITS.rounding * float(np.ptp(points, axis=0).max())
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
    rim = open_sides(faces)
    used, number = np.unique(rim, return_inverse=True)
    ends = number.reshape(-1, 2)
    group = connected_parts(ends, len(used))
    middles = np.stack([points[used[group == n]].mean(axis=0) for n in range(group.max() + 1)])
    lids = np.column_stack([rim[:, ::-1], len(points) + group[ends[:, 0]]])
    every = np.concatenate([points, middles])
    volume = enclosed_volume(every, np.concatenate([faces, lids]))
    area = float(face_areas(points, faces).sum())
    lid = float(face_areas(every, lids).sum())
    return bool(
        lid > LIMITS.sheet_lid * area
        or 36.0 * np.pi * volume**2 < LIMITS.sheet_compactness * (area + lid) ** 3
    )
