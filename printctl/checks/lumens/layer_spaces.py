"""Compiled: pixels of a layer, their runs, and the spaces that runs make.

A layer is seen in pixels whose middles a disc of the leak's width could stand on without touching
a line. Pixels in a row that are alike are a run; runs that touch, within a layer or from layer to
layer, are one space.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from gcode.deposit.kernels import band_span, pixels_between, stadium_span
from kernels import jit
from kernels.arrays import FloatArray, IntArray
from printctl.checks.lumens.width_kernels import clearance, polygon_edges

Pixels = NDArray[np.int32]
TISSUE: Final = -1
"""Group of a run outside every designed lumen."""


@jit
def _paint_stadium(
    x0: float,
    y0: float,
    x1: float,
    y1: float,
    half: float,
    left: float,
    bottom: float,
    pixel: float,
    value: int,
    out: Pixels,
) -> None:
    """Set the pixels whose middles are in a stadium."""
    ny, nx = out.shape
    j0, j1 = pixels_between(min(y0, y1) - half, max(y0, y1) + half, bottom, pixel, ny)
    y_low, y_high = min(y0, y1), max(y0, y1)
    for j in range(j0, j1 + 1):
        y = bottom + j * pixel
        # Most rows by far: those beside an upright line of an infill.
        low, high = x0 - half, x0 + half
        if x0 != x1 or y < y_low or y > y_high:
            low, high = stadium_span(0.0, y, 1.0, 0.0, x0, y0, x1, y1, half)
        if low > high:
            continue
        i0, i1 = pixels_between(low, high, left, pixel, nx)
        for i in range(i0, i1 + 1):
            out[j, i] = value


@jit
def block_lines(
    line: FloatArray, wider: float, left: float, bottom: float, pixel: float, out: Pixels
) -> None:
    """Set -1 where a line (ends, half width), ``wider`` all round, covers a pixel's middle."""
    for n in range(len(line)):
        x0, y0, x1, y1, half = line[n]
        _paint_stadium(x0, y0, x1, y1, half + wider, left, bottom, pixel, -1, out)


@jit
def _beyond(piece: FloatArray, x: float, y: float, z: float) -> float:
    """Distance from a point to a tapered piece's surface (x0 to z1, r0, r1); negative inside."""
    lx, ly, lz = piece[3] - piece[0], piece[4] - piece[1], piece[5] - piece[2]
    px, py, pz = x - piece[0], y - piece[1], z - piece[2]
    square = lx * lx + ly * ly + lz * lz
    t = (px * lx + py * ly + pz * lz) / square if square > 0.0 else 0.0
    t = min(1.0, max(0.0, t))
    ex, ey, ez = px - t * lx, py - t * ly, pz - t * lz
    radius = piece[6] + t * (piece[7] - piece[6])
    return np.sqrt(ex * ex + ey * ey + ez * ez) - radius


@jit
def label_pieces(
    piece: FloatArray,
    chosen: IntArray,
    z: float,
    margin: float,
    left: float,
    bottom: float,
    pixel: float,
    out: Pixels,
) -> None:
    """Put 1 + the nearest piece's number into open pixels within ``margin`` of its lumen at z."""
    ny, nx = out.shape
    for n in chosen:
        p = piece[n]
        reach = max(p[6], p[7]) + margin
        # Only this part of the axis comes near the layer.
        t0, t1 = band_span(p[2], p[5] - p[2], z - reach, z + reach)
        t0, t1 = max(0.0, t0), min(1.0, t1)
        if t0 > t1:
            continue
        xa, xb = p[0] + t0 * (p[3] - p[0]), p[0] + t1 * (p[3] - p[0])
        ya, yb = p[1] + t0 * (p[4] - p[1]), p[1] + t1 * (p[4] - p[1])
        i0, i1 = pixels_between(min(xa, xb) - reach, max(xa, xb) + reach, left, pixel, nx)
        j0, j1 = pixels_between(min(ya, yb) - reach, max(ya, yb) + reach, bottom, pixel, ny)
        for j in range(j0, j1 + 1):
            y = bottom + j * pixel
            for i in range(i0, i1 + 1):
                if out[j, i] < 0:
                    continue
                x = left + i * pixel
                away = _beyond(p, x, y, z)
                if away > margin:
                    continue
                if out[j, i] == 0 or away < _beyond(piece[out[j, i] - 1], x, y, z):
                    out[j, i] = n + 1


