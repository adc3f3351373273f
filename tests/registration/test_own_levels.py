"""Short vessels beside thin gel: walls halfway between the levels of their own gel and liquid."""

from __future__ import annotations

from functools import cache

import manifold3d
import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from design.network import VesselNetwork
from design.solids.solid import Solid
from registration.alignment import Fit
from registration.alignment.distance import ModelSurface
from registration.measuring.gauging import VesselTrace, trace_vessels
from registration.measuring.gauging.own_levels import with_own_levels
from registration.segmentation import GelField, Segmentation, Strength
from registration.segmentation.mesh import surface_mesh
from tests.registration.parts import lumens, solid
from tests.slower import first_rows

RADIUS, BLUR, VOXEL = 0.15, 0.03, 0.025


GAP = 1.5 * BLUR


X = (0.6, 0.6 + 2 * RADIUS + GAP, 0.6 + 4 * RADIUS + 2 * GAP)


BLOCK = np.array([X[2] + 0.6, 2.6, 1.6])


@cache
def row() -> VesselNetwork:
    """Three rungs side by side between two trunks, and a channel of its own below them."""
    low, high = 0.7, 1.6
    nodes = [(0.0, low, 0.8), *((x, low, 0.8) for x in X), (BLOCK[0], low, 0.8)]
    nodes += [(0.0, high, 0.8), *((x, high, 0.8) for x in X), (BLOCK[0], high, 0.8)]
    nodes += [(0.0, 2.2, 0.5), (BLOCK[0], 2.2, 0.5)]
    ends = [(0, 1), (1, 2), (2, 3), (5, 6), (6, 7), (7, 8), (1, 6), (2, 7), (3, 8), (10, 11)]
    radius = [0.16] * 6 + [RADIUS] * 4
    return VesselNetwork.from_segments(
        np.array(nodes), np.array(ends), np.array(radius), np.full(10, 4), np.zeros(10)
    )


@cache
def share() -> tuple[np.ndarray, np.ndarray]:
    """Blurred share of gel of each voxel, and the first voxel's place."""
    axes = [np.arange(-0.2, size + 0.2, VOXEL) for size in BLOCK]
    z, y, x = np.meshgrid(*axes[::-1], indexing="ij")
    points = np.stack([x, y, z], axis=-1)
    wall = np.full(x.shape, np.inf)
    for (a, b), radius in row().polylines():
        along = np.clip((points - a) @ (b - a) / ((b - a) @ (b - a)), 0, 1)
        away = np.linalg.norm(points - a - along[..., None] * (b - a), axis=-1)
        wall = np.minimum(wall, away - radius[0])
    outside = (np.abs(points - BLOCK / 2) - BLOCK / 2).max(axis=-1)
    gel = np.clip(0.5 + np.minimum(wall, -outside) / VOXEL, 0, 1)
    return gaussian_filter(gel, BLUR / VOXEL), points[0, 0, 0]


def scanned(gel: float, liquid: float, *, oct_scan: bool = True) -> Segmentation:
    """The row's scan, its levels off by what `gel` and `liquid` differ from 1 and 0."""
    part, origin = share()
    values = (liquid + (gel - liquid) * part).astype(np.float32)
    field = GelField(values, 0.5, 1.0, np.full(3, VOXEL), origin, blur_mm=BLUR)
    strength = Strength(values, 0.0, values.astype(np.float16)) if oct_scan else None
    return Segmentation(field, *surface_mesh(field, None, 0.3), 50.0, strength)


MIDDLE = 7


@cache
def construct() -> Solid:
    return solid(manifold3d.Manifold.cube(tuple(BLOCK)) - lumens(row()))


def gauged(seen: Segmentation, *, part: bool = True) -> tuple[list[VesselTrace], list[VesselTrace]]:
    """Traces before and after."""
    fit = Fit(np.eye(3), np.zeros(3), np.ones(3), BLOCK / 2)
    surface = ModelSurface.of(construct()) if part else None
    before = trace_vessels(row(), seen, fit, 0.05, surface)
    return list(before), list(with_own_levels(before, seen, fit, surface))


def mean(trace: VesselTrace) -> float:
    assert trace.sections.closed_outline[trace.counted].all()
    return float(trace.diameter[trace.counted].mean())


@pytest.mark.parametrize(
    ("gel", "liquid"), first_rows([(0.92, -0.03), (1.06, 0.0), (0.9, 0.0), (1.0, -0.05)], 2)
)
def test_walls_lie_halfway_between_their_own_levels(gel: float, liquid: float):
    right = mean(gauged(scanned(1.0, 0.0))[1][MIDDLE])
    before, after = gauged(scanned(gel, liquid))
    off = np.sqrt(2 * np.pi) * BLUR * (1 - gel - liquid)
    assert mean(before[MIDDLE]) - right == pytest.approx(off, rel=0.35)
    assert abs(mean(after[MIDDLE]) - right) < 0.25 * abs(off)


def test_right_levels_move_nothing():
    before, after = gauged(scanned(1.0, 0.0))
    assert mean(after[MIDDLE]) == pytest.approx(mean(before[MIDDLE]), abs=0.05 * BLUR)
