"""Project 3D points to pixels and back: lens, pose, and refraction at a flat bath surface."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from kernels.arrays import FloatArray

_ROUNDS: Final = 30
_SMALL: Final = 1e-12


@dataclass(frozen=True, eq=False)
class View:
    """A camera over the printer, as numbers that are cheap to vary.

    Attributes
    ----------
    lens : (8,) float64
        As `registration.devices.lens.Lens.numbers`.
    turn : (3, 3) float64
        From the printer's axes to the camera's (x right, y down, z ahead).
    eye_mm : (3,) float64, mm
        The camera's centre, printer's frame.
    surface_z_mm : float, mm, or None
        Of the bath; None for air all over.
    index : float
        Refractive, of the bath.
    """

    lens: FloatArray
    turn: FloatArray
    eye_mm: FloatArray
    surface_z_mm: float | None = None
    index: float = 1.0


def bend(flat: FloatArray, lens: FloatArray) -> FloatArray:
    """Distort places (n, 2) over the focal length (Brown 1971; the terms of `Lens`)."""
    k1, k2, p1, p2, k3 = lens[3:8]
    x, y = flat[:, 0], flat[:, 1]
    square = x * x + y * y
    radial = 1 + square * (k1 + square * (k2 + square * k3))
    return np.column_stack(
        [
            x * radial + 2 * p1 * x * y + p2 * (square + 2 * x * x),
            y * radial + p1 * (square + 2 * y * y) + 2 * p2 * x * y,
        ]
    )


def unbend(seen: FloatArray, lens: FloatArray) -> FloatArray:
    """Inverse of `bend`, by Newton's method."""
    k1, k2, p1, p2, k3 = lens[3:8]
    flat = seen.copy()
    for _ in range(_ROUNDS):
        x, y = flat[:, 0], flat[:, 1]
        square = x * x + y * y
        radial = 1 + square * (k1 + square * (k2 + square * k3))
        slope = k1 + square * (2 * k2 + square * 3 * k3)  # of radial by square
        xx = radial + 2 * x * x * slope + 2 * p1 * y + 6 * p2 * x
        xy = 2 * x * y * slope + 2 * p1 * x + 2 * p2 * y
        yy = radial + 2 * y * y * slope + 6 * p1 * y + 2 * p2 * x
        off = bend(flat, lens) - seen
        area = xx * yy - xy * xy
        step = (
            np.column_stack([yy * off[:, 0] - xy * off[:, 1], xx * off[:, 1] - xy * off[:, 0]])
            / np.where(np.abs(area) > _SMALL, area, 1.0)[:, None]
        )
        flat = flat - np.clip(step, -0.1, 0.1)
        if not len(step) or np.abs(step).max() < _SMALL:
            break
    return flat


def project(view: View, points_mm: FloatArray) -> FloatArray:
    """Pixels (n, 2) of places (n, 3), printer's frame; NaN behind the camera."""
    aim = _aims(view, points_mm)
    seen = (aim - view.eye_mm) @ view.turn.T
    ahead = np.where(seen[:, 2:] > _SMALL, seen[:, 2:], np.nan)
    return bend(seen[:, :2] / ahead, view.lens) * view.lens[0] + view.lens[1:3]


def rays(view: View, pixels: FloatArray) -> FloatArray:
    """Directions (n, 3) in air, printer's axes, not of unit length."""
    flat = unbend((np.asarray(pixels, np.float64) - view.lens[1:3]) / view.lens[0], view.lens)
    return np.column_stack([flat, np.ones(len(flat))]) @ view.turn


def meet(view: View, pixels: FloatArray, z_mm: float | FloatArray) -> FloatArray:
    """Places (n, 2) at a height that pixels (n, 2) show; NaN where a ray never comes there.

    Notes
    -----
    Below the bath's surface a ray goes on by Snell's law: sin i = index × sin r.
    """
    way = rays(view, pixels)
    way = np.where(way[:, 2:] < 0, way, np.nan)
    z = np.broadcast_to(np.asarray(z_mm, np.float64), len(way))
    top = z if view.surface_z_mm is None else np.maximum(z, view.surface_z_mm)
    reach = (top - view.eye_mm[2]) / way[:, 2]
    at: FloatArray = view.eye_mm[:2] + reach[:, None] * way[:, :2]
    if view.surface_z_mm is not None:
        sine = way[:, :2] / np.linalg.norm(way, axis=1)[:, None] / view.index
        at += (top - z)[:, None] * sine / np.sqrt(1 - (sine**2).sum(axis=1))[:, None]
    return at


def _aims(view: View, points_mm: FloatArray) -> FloatArray:
    """Where the straight way from the camera to each place leads: itself, or through the surface.

    The ray meets the surface at the distance a from the point below the eye where
    a / √(a² + H²) = index (D - a) / √((D - a)² + h²) (Snell), found by Newton's method.
    """
    points = np.asarray(points_mm, dtype=np.float64).reshape(-1, 3)
    if view.surface_z_mm is None or view.index == 1.0:
        return points
    depth = np.maximum(view.surface_z_mm - points[:, 2], 0.0)
    height = view.eye_mm[2] - view.surface_z_mm
    aside = points[:, :2] - view.eye_mm[:2]
    far = np.linalg.norm(aside, axis=1)
    a = far * height / (height + depth / view.index)
    for _ in range(_ROUNDS):
        rest = far - a
        above, below = np.hypot(a, height), np.hypot(rest, depth) + _SMALL
        off = a / above - view.index * rest / below
        slope = height**2 / above**3 + view.index * depth**2 / below**3
        step = np.where(depth > 0, off / slope, 0.0)
        a = np.clip(a - step, 0.0, far)
        if not len(step) or np.abs(step).max() < _SMALL:
            break
    share = np.where(far > 0, a / np.where(far > 0, far, 1.0), 1.0)
    on_top = view.eye_mm[:2] + aside * share[:, None]
    under = depth > 0
    aims = points.copy()
    aims[under, :2] = on_top[under]
    aims[under, 2] = view.surface_z_mm
    return aims
