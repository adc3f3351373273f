"""Uncertainty budgets: combination, degrees of freedom, propagation from sections to vessels."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from design.geometry.surface import Surface
from registration.alignment.uncertainty import (
    Budget,
    ScanErrors,
    Term,
    at_either_end,
    pressure_interval,
    rectangular,
    scan_errors,
    section_errors,
)
from registration.scan import Scan
from registration.segmentation import Segmentation
from registration.segmentation.volume import GelField, Strength

ACROSS = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])


def errors(wall_um: float = 0.0, depth: float = 0.0) -> ScanErrors:
    return ScanErrors(1e-3 * wall_um, 0.0, 0.0, np.inf, depth, 0.0, 1e-6, np.array([0.0, 0.0, 1.0]))


def sections(scan: ScanErrors, diameter: float = 0.4, noise_um: float = 0.0, count: int = 20):
    return section_errors(
        scan,
        np.full(count, diameter),
        np.full(count, 1e-3 * noise_um),
        np.broadcast_to(ACROSS, (count, 2, 3)),
        0.1,
    )


def test_the_gums_gauge_block_has_16_degrees_of_freedom():
    # JCGM 100:2008, H.1.6: u_c = 32 nm, 16 effective degrees of freedom, U99 = 93 nm.
    terms = [
        Term("standard", "B", 25.0, 18.0, ""),
        Term("readings", "A", 5.8, 24.0, ""),
        Term("comparator, random", "B", 3.9, 5.0, ""),
        Term("comparator, systematic", "B", 6.7, 8.0, ""),
        Term("expansion", "B", 2.9, 50.0, ""),
        Term("temperature", "B", 16.6, 2.0, ""),
    ]
    budget = Budget(tuple(terms))
    assert budget.standard == pytest.approx(32, abs=0.7)
    assert budget.dof == pytest.approx(16, abs=1.5)
    assert sum(budget.share(term) for term in terms) == pytest.approx(1)


def test_an_unknown_term_withdraws_the_interval():
    budget = Budget((Term("a", "A", math.nan, 5.0, ""), Term("b", "B", 1.0, math.inf, "")))
    assert math.isnan(budget.expanded)


def test_walls_move_every_section_alike_and_noise_averages_out():
    walls, noise = sections(errors(wall_um=5)), sections(errors(), noise_um=5)
    assert 1e3 * walls.mean_budget().standard == pytest.approx(10)
    assert 1e3 * noise.mean_budget().standard == pytest.approx(5 / math.sqrt(20), rel=1e-3)
    assert 1e3 * walls.expanded == pytest.approx(np.full(20, 1.96 * 10), rel=1e-3)


def test_an_index_off_by_one_percent_is_half_a_percent_of_a_lying_lumen():
    found = sections(errors(depth=0.01))
    assert found.mean_budget().standard == pytest.approx(0.5 * 0.01 * 0.4)


def test_resistance_interval_is_four_times_the_diameters():
    low, high = sections(errors(wall_um=1)).resistance_interval(1.0)
    assert math.log(high / low) / 2 == pytest.approx(4 * 1.96 * 2e-3 / 0.4, rel=1e-3)


def test_pressure_interval_doesnt_average_what_walls_share():
    ends = []
    for found in (sections(errors(wall_um=4)), sections(errors(), noise_um=8, count=1)):
        ends.append(pressure_interval(1.0, np.ones(16), np.ones(16), [found] * 16))
    shared, own = (high - low for low, high in ends)
    assert shared == pytest.approx(2 * 1.96 * 4 * 8e-3 / 0.4, rel=0.1)
    assert own == pytest.approx(shared / 4, rel=0.1)


# Errors common to all measurements of a scan.


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
