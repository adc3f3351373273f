"""Errors common to all measurements of a scan."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from design.geometry.surface import Surface
from registration.alignment.uncertainty import ScanErrors, at_either_end, rectangular, scan_errors
from registration.scan import Scan
from registration.segmentation import Segmentation
from registration.segmentation.volume import GelField, Strength


def shared(dark: float, depth_standard: bool = False) -> ScanErrors:
    values = np.zeros((8, 8, 8), np.float32)
    scan = Scan(
        values, (0.02, 0.05, 0.05), 1.34, False, "linear", "oct", True, Path("a"),
        depth_standard=depth_standard,
    )  # fmt: skip
    field = GelField(
        values, 0.5, 1.0, np.full(3, 0.05), np.zeros(3), 0.04, faint_mm=0.004, facing_mm=0.006
    )  # fmt: skip
    none, faces = np.zeros((0, 3)), np.zeros((0, 3), np.int32)
    strength = Strength(values, 0.01, values.astype(np.float16), dark)
    seen = np.zeros(0, np.bool_)
    return scan_errors(scan, Segmentation(field, Surface(none, faces), none, seen, 5.0, strength))


def test_the_level_is_less_sure_the_brighter_the_liquid():
    assert shared(0.5).level_mm == pytest.approx(2 * shared(0.0).level_mm)
    assert shared(0.0).facing_mm == pytest.approx(at_either_end(0.006))
    assert shared(0.0).faint_mm == pytest.approx(at_either_end(0.004))


def test_reflections_weigh_more_where_the_step_from_the_liquid_is_small():
    assert shared(0.4).faint_mm == pytest.approx((2 / 0.6 - 1) * at_either_end(0.004))
    assert shared(0.4).facing_mm == pytest.approx((2 / 0.6 - 1) * at_either_end(0.006))


def test_without_contrast_no_wall_has_an_interval():
    assert math.isnan(shared(0.8).level_mm)


def test_the_index_counts_unless_a_depth_standard_was_scanned():
    assert shared(0.0).depth == pytest.approx(rectangular(0.02))
    assert shared(0.0, depth_standard=True).depth < 0.001
