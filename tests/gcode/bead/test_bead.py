"""Outflow of a needle, ink along a path, a bath: against volumes, exponential law, statics."""

import math
from typing import Any

import numpy as np
import pytest

from firmware_profiles import Bath, Ink, Needle, Printer, load, yield_pressure_pa
from firmware_profiles.materials.bead import BeadSection
from gcode.bead.flow import Nozzle, Pieces, advance_of, cut, nozzle_flow, nozzle_of
from gcode.bead.predict import crevice, drag, laid_bead, predict_bead, settling, swell
from gcode.deposit.lay import deposit_of_laid
from gcode.dry_run.run import DryRun, dry_run
from gcode.motion.executed import ExecutedMotion
from tests.sim.motions import moved

LAG = 0.4


def pieces(durations: list[float], rates: list[float], jumps: dict[int, float] | None = None):
    """Stretches of time with a constant plunger flow, µL/s, the needle going 1 mm/s."""
    time = np.concatenate([[0.0], np.cumsum(durations)])
    place = np.column_stack([time, np.zeros((len(time), 2))])
    jump = np.zeros(len(durations))
    for row, volume in (jumps or {}).items():
        jump[row] = volume
    push = np.array(rates) * np.array(durations)
    return Pieces(place[:-1], place[1:], time, push, jump, np.arange(len(durations)))


def test_a_step_of_flow_is_followed_exponentially() -> None:
    found = nozzle_flow(pieces([0.05] * 40, [2.0] * 40), Nozzle(LAG))
    time = 0.05 * np.arange(1, 41)
    out = 2.0 * (time - LAG * (1 - np.exp(-time / LAG)))
    np.testing.assert_allclose(np.cumsum(found.out_ul), out, rtol=1e-12)
    np.testing.assert_allclose(found.held_ul, 2.0 * LAG * (1 - np.exp(-time / LAG)), rtol=1e-12)


@pytest.mark.parametrize("nozzle", [Nozzle(), Nozzle(LAG), Nozzle(LAG, 5e4, 3e4)])
def test_ink_is_neither_made_nor_lost(nozzle: Nozzle) -> None:
    random = np.random.default_rng(1)
    given = pieces(
        random.uniform(0, 1, 300).tolist(), random.normal(0.3, 1, 300).tolist(), {7: 0.3, 90: -0.2}
    )
    found = nozzle_flow(given, nozzle)
    pushed = float((given.push_ul + given.jump_ul).sum())
    stays = 0.0 if nozzle.lag_s == 0 else float(found.held_ul[-1]) - found.start_ul
    assert pushed == pytest.approx(float(found.out_ul.sum()) + stays, abs=1e-12)
    assert (found.laid_ul >= 0).all()
    # What is laid is what came out beyond what had been out: the highest of the running sum.
    assert found.laid_ul.sum() == pytest.approx(max(0.0, np.cumsum(found.out_ul).max()))


def test_an_advance_of_the_lag_cancels_it() -> None:
    rates = [1.0, 3.0, 0.5, 0.0]
    jumps = {0: LAG * 1.0, 1: LAG * 2.0, 2: -LAG * 2.5, 3: -LAG * 0.5}
    found = nozzle_flow(pieces([0.7] * 4, rates, jumps), Nozzle(LAG))
    np.testing.assert_allclose(found.out_ul / 0.7, rates, atol=1e-12)
    without = nozzle_flow(pieces([0.7] * 4, rates), Nozzle(LAG))
    assert abs(without.out_ul / 0.7 - rates).max() > 0.3


def test_flow_goes_on_after_a_stop_until_the_pressure_is_gone() -> None:
    found = nozzle_flow(pieces([20.0, 100.0], [1.5, 0.0]), Nozzle(LAG))
    assert found.out_ul[1] == pytest.approx(1.5 * LAG)
    assert found.held_ul[1] == pytest.approx(0.0, abs=1e-12)
    flow, pull = 1.0, 4.0
    takes = LAG * math.log(1 + flow / pull)
    found = nozzle_flow(pieces([50.0, takes, 0.5], [flow, -pull, 0.0]), Nozzle(LAG))
    assert found.held_ul[1] == pytest.approx(0.0, abs=1e-12)
    assert found.out_ul[1] == pytest.approx(LAG * flow - pull * takes)
    assert found.out_ul[2] == pytest.approx(0.0, abs=1e-12)


