"""Bath effects on filaments, against statics by hand; ink displaced by the shaft."""

from __future__ import annotations

import math

import numpy as np
import pytest

from firmware_profiles import Bath, Ink, Needle, load
from sim.gcode.bead import Nozzle, crevice, cut, drag, predict_bead, settling, swell
from sim.gcode.motion.executed import ExecutedMotion


def strokes(lines: list[tuple[tuple[float, ...], tuple[float, ...]]], diameter: float):
    """Lines written one after the other at 5 mm/s, with travels between them at 20."""
    where, volume, speed = [lines[0][0]], [], []
    for begin, end in lines:
        if where[-1] != begin:
            where.append(begin)
            volume.append(0.0)
            speed.append(20.0)
        where.append(end)
        volume.append(math.pi / 4 * diameter**2 * math.dist(begin, end))
        speed.append(5.0)
    place = np.array(where, dtype=float)
    length = np.linalg.norm(np.diff(place, axis=0), axis=1)
    time = np.concatenate([[0.0], np.cumsum(length / speed)])
    pushed = np.concatenate([[0.0], np.cumsum(volume)])
    motion = ExecutedMotion(
        place[:-1], place[1:], pushed[:-1], pushed[1:], time[:-1], time[1:],
        np.arange(len(volume)),
    )  # fmt: skip
    writes = np.array(volume) > 0
    return predict_bead(
        cut(motion, 1.0), Nozzle(), np.arange(len(volume)) + 1, writes, style="embedded"
    )


def test_a_heavy_filament_sinks_and_a_light_one_rises() -> None:
    bead = strokes([((0, 0, 0), (20, 0, 0))], 1.0)
    ink = load(Ink, "gelatin_sacrificial")
    bath = load(Bath, "cell_matrix").model_copy(update={"yield_stress_pa": 0.05})
    heavy = ink.model_copy(update={"density_g_cm3": 1.25})
    held = settling(bead, heavy, bath)
    assert held is not None
    assert not held.held
    assert not held.up
    assert held.line == 1
    assert held.speed_mm_s is None
    # τ_y = 0.07 Δϱ g D: 0.05 Pa hold 0.364 mm at 200 kg/m³.
    assert held.held_mm == pytest.approx(0.05 / (0.07 * 200 * 9.81) * 1e3)
    light = settling(bead, ink.model_copy(update={"density_g_cm3": 0.9}), bath)
    assert light is not None
    assert light.up


def test_a_filament_that_isn_t_held_sinks_by_what_the_yield_stress_leaves() -> None:
    bead = strokes([((0, 0, 0), (20, 0, 0))], 1.0)
    heavy = load(Ink, "gelatin_sacrificial").model_copy(update={"density_g_cm3": 1.25})
    known = {"yield_stress_pa": 0.05, "viscosity_pa_s": 0.8}
    bath = load(Bath, "cell_matrix").model_copy(update=known)
    held = settling(bead, heavy, bath)
    weight = 200 * 9.81 * math.pi / 4 * 1e-6  # N/m
    bears = 11.94 * 0.05 * 1e-3
    assert held is not None
    expected = (weight - bears) * math.log(40) / (4 * math.pi * 0.8) * 1e3
    assert held.speed_mm_s == pytest.approx(expected, rel=1e-3)


def test_swelling_that_nobody_measured_is_one_and_says_so() -> None:
    ink = load(Ink, "gelatin_sacrificial")
    assert swell(ink) == (1.0, False)
    assert swell(ink.model_copy(update={"swell_factor": 1.1})) == (1.1, False)
    assert swell(ink.model_copy(update={"swell_factor": 1.1, "calibrated": True})) == (1.1, True)


def test_a_slow_bath_leaves_a_crevice() -> None:
    bead, needle = strokes([((0, 0, 0), (20, 0, 0))], 0.4), load(Needle, "30g")
    bath = load(Bath, "cell_matrix")
    assert crevice(bead, needle, bath) is None
    slow = crevice(bead, needle, bath.model_copy(update={"recovery_s": 0.2}))
    fast = crevice(bead, needle, bath.model_copy(update={"recovery_s": 0.02}))
    assert slow is not None
    assert fast is not None
    assert slow.length_mm == pytest.approx(1.0)
    assert slow.opens
    assert not fast.opens


def test_the_shaft_drags_what_it_passes_by_its_distance() -> None:
    outer = 0.31
    gap = 0.25
    apart = outer / 2 + gap
    upper, beside = ((0.0, 0.0, 1.0), (5.0, 0.0, 1.0)), ((5.0, apart, 0.0), (0.0, apart, 0.0))
    found = drag(strokes([upper, beside], 0.1), outer)
    assert found.worst_mm == pytest.approx(outer / 2 * math.exp(-gap / (outer / 2)), rel=0.02)
    assert found.dragged_line == 1
    assert found.line in (2, 3)
    # Written the other way round, the shaft stands above the lower one, and passes nothing.
    lower = ((0.0, apart, 0.0), (5.0, apart, 0.0))
    raised = ((5.0, 0.0, 1.0), (0.0, 0.0, 1.0))
    assert drag(strokes([lower, raised], 0.1), outer).places == 0