@jit
def label_ring(
    ring: FloatArray,
    number: int,
    margin: float,
    left: float,
    bottom: float,
    pixel: float,
    out: Pixels,
) -> None:
    """Put 1 + ``number`` into open pixels in a closed ring (k, 2) or within ``margin`` of it."""
    ny, nx = out.shape
    x, y = ring[:, 0], ring[:, 1]
    i0, i1 = pixels_between(x.min() - margin, x.max() + margin, left, pixel, nx)
    j0, j1 = pixels_between(y.min() - margin, y.max() + margin, bottom, pixel, ny)
    edge = polygon_edges(ring)
    for j in range(j0, j1 + 1):
        for i in range(i0, i1 + 1):
            if out[j, i] == 0:
                away = -clearance(edge, left + i * pixel, bottom + j * pixel)
                if away <= margin:
                    out[j, i] = number + 1


@jit
def find_runs(pixels: Pixels, group_of: IntArray) -> Pixels:
    """Runs of open pixels of one group: row, first and last column, group; (n, 4).

    ``pixels`` holds -1 where a line is, 0 in tissue, else 1 + a number whose group ``group_of``
    gives.
    """
    ny, nx = pixels.shape
    runs = np.empty((256, 4), dtype=np.int32)
    used = 0
    for j in range(ny):
        i = 0
        while i < nx:
            if pixels[j, i] < 0:
                i += 1
                continue
            group = TISSUE if pixels[j, i] == 0 else group_of[pixels[j, i] - 1]
            first = i
            while i < nx and pixels[j, i] >= 0:
                here = TISSUE if pixels[j, i] == 0 else group_of[pixels[j, i] - 1]
                if here != group:
                    break
                i += 1
            if used == len(runs):
                more = np.empty((2 * used, 4), dtype=np.int32)
                more[:used] = runs
                runs = more
            runs[used] = j, first, i - 1, group
            used += 1
    return runs[:used].copy()


@jit
def _root(parent: IntArray, k: int) -> int:
    while parent[k] != k:
        parent[k] = parent[parent[k]]
        k = parent[k]
    return k


@jit
def _meet(run: Pixels, parent: IntArray, a: int, b: int, touch: IntArray, used: int) -> int:
    """Unite two touching runs of tissue, or note that different groups touch there."""
    if run[a, 3] == run[b, 3]:
        ra, rb = _root(parent, a), _root(parent, b)
        if ra != rb:
            parent[max(ra, rb)] = min(ra, rb)
        return used
    if used < len(touch):
        touch[used, 0], touch[used, 1] = a, b
    return used + 1


@jit
def join_runs(run: Pixels, first: IntArray, parent: IntArray, touch: IntArray) -> int:
    """Unite touching runs of equal group; note touching ones of different groups.

    Parameters
    ----------
    run : (n, 4) int32
        Of all layers, each sorted by row and column.
    first : (layers + 1,) int64
        Where each layer's begin.
    parent : (n,) int64
        Begins as its own index; ends as a forest whose roots name the spaces.
    touch : (m, 2) int64
        Filled with pairs of runs, as far as it reaches.

    Returns
    -------
    int
        How many pairs there are.
    """
    used = 0
    for k in range(len(first) - 1):
        # In a row, next to each other.
        for a in range(first[k], first[k + 1] - 1):
            if run[a, 0] == run[a + 1, 0] and run[a, 2] + 1 == run[a + 1, 1]:
                used = _meet(run, parent, a, a + 1, touch, used)
        # With the row below, and with the same row of the layer below.
        for back in range(2):
            if back == 1 and k == 0:
                continue
            b = first[k - back]
            end = first[k - back + 1]
            for a in range(first[k], first[k + 1]):
                row = run[a, 0] - (1 - back)
                while b < end and (run[b, 0] < row or (run[b, 0] == row and run[b, 2] < run[a, 1])):
                    b += 1
                c = b
                while c < end and run[c, 0] == row and run[c, 1] <= run[a, 2]:
                    used = _meet(run, parent, a, c, touch, used)
                    c += 1
    for k in range(len(parent)):
        parent[k] = _root(parent, k)
    return used
