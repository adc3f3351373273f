"""Predicted ink along a path, against volumes and the exponential law."""

from __future__ import annotations

import numpy as np
import pytest

from firmware_profiles import Printer, load
from firmware_profiles.bead import BeadSection
from sim.gcode.bead import Nozzle, advance_of, bead_deposit, cut, predict_bead
from sim.gcode.dry_run.run import DryRun, dry_run
from sim.gcode.motion.executed import ExecutedMotion

AREA = 16.69
LAG = 0.25


def motion(points: list[tuple[float, float, float]], speed: list[float], volume: list[float]):
    """Blocks from point to point, mm/s and µL each; where the needle stands, a speed is seconds."""
    where = np.array(points, dtype=float)
    length = np.linalg.norm(np.diff(where, axis=0), axis=1)
    time = np.concatenate([[0.0], np.cumsum(np.where(length > 0, length / np.array(speed), speed))])
    plunger = np.concatenate([[0.0], np.cumsum(volume)]) / AREA
    return ExecutedMotion(
        where[:-1], where[1:], plunger[:-1], plunger[1:], time[:-1], time[1:],
        np.arange(len(volume)),
    )  # fmt: skip


def bead(moved: ExecutedMotion, nozzle: Nozzle, **options):
    pieces = cut(moved, AREA, lag_s=nozzle.lag_s)
    lines = np.arange(len(moved)) + 1
    length = np.linalg.norm(moved.end - moved.start, axis=1)
    writes = (moved.plunger_end > moved.plunger_start) & (length > 0)
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
    found = bead(motion([(0, 0, 0), (10, 0, 0)], [speed], [flow * 5.0]), Nozzle(LAG))
    # Mean over each piece of Q (1 - e^(-t/τ)), by its integral.
    time = found.pieces.time
    grown = time + LAG * np.exp(-time / LAG)
    mean = flow * np.diff(grown) / np.diff(time)
    np.testing.assert_allclose(found.width_mm, np.sqrt(4 * mean / (np.pi * speed)), rtol=1e-9)


def test_ink_that_flows_after_a_stop_lies_along_the_travel() -> None:
    flow, speed, fast = 0.5, 2.0, 10.0
    moved = motion([(0, 0, 0), (20, 0, 0), (50, 0, 0)], [speed, fast], [flow * 10.0, 0.0])
    found = bead(moved, Nozzle(LAG))
    assert found.oozed_ul == pytest.approx(LAG * flow, rel=1e-4)
    assert found.written_ul == pytest.approx(flow * 10.0 - LAG * flow, rel=1e-6)
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
    laid = bead_deposit(found, 0.05)
    ends = 4 / 3 * np.pi * radius**3
    assert laid.volume_mm3 == pytest.approx(dose + ends, rel=0.02)
    swollen = bead_deposit(found, 0.05, swell=1.2)
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
