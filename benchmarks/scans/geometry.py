"""Signed distances to lumens and body along the A-scans of a B-scan.

Distances are those of the cross-section: from the axis, less the radius there; exact where a vessel
is straight and of even width, and zero on its wall always.
"""

from __future__ import annotations

import math

import numba as nb
import numpy as np

FAR = 9.0
STEP_MM = 0.01
ROUGH_WITHIN_MM = 0.15
"""Of a lumen's wall: farther from it nothing is rough."""
SLOPE_MM = 0.002
"""Over so short a way the slopes of rough walls are taken."""


@nb.njit(cache=True)
def wall(p, pieces, k, radius, plugs, out):
    """Distance (mm) from p to the wall of piece k; its gradient goes to out[:3]."""
    ax, ay, az = pieces[k, 0], pieces[k, 1], pieces[k, 2]
    ex, ey, ez = pieces[k, 3] - ax, pieces[k, 4] - ay, pieces[k, 5] - az
    squared = ex * ex + ey * ey + ez * ez
    beyond = ((p[0] - ax) * ex + (p[1] - ay) * ey + (p[2] - az) * ez) / squared
    t = min(max(beyond, 0.0), 1.0)
    dx, dy, dz = p[0] - ax - t * ex, p[1] - ay - t * ey, p[2] - az - t * ez
    gap = math.sqrt(dx * dx + dy * dy + dz * dz) + 1e-9
    along = pieces[k, 6] + t * (pieces[k, 7] - pieces[k, 6])
    row = int(pieces[k, 8])
    place = max(along, 0.0) / STEP_MM
    i = min(int(place), radius.shape[1] - 2)
    r = radius[row, i] + min(place - i, 1.0) * (radius[row, i + 1] - radius[row, i])
    distance = gap - r
    out[0], out[1], out[2] = dx / gap, dy / gap, dz / gap
    # A piece's rounded end reaches into a plug of the next piece: its own length goes on there.
    going_on = pieces[k, 6] + beyond * (pieces[k, 7] - pieces[k, 6])
    for q in range(len(plugs)):
        if int(plugs[q, 0]) == row:
            inside = plugs[q, 2] - abs(going_on - plugs[q, 1])
            if inside > distance:
                distance = inside
                side = 1.0 if going_on < plugs[q, 1] else -1.0
                length = math.sqrt(squared)
                out[0], out[1], out[2] = side * ex / length, side * ey / length, side * ez / length
    return distance


@nb.njit(cache=True)
def lattice(i, j, k, seed):
    """Return a number in -1 to 1 for a lattice point."""
    h = (i * 73856093) ^ (j * 19349663) ^ (k * 83492791) ^ (seed * 2654435761)
    h = (h ^ (h >> 13)) * 1274126177
    h = (h ^ (h >> 16)) & 0xFFFFFF
    return h / 8388607.5 - 1.0


@nb.njit(cache=True)
def grain(p, cell, seed):
    """Return smooth noise of about unit rms with features of `cell` mm."""
    x, y, z = p[0] / cell, p[1] / cell, p[2] / cell
    i, j, k = math.floor(x), math.floor(y), math.floor(z)
    u, v, w = x - i, y - j, z - k
    u, v, w = u * u * (3 - 2 * u), v * v * (3 - 2 * v), w * w * (3 - 2 * w)
    total = 0.0
    for a in range(2):
        for b in range(2):
            for c in range(2):
                share = (u if a else 1 - u) * (v if b else 1 - v) * (w if c else 1 - w)
                total += share * lattice(int(i) + a, int(j) + b, int(k) + c, seed)
    return 2.7 * total


@nb.njit(cache=True)
def outside(p, planes, cylinder, out):
    """Distance (mm) from p outwards beyond the body; its gradient goes to out[:3]."""
    best = -FAR
    for q in range(len(planes)):
        d = planes[q, 0] * p[0] + planes[q, 1] * p[1] + planes[q, 2] * p[2] - planes[q, 3]
        if d > best:
            best = d
            out[0], out[1], out[2] = planes[q, 0], planes[q, 1], planes[q, 2]
    if cylinder[2] < 1e5:
        x, y = p[0] - cylinder[0], p[1] - cylinder[1]
        gap = math.sqrt(x * x + y * y) + 1e-9
        if gap - cylinder[2] > best:
            best = gap - cylinder[2]
            out[0], out[1], out[2] = x / gap, y / gap, 0.0
    return best


