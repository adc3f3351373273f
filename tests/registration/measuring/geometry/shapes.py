"""Test print: a block with three straight channels of known deviation, as a segmented field.

No scanner in between: zones are held against analytic truth.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache

import manifold3d
import numpy as np
from scipy.ndimage import gaussian_filter

from design.network import VesselKind, VesselNetwork
from design.solids.solid import Solid
from kernels.arrays import FloatArray
from registration.alignment import Fit, Uncertainty
from registration.alignment.distance import ModelSurface
from registration.alignment.uncertainty import ScanErrors
from registration.measuring.gauging import trace_vessels
from registration.measuring.gauging.on_walls import outlines
from registration.measuring.geometry import (
    Characteristic,
    Cut,
    Datum,
    Frame,
    Scene,
    best_fit,
    characteristics,
    lay_on_datums,
    outer_faces,
)
from registration.segmentation import Segmentation
from tests.design.networks import network as network_of
from tests.registration import parts
from tests.registration.parts import lumens, solid

BLOCK = np.array([8.0, 5.0, 2.6])
VOXEL = 0.05
RADIUS = (0.25, 0.3, 0.35)
IDENTITY = Fit(np.eye(3), np.zeros(3), np.ones(3), BLOCK / 2)
EXACT = ScanErrors(0.0, 0.0, 0.0, 12.0, 0.0, 0.0, 0.02, np.array([0.0, 0.0, 1.0]))
SURE = Uncertainty(np.zeros(3), np.zeros(3), np.zeros(3), 0.0)


@dataclass(frozen=True)
class Printed:
    """How a channel was printed: ends, and what is added to its radius along it (0 to 1)."""

    start: tuple[float, float, float]
    end: tuple[float, float, float]
    wider: Callable[[FloatArray], FloatArray] = np.zeros_like


AS_DESIGNED = (
    Printed((0, 1.0, 1.3), (8, 1.0, 1.3)),
    Printed((0, 2.4, 1.2), (8, 2.4, 1.2)),
    Printed((0, 3.9, 1.4), (8, 3.9, 1.4)),
)


@cache
def network() -> VesselNetwork:
    ends = [end for one in AS_DESIGNED for end in (one.start, one.end)]
    return network_of(ends, [(0, 1), (2, 3), (4, 5)], RADIUS, VesselKind.CHANNEL)


@cache
def surface() -> ModelSurface:
    return ModelSurface.of(construct())


@cache
def construct() -> Solid:
    return solid(manifold3d.Manifold.cube(tuple(BLOCK)) - lumens(network()))


def segmented(
    printed: Sequence[Printed] = AS_DESIGNED,
    low: FloatArray | None = None,
    high: FloatArray | None = None,
    noise_mm: float = 0.0,
    seed: int = 0,
    pose: Fit = IDENTITY,
) -> Segmentation:
    """The printed block; `low`, `high` (x, y) to z: its lower and upper face, slopes included."""
    axes = [np.arange(-0.6, size + 0.6, VOXEL) for size in BLOCK]
    z, y, x = np.meshgrid(*axes[::-1], indexing="ij")
    scan = np.stack([x, y, z], axis=-1)
    points = pose.apply(scan.reshape(-1, 3)).reshape(scan.shape)
    bottom = np.zeros(3) if low is None else low
    top = np.array([0.0, 0.0, BLOCK[2]]) if high is None else high
    across = np.abs(points - BLOCK / 2) - BLOCK / 2
    height = points[..., 2]
    floor = bottom[0] * points[..., 0] + bottom[1] * points[..., 1] + bottom[2] - height
    roof = height - top[0] * points[..., 0] - top[1] * points[..., 1] - top[2]
    gel = np.maximum(across[..., :2].max(axis=-1), np.maximum(floor, roof))
    for one, radius in zip(printed, RADIUS, strict=True):
        a, b = np.array(one.start, dtype=float), np.array(one.end, dtype=float)
        t = (points - a) @ (b - a) / ((b - a) @ (b - a))
        away = np.linalg.norm(points - a - t[..., None] * (b - a), axis=-1)
        gel = np.maximum(gel, radius + one.wider(np.clip(t, 0, 1)) - away)
    if noise_mm > 0:
        rough = gaussian_filter(np.random.default_rng(seed).normal(size=gel.shape), 1.0)
        gel = gel + noise_mm * rough / rough.std()
    return parts.segmented(np.clip(0.5 - gel / 0.3, 0, 1), VOXEL, scan[0, 0, 0], 0.02)


def scene(found: Segmentation, fit: Fit = IDENTITY, errors: ScanErrors = EXACT) -> Scene:
    cuts = [
        Cut(
            t.along[t.counted],
            outlines(t.planes, t.sections, t.diameter, t.counted),
            t.sections.noise[t.counted],
        )
        for t in trace_vessels(network(), found, fit, 0.12)
    ]
    faces = outer_faces(surface(), network(), found, fit)
    return Scene(network(), faces, tuple(cuts), errors)


def measured(there: Scene, *datums: Datum, fit: Fit = IDENTITY) -> tuple[Characteristic, ...]:
    return characteristics(there, (1.0, 1.0, 1.0), surface(), frame(there, *datums, fit=fit))


def frame(there: Scene, *datums: Datum, fit: Fit = IDENTITY) -> Frame:
    return lay_on_datums(datums, fit, there) if datums else best_fit(fit, SURE, there.errors)


def zone(found: Sequence[Characteristic], name: str, feature: str) -> Characteristic:
    return next(one for one in found if one.name == name and one.feature == feature)
