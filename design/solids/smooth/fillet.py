"""Signed distance and ray exits of a junction's vessels rounded by a rolling-ball fillet.

Rounding is a morphological closing: of the space outside all vessels, whatever a ball of the
fillet's radius ρ can't reach is filled. Where two vessels go on in one line the ball reaches the
wall everywhere and nothing bulges, which sums of distances (smooth minima) can't say.

A point x is outside the closed shape by ρ - |v|, where x + v is the nearest place at which the
ball's centre may be: the least v with aᵢ(x + v) ≥ ρ for the distance aᵢ from each vessel. It is
found by linearising: nᵢ·v ≥ bᵢ, a quadratic program in three unknowns whose optimum is the longest
of the least-norm solutions of one, two or three of the equations with multipliers not below 0
(its dual). For planes one step is exact; for cylinders two or three are.
"""

from __future__ import annotations

from math import inf, sqrt
from typing import Final, NamedTuple

import numpy as np

from kernels import jit
from kernels.arrays import FloatArray

COLUMNS = 10
"""Of a vessel's row: its first point (3), unit axis (3), length, radius there, slope, cosine."""


class _Ball(NamedTuple):
    """Limits of the ball's way to its place; lengths in its radius."""

    touching: int = 12  # vessels at once, the nearest
    steps: int = 6
    longest_step: float = 2.0
    short_steps: int = 10  # more steps, which ``longest_step`` has cut short
    settled: float = 1e-4


_BALL: Final = _Ball()


def wall_rows(
    start: FloatArray, axis: FloatArray, length: FloatArray, radius: FloatArray, slope: FloatArray
) -> FloatArray:
    """Return vessels' rows for the kernels below, (n, 10).

    Parameters
    ----------
    start : (n, 3) float64, mm
        Where each axis begins.
    axis : (n, 3) float64
        Unit vectors.
    length : (n,) float64, mm
        Infinite for a vessel that goes on beyond what is looked at.
    radius : (n,) float64, mm
        At ``start``.
    slope : (n,) float64
        By how much the radius grows per mm of axis.
    """
    cosine = 1.0 / np.sqrt(1.0 + slope**2)
    return np.ascontiguousarray(np.column_stack([start, axis, length, radius, slope, cosine]))


@jit
def wall_distance(
    wall: FloatArray, x: float, y: float, z: float
) -> tuple[float, float, float, float]:
    """Return the signed distance from a cone with a ball at either end, and its gradient."""
    dx, dy, dz = x - wall[0], y - wall[1], z - wall[2]
    s = dx * wall[3] + dy * wall[4] + dz * wall[5]
    radius = wall[7]
    if s > 0.0 and s < wall[6]:
        dx, dy, dz = dx - s * wall[3], dy - s * wall[4], dz - s * wall[5]
        away = sqrt(dx * dx + dy * dy + dz * dz)
        k, c = wall[8], wall[9]
        if away < 1e-300:
            return -(radius + k * s) * c, 0.0, 0.0, 0.0
        nx, ny, nz = dx / away - k * wall[3], dy / away - k * wall[4], dz / away - k * wall[5]
        return (away - radius - k * s) * c, nx * c, ny * c, nz * c
    if s > 0.0:
        length = wall[6]
        dx, dy, dz = dx - length * wall[3], dy - length * wall[4], dz - length * wall[5]
        radius += wall[8] * length
    away = sqrt(dx * dx + dy * dy + dz * dz)
    if away < 1e-300:
        return -radius, 0.0, 0.0, 0.0
    return away - radius, dx / away, dy / away, dz / away


@jit
def least_step(n: FloatArray, b: FloatArray, count: int) -> tuple[float, float, float]:
    """Find the least v with n·v ≥ b: the longest dual-feasible vertex of 1, 2 or 3 rows."""
    best, vx, vy, vz = 0.0, 0.0, 0.0, 0.0
    for i in range(count):
        if b[i] > 0.0:
            nn = n[i, 0] ** 2 + n[i, 1] ** 2 + n[i, 2] ** 2
            if nn > 0.5 and b[i] * b[i] / nn > best:
                best, s = b[i] * b[i] / nn, b[i] / nn
                vx, vy, vz = s * n[i, 0], s * n[i, 1], s * n[i, 2]
    for i in range(count):
        for j in range(i):
            c = n[i, 0] * n[j, 0] + n[i, 1] * n[j, 1] + n[i, 2] * n[j, 2]
            across = 1.0 - c * c
            if across < 1e-8:
                continue
            p, q = (b[i] - c * b[j]) / across, (b[j] - c * b[i]) / across
            if p > 0.0 and q > 0.0 and p * b[i] + q * b[j] > best:
                best = p * b[i] + q * b[j]
                vx = p * n[i, 0] + q * n[j, 0]
                vy = p * n[i, 1] + q * n[j, 1]
                vz = p * n[i, 2] + q * n[j, 2]
    for i in range(count):
        for j in range(i):
            for k in range(j):
                px = n[j, 1] * n[k, 2] - n[j, 2] * n[k, 1]
                py = n[j, 2] * n[k, 0] - n[j, 0] * n[k, 2]
                pz = n[j, 0] * n[k, 1] - n[j, 1] * n[k, 0]
                det = n[i, 0] * px + n[i, 1] * py + n[i, 2] * pz
                if abs(det) < 1e-4:
                    continue
                qx = n[k, 1] * n[i, 2] - n[k, 2] * n[i, 1]
                qy = n[k, 2] * n[i, 0] - n[k, 0] * n[i, 2]
                qz = n[k, 0] * n[i, 1] - n[k, 1] * n[i, 0]
                rx = n[i, 1] * n[j, 2] - n[i, 2] * n[j, 1]
                ry = n[i, 2] * n[j, 0] - n[i, 0] * n[j, 2]
                rz = n[i, 0] * n[j, 1] - n[i, 1] * n[j, 0]
                x = (b[i] * px + b[j] * qx + b[k] * rx) / det
                y = (b[i] * py + b[j] * qy + b[k] * ry) / det
                z = (b[i] * pz + b[j] * qz + b[k] * rz) / det
                # Multipliers of v = λn: v in the basis dual to n, which is (p, q, r) / det.
                one = (x * px + y * py + z * pz) / det
                two = (x * qx + y * qy + z * qz) / det
                three = (x * rx + y * ry + z * rz) / det
                size = x * x + y * y + z * z
                if one > 0.0 and two > 0.0 and three > 0.0 and size > best:
                    best, vx, vy, vz = size, x, y, z
    return vx, vy, vz


