"""Voxels of the hollow that a solid shuts in.

A voxel is shut in where at least `SHUT_IN` of the 13 lines through it that lead to its 26
neighbours meet the solid on both sides. A groove has about 5, a notch 3, space outside a part none.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product
from typing import Final

import numpy as np
from manifold3d import Manifold
from scipy import ndimage

from kernels.arrays import BoolArray, FloatArray

SHUT_IN: Final = 11
SHUT_IN_AT_MOUTH: Final = 3
MOUTH_RADII: Final = 2.0
ALL_NEIGHBOURS: Final = np.ones((3, 3, 3), dtype=np.bool_)


@dataclass(frozen=True, eq=False)
class Hollow:
    """Hollow of a solid on a grid of voxels, (nx, ny, nz).

    Attributes
    ----------
    inside : BoolArray
        Voxels of the hollow.
    wall : float32 array
        Distance to the nearest solid, voxels.
    is_closed : BoolArray
        Voxels of the hollow that no way leads to from outside.
    origin : (3,) float64, mm
        Middle of the first voxel.
    pitch : float, mm
    """

    inside: BoolArray
    wall: FloatArray
    is_closed: BoolArray
    origin: FloatArray
    pitch: float


def hollow_voxels(body: Manifold, pitch: float, *, is_lumen: bool) -> Hollow:
    """Return the hollow of a solid; with `is_lumen`, the solid itself is the hollow."""
    box = np.array(body.bounding_box())
    low = box[:3] - 2.0 * pitch  # no middle of a voxel on a face
    shape = tuple(np.ceil((box[3:] - low) / pitch + 1.6).astype(int).tolist())
    filled = _filled(body, low, pitch, shape)
    free = filled if is_lumen else ~filled
    wall = ndimage.distance_transform_edt(free).astype(np.float32)
    inside = filled if is_lumen else _shut_in(filled, wall)
    label, _ = ndimage.label(free)
    closed = free if is_lumen else inside & (label != label[0, 0, 0])
    return Hollow(inside, wall, closed, low + pitch / 2, pitch)


def _filled(body: Manifold, low: FloatArray, pitch: float, shape: tuple[int, ...]) -> BoolArray:
    """Voxels whose middle lies in the solid, by rays along z."""
    turns = np.zeros(shape, dtype=np.bool_)
    top = float(low[2] + pitch * shape[2])
    for i, j in np.ndindex(shape[:2]):
        x, y = (low[:2] + pitch * (np.array([i, j]) + 0.5)).tolist()
        for hit in body.ray_cast((x, y, float(low[2])), (x, y, top)):
            turns[i, j, int(np.ceil((hit.position[2] - low[2]) / pitch - 0.5))] ^= True
    return np.asarray(np.logical_xor.accumulate(turns, axis=2))


def _shut_in(filled: BoolArray, wall: FloatArray) -> BoolArray:
    """Free voxels in hollows that are shut in all round, out to where they open."""
    count = np.zeros(filled.shape, dtype=np.uint8)
    for way in product((-1, 0, 1), repeat=3):
        if way > (0, 0, 0):
            count += _behind(filled, way) & _behind(filled, tuple(-d for d in way))
    core = ~filled & (count >= SHUT_IN)
    if not core.any():
        return core
    # Within about a width of its mouth a lumen is shut in less, and by its walls first.
    wall = np.where(core, wall, 0.0)
    size = 2 * int(np.ceil(np.percentile(wall[core], 90))) + 1
    away, nearest = ndimage.distance_transform_edt(~core, return_indices=True)
    reach = MOUTH_RADII * ndimage.maximum_filter(wall, size)[tuple(nearest)]
    near = ~filled & (count >= SHUT_IN_AT_MOUTH) & (away <= reach)
    label, _ = ndimage.label(near)
    return np.asarray(near & np.isin(label, np.unique(label[core & near])))


def _behind(filled: BoolArray, way: tuple[int, ...]) -> BoolArray:
    """Whether there is solid anywhere behind each voxel, against `way`."""
    axis = next(k for k in range(3) if way[k])
    out = np.moveaxis(filled.copy(), axis, 0)
    others = [way[k] for k in range(3) if k != axis]
    here, before = zip(*(_shifted(d) for d in others), strict=True)
    order = range(1, len(out)) if way[axis] > 0 else range(len(out) - 2, -1, -1)
    for k in order:
        out[k][here] |= out[k - way[axis]][before]
    return np.moveaxis(out, 0, axis)


def _shifted(d: int) -> tuple[slice, slice]:
    """Where a plane's voxels are that have a neighbour at ``-d``, and where those neighbours."""
    if d == 0:
        return slice(None), slice(None)
    return (slice(1, None), slice(None, -1)) if d > 0 else (slice(None, -1), slice(1, None))