@nb.njit(cache=True)
def bscan(y, nx, pitch, nz, dz, to_part, boxes, shape, lumens, rough, seed, field):
    """Fill field (2, 3, nx, nz) with distances and lateral gradients: lumen, then body.

    shape: planes, cylinder; lumens: pieces, radius, plugs; rough: amplitude of walls (mm), cell
    (mm); boxes (n, 6): low and high x, y, z of each piece in the scan, mm.
    """
    planes, cylinder = shape
    pieces, radius, plugs = lumens
    p, q, g = np.zeros(3), np.zeros(3), np.zeros(3)
    m = to_part
    field[0, 0] = FAR
    field[0, 1:] = 0.0
    for i in range(nx):
        for k in range(nz):
            for a in range(3):
                p[a] = m[a, 0] * i * pitch + m[a, 1] * y + m[a, 2] * k * dz + m[a, 3]
            d = outside(p, planes, cylinder, g)
            field[1, 1, i, k] = g[0] * m[0, 0] + g[1] * m[1, 0] + g[2] * m[2, 0]
            field[1, 2, i, k] = g[0] * m[0, 1] + g[1] * m[1, 1] + g[2] * m[2, 1]
            if rough[0] > 0 and abs(d) < 0.15:
                rise = 0.7 * rough[0] * grain(p, rough[1], seed)
                d += rise
                for a in range(2):
                    for b in range(3):
                        q[b] = p[b] + SLOPE_MM * m[b, a]
                    beside = 0.7 * rough[0] * grain(q, rough[1], seed)
                    field[1, 1 + a, i, k] += (beside - rise) / SLOPE_MM
            field[1, 0, i, k] = d
    for c in range(len(pieces)):
        if y < boxes[c, 1] or y > boxes[c, 4]:
            continue
        for i in range(max(int(boxes[c, 0] / pitch), 0), min(int(boxes[c, 3] / pitch) + 2, nx)):
            for k in range(max(int(boxes[c, 2] / dz), 0), min(int(boxes[c, 5] / dz) + 2, nz)):
                for a in range(3):
                    p[a] = m[a, 0] * i * pitch + m[a, 1] * y + m[a, 2] * k * dz + m[a, 3]
                d = wall(p, pieces, c, radius, plugs, g)
                if d < field[0, 0, i, k] and d < 0.2:
                    field[0, 0, i, k] = d
                    field[0, 1, i, k] = g[0] * m[0, 0] + g[1] * m[1, 0] + g[2] * m[2, 0]
                    field[0, 2, i, k] = g[0] * m[0, 1] + g[1] * m[1, 1] + g[2] * m[2, 1]
    if rough[0] > 0:
        roughen(y, nx, pitch, nz, dz, m, rough, seed, field)


@nb.njit(cache=True)
def roughness(p, rough, seed):
    """By how much (mm) noise and the ridges of 50 um layers move a lumen's wall into it at p."""
    ridge = math.sin(2 * math.pi * p[2] / 0.05)
    return rough[0] * (0.9 * grain(p, rough[1], seed + 7) + 0.6 * ridge)


@nb.njit(cache=True)
def roughen(y, nx, pitch, nz, dz, m, rough, seed, field):
    """Move the lumens' walls by noise and by the ridges of 50 um layers."""
    p, q = np.zeros(3), np.zeros(3)
    for i in range(nx):
        for k in range(nz):
            if abs(field[0, 0, i, k]) < ROUGH_WITHIN_MM:
                for a in range(3):
                    p[a] = m[a, 0] * i * pitch + m[a, 1] * y + m[a, 2] * k * dz + m[a, 3]
                rise = roughness(p, rough, seed)
                field[0, 0, i, k] += rise
                for a in range(2):
                    for b in range(3):
                        q[b] = p[b] + SLOPE_MM * m[b, a]
                    field[0, 1 + a, i, k] += (roughness(q, rough, seed) - rise) / SLOPE_MM