def test_a_yield_stress_stays_behind_the_needle() -> None:
    ink = load(Ink, "collagen_fresh").model_copy(update={"yield_stress_pa": 120.0})
    needle = load(Needle, "30g")
    nozzle = nozzle_of(ink, needle, LAG, 0.5)
    held = 4 * 120.0 * needle.length_mm / needle.inner_mm
    assert yield_pressure_pa(ink, needle) == pytest.approx(held)
    found = nozzle_flow(pieces([20.0, 100.0], [0.5, 0.0]), nozzle)
    assert found.held_ul[1] * nozzle.resistance_pa_s_ul / LAG == pytest.approx(held)
    # Relieved by less than twice that volume, nothing is drawn in; primed again, it flows at once.
    relief = nozzle.held_ul
    again = nozzle_flow(
        pieces([20, 100, 0.1, 5, 0.1, 50], [0.5, 0, -relief / 0.1, 0, relief / 0.1, 0]), nozzle
    )
    np.testing.assert_allclose(again.out_ul[2:], 0.0, atol=1e-9)


# Ink along a path


AREA = 16.69
SHORT_LAG = 0.25


def motion(points: Any, speed: list[float], volume: list[float]) -> ExecutedMotion:
    """Blocks from point to point, mm/s and µL each; where the needle stands, a speed is seconds."""
    length = np.linalg.norm(np.diff(np.array(points, float), axis=0), axis=1)
    each = np.where(length > 0, length / np.array(speed), speed)
    return moved(points, volume, AREA, np.concatenate([[0.0], np.cumsum(each)]))


def bead(motion: ExecutedMotion, nozzle: Nozzle, **options: Any):
    pieces = cut(motion, AREA, lag_s=nozzle.lag_s)
    lines = np.arange(len(motion)) + 1
    length = np.linalg.norm(motion.end - motion.start, axis=1)
    writes = (motion.plunger_end > motion.plunger_start) & (length > 0)
    return predict_bead(pieces, nozzle, lines, writes, **options)


def test_without_lag_a_filament_is_as_thick_as_its_dose() -> None:
    diameters = [0.4, 0.8]
    dose = [np.pi / 4 * d**2 * 5.0 for d in diameters]
    found = bead(motion([(0, 0, 0), (3, 4, 0), (3, 4, 5)], [5.0, 2.0], dose), Nozzle())
    assert found.style == "embedded"
    middle = (found.pieces.start + found.pieces.end)[:, 2] / 2
    assert found.width_mm[0] == pytest.approx(0.4)
    assert found.width_mm[middle > 1.0] == pytest.approx(0.8)
    assert found.written_ul == pytest.approx(sum(dose))


def test_with_lag_the_filament_thickens_exponentially() -> None:
    speed, flow = 2.0, 0.6
    found = bead(motion([(0, 0, 0), (10, 0, 0)], [speed], [flow * 5.0]), Nozzle(SHORT_LAG))
    # Mean over each piece of Q (1 - e^(-t/τ)), by its integral.
    time = found.pieces.time
    grown = time + SHORT_LAG * np.exp(-time / SHORT_LAG)
    mean = flow * np.diff(grown) / np.diff(time)
    np.testing.assert_allclose(found.width_mm, np.sqrt(4 * mean / (np.pi * speed)), rtol=1e-9)


