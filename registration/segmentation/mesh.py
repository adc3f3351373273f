"""Extract the surface mesh of segmented gel by surface nets; drop specks."""

from __future__ import annotations

import math

import numba
import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from design.geometry.surface import Surface
from kernels import jit, pjit
from kernels.arrays import FloatArray, IntArray
from registration.errors import SegmentationError
from registration.segmentation.lighting.bright_liquid import DARK
from registration.segmentation.volume import GelField, Strength, Volume

# One vertex a cell that the surface passes, one quad (two triangles) a grid edge that it crosses
# (after Gibson 1998, 10.1007/BFb0056277). Each vertex starts at the mean of its cell's crossings
# and moves along the gradient onto the trilinear surface, so that it is as exact as the volume.
Rows = NDArray[np.int8]


def surface(
    values: Volume, level: float, sign: float
) -> tuple[FloatArray, FloatArray, NDArray[np.int32]]:
    """Vertices in voxels (n, 3) as x, y, z; unit gradients (n, 3) in voxels; faces (m, 3).

    ``sign * value > level`` is inside; faces are counter-clockwise seen from outside (where
    x, y, z is right-handed). The gradient points inside.
    """
    rows = _row_states(values, sign * level, sign)
    cells, quads = _count(values, sign * level, sign, rows)
    cell_start = np.concatenate([[0], np.cumsum(cells)])
    quad_start = np.concatenate([[0], np.cumsum(quads)])
    return _fill(values, sign * level, sign, rows, cell_start, quad_start)


@jit
def _in(value: float, level: float, sign: float) -> bool:
    """Inside or not; the one place that decides it, also where a whole number equals the level."""
    return sign * (float(value) - level) > 0.0


@pjit
def _row_states(values: Volume, level: float, sign: float) -> Rows:
    """Of each row along x: 0 all outside, 1 all inside, 2 mixed."""
    nz, ny, nx = values.shape
    out = np.empty((nz, ny), dtype=np.int8)
    for z in numba.prange(nz):
        for y in range(ny):
            inside = 0
            for x in range(nx):
                inside += _in(values[z, y, x], level, sign)
            out[z, y] = 0 if inside == 0 else (1 if inside == nx else 2)
    return out


@jit
def _quiet(rows: Rows, z: int, y: int) -> bool:
    """Whether the cells and edges that begin on a row are uncrossed, all of them.

    Most of a large scan is; this look saves the eight corners of every cell.
    """
    nz, ny = rows.shape
    up, ahead = min(z + 1, nz - 1), min(y + 1, ny - 1)
    state = rows[z, y]
    return bool(
        state < 2 and rows[z, ahead] == state and rows[up, y] == state and rows[up, ahead] == state
    )


@jit
def _mixed(values: Volume, level: float, sign: float, z: int, y: int, x: int) -> bool:
    first = _in(values[z, y, x], level, sign)
    return bool(
        first != _in(values[z, y, x + 1], level, sign)
        or first != _in(values[z, y + 1, x], level, sign)
        or first != _in(values[z, y + 1, x + 1], level, sign)
        or first != _in(values[z + 1, y, x], level, sign)
        or first != _in(values[z + 1, y, x + 1], level, sign)
        or first != _in(values[z + 1, y + 1, x], level, sign)
        or first != _in(values[z + 1, y + 1, x + 1], level, sign)
    )


@jit
def _crossings(
    values: Volume, level: float, sign: float, z: int, y: int, x: int
) -> tuple[bool, bool, bool]:
    """Whether the edges along x, y and z from a grid point are crossed *and* get a quad."""
    nz, ny, nx = values.shape
    here = _in(values[z, y, x], level, sign)
    inner_y, inner_z, inner_x = 0 < y < ny - 1, 0 < z < nz - 1, 0 < x < nx - 1
    along_x = inner_y and inner_z and x < nx - 1 and here != _in(values[z, y, x + 1], level, sign)
    along_y = inner_x and inner_z and y < ny - 1 and here != _in(values[z, y + 1, x], level, sign)
    along_z = inner_x and inner_y and z < nz - 1 and here != _in(values[z + 1, y, x], level, sign)
    return along_x, along_y, along_z


@pjit
def _count(values: Volume, level: float, sign: float, rows: Rows) -> tuple[IntArray, IntArray]:
    nz, ny, nx = values.shape
    cells = np.zeros(nz, dtype=np.int64)
    quads = np.zeros(nz, dtype=np.int64)
    for z in numba.prange(nz):
        mixed, crossed = 0, 0
        for y in range(ny):
            if _quiet(rows, int(np.int64(z)), y):
                continue
            for x in range(nx):
                if z < nz - 1 and y < ny - 1 and x < nx - 1:
                    mixed += _mixed(values, level, sign, z, y, x)
                a, b, c = _crossings(values, level, sign, z, y, x)
                crossed += int(a) + int(b) + int(c)
        cells[z], quads[z] = mixed, crossed
    return cells, quads


