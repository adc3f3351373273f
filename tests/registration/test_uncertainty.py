"""Uncertainty: budgets, intervals of an alignment, cross-check by another program."""

import math
import sys
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
import trimesh

from design.geometry.surface import Surface
from design.solids import block_solid
from design.solids.solid import Solid
from registration.alignment import Fit, Uncertainty, cross_check
from registration.alignment.distance import ModelSurface
from registration.alignment.fit import FitFreedom, refine
from registration.alignment.intervals import BLOCK_MM, PATCH_MM, fit_errors, uncertainty
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
from registration.measuring.gauging import surface_points
from registration.scan import Scan
from registration.segmentation import GelField, Segmentation, Strength

ACROSS = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])


def errors_of(wall_um: float = 0.0, depth: float = 0.0) -> ScanErrors:
    return ScanErrors(1e-3 * wall_um, 0.0, 0.0, np.inf, depth, 0.0, 1e-6, np.array([0.0, 0.0, 1.0]))


def sections(scan: ScanErrors, diameter: float = 0.4, noise_um: float = 0.0, count: int = 20):
    return section_errors(
        scan,
        np.full(count, diameter),
        np.full(count, 1e-3 * noise_um),
        np.broadcast_to(ACROSS, (count, 2, 3)),
        0.1,
    )


def test_the_gums_gauge_block_has_16_degrees_of_freedom_and_unknown_terms_withdraw_intervals():
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
    budget = Budget((Term("a", "A", math.nan, 5.0, ""), Term("b", "B", 1.0, math.inf, "")))
    assert math.isnan(budget.expanded)


def test_walls_move_every_section_alike_noise_averages_out_and_resistance_has_four_times():
    walls, noise = sections(errors_of(wall_um=5)), sections(errors_of(), noise_um=5)
    assert 1e3 * walls.mean_budget().standard == pytest.approx(10)
    assert 1e3 * noise.mean_budget().standard == pytest.approx(5 / math.sqrt(20), rel=1e-3)
    assert 1e3 * walls.expanded == pytest.approx(np.full(20, 1.96 * 10), rel=1e-3)
    found = sections(errors_of(depth=0.01))
    assert found.mean_budget().standard == pytest.approx(0.5 * 0.01 * 0.4)
    low, high = sections(errors_of(wall_um=1)).resistance_interval(1.0)
    assert math.log(high / low) / 2 == pytest.approx(4 * 1.96 * 2e-3 / 0.4, rel=1e-3)


def test_pressure_interval_doesnt_average_what_walls_share():
    ends = []
    for found in (sections(errors_of(wall_um=4)), sections(errors_of(), noise_um=8, count=1)):
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


def test_walls_are_less_sure_the_brighter_the_liquid_and_depth_without_a_standard():
    assert shared(0.5).level_mm == pytest.approx(2 * shared(0.0).level_mm)
    assert shared(0.0).facing_mm == pytest.approx(at_either_end(0.006))
    assert shared(0.0).faint_mm == pytest.approx(at_either_end(0.004))
    assert shared(0.4).faint_mm == pytest.approx((2 / 0.6 - 1) * at_either_end(0.004))
    assert shared(0.4).facing_mm == pytest.approx((2 / 0.6 - 1) * at_either_end(0.006))
    assert math.isnan(shared(0.8).level_mm)
    assert shared(0.0).depth == pytest.approx(rectangular(0.02))
    assert shared(0.0, depth_standard=True).depth < 0.001


# Intervals of an alignment.


SIZE = np.array([8.0, 5.0, 3.0])
START = Fit(np.eye(3), np.zeros(3), np.ones(3), SIZE / 2)
# With z stretching too a block's scales and the offset can't be told apart.
FREE = FitFreedom((0, 1), offset=True)
NOISE_MM = 0.004
SURE = ScanErrors.of_blur(0.0)


@cache
def model_surface():
    return ModelSurface.of(block_solid(SIZE.tolist()))