def test_ink_that_flows_after_a_stop_lies_along_the_travel() -> None:
    flow, speed, fast = 0.5, 2.0, 10.0
    path = [(0, 0, 0), (20, 0, 0), (50, 0, 0)]
    found = bead(motion(path, [speed, fast], [flow * 10.0, 0.0]), Nozzle(SHORT_LAG))
    assert found.oozed_ul == pytest.approx(SHORT_LAG * flow, rel=1e-4)
    assert found.written_ul == pytest.approx(flow * 10.0 - SHORT_LAG * flow, rel=1e-6)
    first = int(np.flatnonzero(found.line == 2)[0])
    assert found.width_mm[first] == pytest.approx(np.sqrt(4 * flow / (np.pi * fast)), rel=0.04)


def test_a_line_in_a_layer_is_as_wide_as_its_ink_s_bead() -> None:
    points, speed, volume = [(0.0, 0.0, 0.06)], [], []
    for layer in range(3):
        z = 0.06 * (layer + 1)
        points += [(0.0, layer, z), (4.0, layer, z)]
        speed += [20.0, 10.0]
        volume += [0.0, 4.0 * 0.15 * 0.06]
    flat = bead(motion(points, speed, volume), Nozzle(), section=BeadSection("rectangle"))
    sides = bead(motion(points, speed, volume), Nozzle())
    assert flat.style == "layered"
    assert flat.width_mm[flat.writes] == pytest.approx(0.15)
    assert sides.width_mm[sides.writes] == pytest.approx(0.15 + 0.06 * (1 - np.pi / 4))


def test_voxels_hold_what_was_laid() -> None:
    radius, length = 0.25, 6.0
    dose = np.pi * radius**2 * length
    found = bead(motion([(0, 0, 0), (length, 0, 0)], [2.0], [dose]), Nozzle())
    laid = deposit_of_laid(laid_bead(found), 0.05)
    ends = 4 / 3 * np.pi * radius**3
    assert laid.volume_mm3 == pytest.approx(dose + ends, rel=0.02)
    swollen = deposit_of_laid(laid_bead(found, swell=1.2), 0.05)
    assert swollen.volume_mm3 == pytest.approx(1.2**2 * dose + 1.2**3 * ends, rel=0.02)


def job(printer: Printer, head: bytes) -> tuple[DryRun, bytes]:
    """Slow, fast, slow, the same ink per length."""
    gcode = (
        head + b"M302 P1\nG92 X0 Y0 Z0 E0\nG1 X10 E0.2 F240\nG1 X30 E0.6 F960\nG1 X40 E0.8 F240\n"
    )
    return dry_run(gcode, printer, cold_extrusion=True), gcode


@pytest.mark.parametrize(
    ("firmware", "command"),
    [
        ("marlin", b"M900 K0.25\n"),
        ("reprapfirmware", b"M572 D0 S0.25\n"),
        ("klipper", b"SET_PRESSURE_ADVANCE EXTRUDER=extruder ADVANCE=0.25\n"),
        ("marlin", b""),
    ],
)
def test_the_firmware_s_advance_cancels_a_lag_of_its_length(firmware: str, command: bytes) -> None:
    own = 0.0 if command else 0.25
    known = {"firmware": firmware, "advance_s": own, "extra_commands": ("M302",)}
    printer = load(Printer, "generic_marlin").model_copy(update=known)
    run, gcode = job(printer, command)
    advance = advance_of(run, gcode, printer)
    assert advance.most_s == 0.25
    row = np.searchsorted(run.program.command, run.executed.line)
    writes = run.doses[row]

    def widths(ahead: np.ndarray | None) -> np.ndarray:
        pieces = cut(run.executed, AREA, ahead, lag_s=0.25)
        found = predict_bead(pieces, Nozzle(0.25), run.program.line[row], writes)
        return found.width_mm[found.writes]

    # One block each, so that the plunger's step at a block's begin is all there is to round.
    asked = np.sqrt(4 / np.pi * 0.02 * AREA)
    np.testing.assert_allclose(widths(advance.ahead_mm), asked, rtol=2e-3)
    assert np.abs(widths(None) / asked - 1).max() > 0.4


# Effects of a bath


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
    return bead(motion(where, speed, volume), Nozzle(), style="embedded")


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