@jit
def _vertex(
    values: Volume, level: float, sign: float, z: int, y: int, x: int
) -> tuple[float, float, float, float, float, float]:
    """Position within the volume and unit gradient of a cell's vertex."""
    f = np.empty((2, 2, 2))
    for k in range(2):
        for j in range(2):
            for i in range(2):
                f[k, j, i] = sign * (float(values[z + k, y + j, x + i]) - level)
    sx, sy, sz, count = 0.0, 0.0, 0.0, 0
    for p in range(2):
        for q in range(2):
            if (f[p, q, 0] > 0) != (f[p, q, 1] > 0):
                sx += f[p, q, 0] / (f[p, q, 0] - f[p, q, 1])
                sy, sz, count = sy + q, sz + p, count + 1
            if (f[p, 0, q] > 0) != (f[p, 1, q] > 0):
                sy += f[p, 0, q] / (f[p, 0, q] - f[p, 1, q])
                sx, sz, count = sx + q, sz + p, count + 1
            if (f[0, p, q] > 0) != (f[1, p, q] > 0):
                sz += f[0, p, q] / (f[0, p, q] - f[1, p, q])
                sx, sy, count = sx + q, sy + p, count + 1
    u, v, w = sx / count, sy / count, sz / count
    gx, gy, gz = 0.0, 0.0, 0.0
    for _ in range(2):
        value, gx, gy, gz = 0.0, 0.0, 0.0, 0.0
        for k in range(2):
            c = w if k else 1 - w
            for j in range(2):
                b = v if j else 1 - v
                for i in range(2):
                    a = u if i else 1 - u
                    value += a * b * c * f[k, j, i]
                    gx += (1 if i else -1) * b * c * f[k, j, i]
                    gy += a * (1 if j else -1) * c * f[k, j, i]
                    gz += a * b * (1 if k else -1) * f[k, j, i]
        squared = gx * gx + gy * gy + gz * gz
        if squared > 0.0:
            # Held in the cell: a saddle's tiny gradient would throw the vertex away.
            u = min(1.0, max(0.0, u - value * gx / squared))
            v = min(1.0, max(0.0, v - value * gy / squared))
            w = min(1.0, max(0.0, w - value * gz / squared))
    norm = math.sqrt(gx * gx + gy * gy + gz * gz)
    scale = 1.0 / norm if norm > 0.0 else 0.0
    return x + u, y + v, z + w, gx * scale, gy * scale, gz * scale


@jit
def _number(
    values: Volume, level: float, sign: float, rows: Rows, z: int, first: int
) -> NDArray[np.int32]:
    """Vertex numbers of the mixed cells of layer `z`, counted from `first`; -1 elsewhere."""
    _, ny, nx = values.shape
    out = np.full((ny - 1, nx - 1), -1, dtype=np.int32)
    for y in range(ny - 1):
        if _quiet(rows, z, y):
            continue
        for x in range(nx - 1):
            if _mixed(values, level, sign, z, y, x):
                out[y, x] = first
                first += 1
    return out


@pjit
def _fill(
    values: Volume,
    level: float,
    sign: float,
    rows: Rows,
    cell_start: IntArray,
    quad_start: IntArray,
) -> tuple[FloatArray, FloatArray, NDArray[np.int32]]:
    """Vertices, gradients and faces; each layer knows where its own go."""
    nz, ny, nx = values.shape
    vertices = np.empty((cell_start[-1], 3))
    gradients = np.empty((cell_start[-1], 3))
    faces = np.empty((2 * quad_start[-1], 3), dtype=np.int32)
    for z in numba.prange(nz):
        if quad_start[z + 1] == quad_start[z] and cell_start[z + 1] == cell_start[z]:
            continue
        # The outermost grid planes cross no edge that needs the layer missing there.
        layer = int(np.int64(z))  # numba's own index is unsigned
        lower, upper = max(layer - 1, 0), min(layer, nz - 2)
        below = _number(values, level, sign, rows, lower, cell_start[lower])
        here = _number(values, level, sign, rows, upper, cell_start[upper])
        if z < nz - 1:
            for y in range(ny - 1):
                if _quiet(rows, layer, y):
                    continue
                for x in range(nx - 1):
                    n = here[y, x]
                    if n >= 0:
                        a, b, c, d, e, f = _vertex(values, level, sign, z, y, x)
                        vertices[n, 0], vertices[n, 1], vertices[n, 2] = a, b, c
                        gradients[n, 0], gradients[n, 1], gradients[n, 2] = d, e, f
        t = 2 * quad_start[z]
        for y in range(ny):
            if _quiet(rows, layer, y):
                continue
            for x in range(nx):
                along_x, along_y, along_z = _crossings(values, level, sign, z, y, x)
                inside = _in(values[z, y, x], level, sign)
                if along_x:
                    t = _quad(
                        faces,
                        t,
                        inside,
                        below[y - 1, x],
                        below[y, x],
                        here[y, x],
                        here[y - 1, x],
                    )
                if along_y:
                    t = _quad(
                        faces,
                        t,
                        inside,
                        below[y, x - 1],
                        here[y, x - 1],
                        here[y, x],
                        below[y, x],
                    )
                if along_z:
                    t = _quad(
                        faces,
                        t,
                        inside,
                        here[y - 1, x - 1],
                        here[y - 1, x],
                        here[y, x],
                        here[y, x - 1],
                    )
    return vertices, gradients, faces


@jit
def _quad(faces: NDArray[np.int32], t: int, inside: bool, a: int, b: int, c: int, d: int) -> int:
    """Write a quad as two triangles, turned so that it faces away from the inside."""
    if not inside:
        b, d = d, b
    faces[t, 0], faces[t, 1], faces[t, 2] = a, b, c
    faces[t + 1, 0], faces[t + 1, 1], faces[t + 1, 2] = a, c, d
    return t + 2


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
            "whether lumens are brighter than the gel in it (--filled; scan.filled in a recipe)"
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