@jit
def rounded_distance(walls: FloatArray, rho: float, x: float, y: float, z: float) -> float:
    """Return how far (x, y, z) is outside the vessels closed by a ball of radius ``rho``, mm.

    Right in sign and zero; elsewhere near the distance, where the surface bends little.
    """
    count = len(walls)
    least = inf
    for i in range(count):
        a, _, _, _ = wall_distance(walls[i], x, y, z)
        least = min(least, a)
    if rho <= 0.0 or least >= rho:
        return least
    n = np.empty((_BALL.touching, 3))
    b = np.empty(_BALL.touching)
    cx, cy, cz = x, y, z
    size = 0.0
    whole = 0
    for _ in range(_BALL.steps + _BALL.short_steps):
        used = 0
        for i in range(count):
            a, gx, gy, gz = wall_distance(walls[i], cx, cy, cz)
            if a > 3.0 * rho:
                continue
            need = rho - a - gx * (x - cx) - gy * (y - cy) - gz * (z - cz)
            place = used
            if used == _BALL.touching:
                place = int(np.argmin(b))
                if b[place] >= need:
                    continue
            else:
                used += 1
            n[place, 0], n[place, 1], n[place, 2], b[place] = gx, gy, gz, need
        vx, vy, vz = least_step(n, b, used)
        # A ball deep inside would pass another vessel's axis, one between the ends of two pieces
        # that face each other all of them: step by step.
        mx, my, mz = x + vx - cx, y + vy - cy, z + vz - cz
        moved = sqrt(mx * mx + my * my + mz * mz)
        share = min(1.0, _BALL.longest_step * rho / moved) if moved > 0.0 else 1.0
        cx, cy, cz = cx + share * mx, cy + share * my, cz + share * mz
        size = sqrt((cx - x) ** 2 + (cy - y) ** 2 + (cz - z) ** 2)
        whole += share == 1.0
        if moved < _BALL.settled * rho or whole == _BALL.steps:
            break
    return rho - size


@jit
def leaves(wall: FloatArray, dx: float, dy: float, dz: float) -> float:
    """Return where a ray from the common first point leaves a vessel (an infinite one)."""
    c = dx * wall[3] + dy * wall[4] + dz * wall[5]
    if c <= 0.0:
        return float(wall[7])
    slant = sqrt(max(0.0, 1.0 - c * c)) - c * wall[8]
    return wall[7] / slant if slant > 1e-9 else inf


@jit
def _exit(walls: FloatArray, dx: float, dy: float, dz: float) -> float:
    """Return where a ray from the common first point leaves the last of the vessels."""
    far = 0.0
    for i in range(len(walls)):
        far = max(far, leaves(walls[i], dx, dy, dz))
    return far


@jit
def shoot(walls: FloatArray, rho: float, directions: FloatArray, away: FloatArray) -> None:
    """Find where each ray from the common first point leaves the rounded vessels.

    The vessels ``walls`` (n, 10), infinite, all hold that point and are convex, so every ray leaves
    their union once; their closing keeps that (its Minkowski sum with the ball is star-shaped about
    the whole ball). Distances along unit ``directions`` (m, 3) go into ``away`` (m,), mm.
    """
    px, py, pz = walls[0, 0], walls[0, 1], walls[0, 2]
    for m in range(len(directions)):
        dx, dy, dz = directions[m, 0], directions[m, 1], directions[m, 2]
        low = _exit(walls, dx, dy, dz)
        away[m] = low
        if rho <= 0.0 or low == inf:
            continue
        f_low = rounded_distance(walls, rho, px + low * dx, py + low * dy, pz + low * dz)
        if f_low >= -1e-9 * rho:
            continue
        step, high, f_high = rho, low, f_low
        for _ in range(60):
            high += step
            f_high = rounded_distance(walls, rho, px + high * dx, py + high * dy, pz + high * dz)
            if f_high > 0.0:
                break
            low, f_low = high, f_high
            step *= 1.5
        t = high
        for _ in range(60):
            t = (low * f_high - high * f_low) / (f_high - f_low)
            f = rounded_distance(walls, rho, px + t * dx, py + t * dy, pz + t * dz)
            if abs(f) < 1e-6 * rho or high - low < 1e-9 * high:
                break
            if f > 0.0:
                high, f_high = t, f
                f_low *= 0.5
            else:
                low, f_low = t, f
                f_high *= 0.5
        away[m] = t