def faces(rng: np.random.Generator, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Points on the block's six faces, and their normals."""
    axis = rng.integers(3, size=count)
    high = rng.integers(2, size=count)
    points = rng.uniform(0.2, 1, (count, 3)) * (SIZE - 0.2)
    rows = np.arange(count)
    points[rows, axis] = high * SIZE[axis]
    normals = np.zeros((count, 3))
    normals[rows, axis] = 2 * high - 1
    return points, normals


def sure_of(
    points: np.ndarray, fit: Fit, shared: ScanErrors, freedom: FitFreedom = FREE
) -> Uncertainty:
    return uncertainty(
        fit_errors(model_surface(), points, fit, freedom, shared), fit, freedom, shared
    )


def errors(fit: Fit) -> np.ndarray:
    middle = fit.rotation @ fit.centre + fit.shift - fit.centre
    return np.array([*middle, *(fit.scale[:2] - 1), fit.offset_mm])


def by_patch(points: np.ndarray, normals: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """An error that each patch of the surface shares."""
    cell = np.floor(points / PATCH_MM).astype(int) @ np.array([1, 20, 400])
    return rng.normal(0, NOISE_MM, cell.max() + 1)[cell]


def by_block(points: np.ndarray, normals: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """An error that each block of each side shares."""
    cell = np.floor(points / BLOCK_MM).astype(int) @ np.array([1, 20, 400])
    side = (normals @ np.array([1, 2, 3])).astype(int) + 3
    return rng.normal(0, NOISE_MM, (7, cell.max() + 1))[side, cell]


@pytest.mark.parametrize(
    ("drawn", "seed", "rounds"),
    [pytest.param(by_patch, 0, 60, marks=pytest.mark.slow), (by_block, 3, 40)],
)
def test_intervals_cover_errors_that_whole_patches_or_blocks_share(drawn, seed, rounds) -> None:
    rng = np.random.default_rng(seed)
    covered, widths, found = [], [], []
    for _ in range(rounds):
        points, normals = faces(rng, 3000)
        scan = points + drawn(points, normals, rng)[:, None] * normals
        fit = refine(model_surface(), scan, START, FREE)
        sure = sure_of(scan, fit, SURE)
        half = np.array([*sure.shift_mm, *sure.scale[:2], sure.offset_mm])
        covered.append(np.abs(errors(fit)) <= half)
        widths.append(half)
        found.append(errors(fit))
    assert 0.88 < np.mean(covered) < 0.99
    if drawn is by_patch:
        ratio = np.mean(widths, axis=0) / np.std(found, axis=0)
        np.testing.assert_allclose(ratio, 1.96, rtol=0.4)


# Cross-check of a pose.


PLACE = Fit(np.eye(3), np.array([1.0, -2.0, 3.0]), np.array([1.02, 1.0, 0.99]), SIZE / 2)


@cache
def spread():
    return surface_points(model_surface())


def scanned() -> np.ndarray:
    rng = np.random.default_rng(0)
    chosen = spread()[rng.choice(len(spread()), 20_000, replace=False)]
    return PLACE.invert(chosen + rng.normal(0, 0.003, chosen.shape))


def test_a_right_pose_is_found_again_and_a_wrong_one_with_how_far_it_is_off() -> None:
    pytest.importorskip("small_gicp")
    assert cross_check(model_surface(), spread(), scanned(), PLACE) < 2.0
    wrong = replace(PLACE, shift=PLACE.shift + np.array([0.0, 0.05, 0.0]))
    assert cross_check(model_surface(), spread(), scanned(), wrong) == pytest.approx(50.0, abs=3.0)


def test_a_turn_that_no_scan_of_a_round_channel_shows_is_no_difference() -> None:
    """Seen points at random fix the turn about its axis by their noise alone."""
    pytest.importorskip("small_gicp")
    rng = np.random.default_rng(1)
    tube = trimesh.creation.cylinder(0.25, 9.0, sections=180)
    surface = ModelSurface.of(Solid(tube.vertices, tube.faces.astype(np.int32)))
    points = surface_points(surface)
    seen = points[rng.choice(len(points), 20_000)] + rng.normal(0, 0.003, (20_000, 3))
    upright = Fit(np.eye(3), np.zeros(3), np.ones(3), np.zeros(3))
    assert cross_check(surface, points, upright.invert(seen), upright) < 10.0


def test_without_the_program_nothing_is_said(monkeypatch) -> None:
    monkeypatch.setitem(sys.modules, "small_gicp", None)
    assert cross_check(model_surface(), spread(), scanned(), PLACE) is None
