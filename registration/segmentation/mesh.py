"""Extract the surface mesh of segmented gel; flag the reliably seen vertices; drop specks."""

from __future__ import annotations

import numba
import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from design.geometry.surface import Surface
from kernels import pjit
from kernels.arrays import FloatArray
from registration.errors import SegmentationError
from registration.segmentation.bright_liquid import DARK
from registration.segmentation.nets import surface
from registration.segmentation.volume import GelField, Strength, Volume


def surface_mesh(
    field: GelField, strength: Strength | None, speck_mm: float
) -> tuple[Surface, FloatArray, NDArray[np.bool_]]:
    """Surface of a field in the scan's frame; closed surfaces smaller than `speck_mm` dropped.

    Returns
    -------
    surface, outward, seen
        As in `registration.segmentation.Segmentation`.

    Raises
    ------
    SegmentationError
        When there is none.
    """
    position, gradient, faces = surface(field.values, field.level, field.sign)
    if len(faces) == 0:
        raise SegmentationError("no surface between gel and lumen in the volume; check the scan")
    vertices = position * field.voxel_mm + field.origin_mm
    outward = -gradient / field.voxel_mm
    outward /= np.maximum(np.linalg.norm(outward, axis=1, keepdims=True), 1e-30)
    seen = _away_from_edge(position, field)
    if strength is not None:
        seen &= _lit(position, gradient, strength) & _stepped(position, gradient, field)
        if strength.dark >= DARK:
            seen &= _shown_by_light(position, gradient, strength, faces)
    kept = _large_components(vertices, faces, speck_mm)
    if not kept.any():
        raise SegmentationError(
            f"nothing but specks below {speck_mm:g} mm between gel and lumen; check the scan, and "
            "whether lumens are dark or bright in it"
        )
    number = np.cumsum(kept) - 1
    faces = number[faces[kept[faces[:, 0]]]].astype(np.int32)
    return Surface(vertices[kept], faces), outward[kept], seen[kept]


def _away_from_edge(position: FloatArray, field: GelField) -> NDArray[np.bool_]:
    """At least two voxels inside the field of view, beyond which smoothing knows nothing."""
    last = np.array(field.values.shape[::-1]) - 1
    return np.asarray(((position >= 2) & (position <= last - 2)).all(axis=1))


LIT = 4.0
"""Of the noise: the gel beside a surface sends back more, averaged over `LIT_VOXELS`."""
LIT_VOXELS = 2
STEP = 0.4
"""Of the step from liquid to gel: from one side of a wall to the other there is more. A surface
within gel that fades slowly below half its level, in a corner's dark, shows a quarter."""


def _lit(position: FloatArray, gradient: FloatArray, strength: Strength) -> NDArray[np.bool_]:
    """Where the gel beside the surface sends back more than the noise.

    Averaged over neighbours within the gel: a single voxel of speckle or noise says nothing.
    """
    least = LIT * strength.noise * (2 * LIT_VOXELS + 1) ** 3
    return _beside(position, gradient, strength.signal, 1) > least


def _stepped(position: FloatArray, gradient: FloatArray, field: GelField) -> NDArray[np.bool_]:
    """Where gel and liquid beside the surface differ as the two sides of a wall do.

    An OCT's field has liquid at 0 and gel at 1 (`oct_field`).
    """
    gel, liquid = (_beside(position, gradient, field.values, side) for side in (1, -1))
    return np.asarray(gel - liquid > STEP * (2 * LIT_VOXELS + 1) ** 3)


ROUNDS = 32
"""Of averages over neighbours on the surface: some 3 voxels along it, to quieten speckle."""


def _shown_by_light(
    position: FloatArray, gradient: FloatArray, strength: Strength, faces: NDArray[np.int32]
) -> NDArray[np.bool_]:
    """Where more light comes back from the gel's side, as of a wall under one light.

    Liquid nearly as bright as gel, under light that gel above has not taken, is as bright as gel or
    brighter. Its border then lies where the model has its light change, which no step confirms:
    between gel and liquid under the same light lies (1 - dark) of what gel sends back.
    """
    gel, liquid = (_beside(position, gradient, strength.signal, side) for side in (1, -1))
    floor = strength.noise * (2 * LIT_VOXELS + 1) ** 3
    n = len(position)
    pairs = np.concatenate([faces[:, :2], faces[:, 1:], faces[:, ::2]])
    ones = np.ones(2 * len(pairs))
    ends = np.concatenate([pairs, pairs[:, ::-1]]).T
    around = coo_matrix((ones, (ends[0], ends[1])), shape=(n, n)).tocsr()
    count = np.maximum(around @ np.ones(n), 1.0)
    for _ in range(ROUNDS):
        gel, liquid = ((one + around @ one / count) / 2 for one in (gel, liquid))
    return np.asarray(gel - liquid > STEP * (1 - strength.dark) * (gel + floor))


@pjit
def _beside(position: FloatArray, gradient: FloatArray, values: Volume, side: int) -> FloatArray:
    """Sum over a cube of voxels beside each vertex; `side` 1 is the gel's, -1 the liquid's."""
    nz, ny, nx = values.shape
    away = side * (1 + LIT_VOXELS)
    out = np.empty(len(position))
    for i in numba.prange(len(position)):
        x = position[i, 0] + away * gradient[i, 0]
        y = position[i, 1] + away * gradient[i, 1]
        z = position[i, 2] + away * gradient[i, 2]
        total = 0.0
        for dz in range(-LIT_VOXELS, LIT_VOXELS + 1):
            k = min(max(int(np.rint(z + dz)), 0), nz - 1)
            for dy in range(-LIT_VOXELS, LIT_VOXELS + 1):
                j = min(max(int(np.rint(y + dy)), 0), ny - 1)
                for dx in range(-LIT_VOXELS, LIT_VOXELS + 1):
                    total += values[k, j, min(max(int(np.rint(x + dx)), 0), nx - 1)]
        out[i] = total
    return out


def _large_components(
    vertices: FloatArray, faces: NDArray[np.int32], speck_mm: float
) -> NDArray[np.bool_]:
    """Vertices whose connected surface has a box diagonal of at least `speck_mm`."""
    n = len(vertices)
    pairs = np.concatenate([faces[:, :2], faces[:, 1:]])
    ones = np.ones(len(pairs), dtype=np.int8)
    _, label = connected_components(coo_matrix((ones, (pairs[:, 0], pairs[:, 1])), shape=(n, n)))
    order = np.argsort(label, kind="stable")
    first = np.flatnonzero(np.concatenate([[True], np.diff(label[order]) > 0]))
    low = np.minimum.reduceat(vertices[order], first, axis=0)
    high = np.maximum.reduceat(vertices[order], first, axis=0)
    return np.asarray(np.linalg.norm(high - low, axis=1)[label] >= speck_mm)
