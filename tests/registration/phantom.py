"""Test phantom: channels of five sizes in a block, as a segmented field with known noise.

No scanner and no alignment in between: what is gauged here is gauged against analytic truth.
"""

from collections.abc import Callable
from functools import cache

import manifold3d
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

from design.network import VesselKind, VesselNetwork
from design.solids.solid import Solid
from kernels.arrays import FloatArray
from registration.alignment import Fit
from registration.measuring.gauging import VesselTrace, trace_vessels
from registration.segmentation import Segmentation
from tests.design.networks import network
from tests.registration.parts import lumens, segmented, solid

Radius = Callable[[int, FloatArray], FloatArray]
"""Vessel and distance along it (mm) to what is added to its radius (mm)."""

BLOCK = np.array([9.0, 4.4, 2.6])
VOXEL = 0.05
IDENTITY = Fit(np.eye(3), np.zeros(3), np.ones(3), BLOCK / 2)
CHANNEL, WIDE = 3, 4
"""The two parallel channels, 5.6 mm long, 0.5 and 0.6 mm wide."""


@cache
def ladder() -> VesselNetwork:
    """In, a header each way, two channels, a header back, out."""
    y = (1.2, 2.2, 3.2)
    nodes = [(0, y[1]), (1.7, y[1]), (1.7, y[0]), (1.7, y[2])]
    nodes += [(7.3, y[0]), (7.3, y[2]), (7.3, y[1]), (9, y[1])]
    ends = [(0, 1), (1, 2), (1, 3), (2, 4), (3, 5), (4, 6), (5, 6), (6, 7)]
    radius = [0.35, 0.3, 0.3, 0.25, 0.3, 0.3, 0.3, 0.35]
    return network([(*node, 1.3) for node in nodes], ends, radius, VesselKind.CHANNEL)


@cache
def ladder_construct() -> Solid:
    return solid(manifold3d.Manifold.cube(tuple(BLOCK)) - lumens(ladder()))


def as_designed(vessel: int, along: FloatArray) -> FloatArray:
    return np.zeros_like(along)


def block(
    change: Radius = as_designed,
    extra: Callable[[FloatArray], FloatArray] | None = None,
    filled: Callable[[FloatArray], FloatArray] | None = None,
    noise: float = 0.0,
    seed: int = 0,
) -> Segmentation:
    """The block's gel, sampled at `VOXEL`; the field's frame is the part's.

    `extra` gives a signed distance to more free space (negative inside), `filled` one to more
    gel. `noise` is the standard
    deviation of the wall's displacement in mm, correlated over a voxel.
    """
    points = _places()
    gel = _designed() if change is as_designed else _with_lumens(change)
    if extra is not None:
        gel = np.maximum(gel, -extra(points))
    if filled is not None:
        gel = np.minimum(gel, filled(points))
    if noise > 0:
        rough = gaussian_filter(np.random.default_rng(seed).normal(size=gel.shape), 1.0)
        gel = gel + noise * rough / rough.std()
    return segmented(np.clip(0.5 - gel / 0.3, 0, 1), VOXEL, points[0, 0, 0])


@cache
def _places() -> FloatArray:
    axes = [np.arange(-0.4, size + 0.4, VOXEL) for size in BLOCK]
    z, y, x = np.meshgrid(*axes[::-1], indexing="ij")
    return np.stack([x, y, z], axis=-1)


@cache
def _designed() -> FloatArray:
    return _with_lumens(as_designed)


def _with_lumens(change: Radius) -> FloatArray:
    """Signed distance to the gel, negative inside (a bound near edges)."""
    points = _places()
    box = (np.abs(points - BLOCK / 2) - BLOCK / 2).max(axis=-1)
    lumens = np.full(box.size, np.inf)
    for vessel, (near, along, away) in enumerate(_beside_walls()):
        lumens[near] = np.minimum(lumens[near], away - change(vessel, along))
    return np.maximum(box, -lumens.reshape(box.shape))


@cache
def _beside_walls() -> list[tuple[NDArray[np.int64], FloatArray, FloatArray]]:
    """Per vessel the voxels within it or 1 mm beside it, their way along it and off its wall.

    Farther away the gel's values are those of whole gel, whatever `change` adds.
    """
    points, found = _places().reshape(-1, 3), []
    for (a, b), radius in ladder().polylines():
        length = float(np.linalg.norm(b - a))
        along = np.clip((points - a) @ (b - a) / length, 0, length)
        away = np.linalg.norm(points - a - along[:, None] * (b - a) / length, axis=1) - radius[0]
        near = np.flatnonzero(away < 1.0)
        found.append((near, along[near], away[near]))
    return found


def traces(segmentation: Segmentation) -> tuple[VesselTrace, ...]:
    return trace_vessels(ladder(), segmentation, IDENTITY, 0.1)
