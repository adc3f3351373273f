"""Gel in layers is measured as uneven, speckle and lumens aren't; walls' errors grow with it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from design.geometry.surface import Surface
from registration.alignment.uncertainty import ScanErrors, scan_errors
from registration.alignment.uncertainty.scan_errors import LEVEL_PART
from registration.scan import Scan
from registration.segmentation import GelField, Segmentation, Strength
from registration.segmentation.unevenness import unevenness
from registration.segmentation.working import Working

VOXEL = 0.025
WORKING = Working((1, 1, 1), np.ones(3), np.full(3, VOXEL), np.zeros(3), 0.03)


def gel(layers: float, period_mm: float = 0.5, lean: float = 0.0, speckle: float = 0.1):
    """Gel of 3 × 4 × 4 mm with a lumen in it and layers across the light, or leaning."""
    z, y, x = np.meshgrid(*(VOXEL * np.arange(n) for n in (120, 160, 160)), indexing="ij")
    noise = gaussian_filter(np.random.default_rng(1).normal(size=z.shape), 1.5)
    values = 1 - layers * np.sin(np.pi * (z + lean * x) / period_mm) ** 2
    values *= 1 + speckle * noise / noise.std()
    values[np.hypot(z - 1.5, y - 2.0) < 0.3] = 0.0
    return (values / np.median(values[values > 0])).astype(np.float32)


@pytest.mark.parametrize(("layers", "period_mm", "lean"), [(0.35, 0.6, 0), (0.2, 0.4, 0.05)])
def test_layers_are_measured(layers: float, period_mm: float, lean: float) -> None:
    """Of V sin² half of the values lie farther off their median than V / (2 √2)."""
    expected = 1.4826 * layers / (2 * np.sqrt(2)) / (1 - layers / 2)
    found = unevenness(gel(layers, period_mm, lean), WORKING)
    assert found == pytest.approx(expected, rel=0.2)


def errors(uneven: float) -> ScanErrors:
    values = np.zeros((8, 8, 8), np.float32)
    scan = Scan(values, (0.02, 0.05, 0.05), 1.34, False, "linear", "oct", True, Path("a"))
    field = GelField(values, 0.5, 1.0, np.full(3, 0.05), np.zeros(3), 0.04, uneven=uneven)
    none, faces = np.zeros((0, 3)), np.zeros((0, 3), np.int32)
    strength, seen = Strength(values, 0.01, values.astype(np.float16), 0.0), np.zeros(0, np.bool_)
    return scan_errors(scan, Segmentation(field, Surface(none, faces), none, seen, 5.0, strength))


def test_walls_are_less_sure_in_uneven_gel_and_unknown_in_very_uneven_gel() -> None:
    assert errors(0.05).level_mm == pytest.approx(np.hypot(LEVEL_PART, 0.025) * 2.5066 * 0.04)
    assert errors(0.05).outer_mm > errors(0.0).outer_mm
    assert np.isnan(errors(0.12).level_mm)
    assert np.isnan(errors(0.12).outer_mm)
