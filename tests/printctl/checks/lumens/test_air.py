"""Pneumatic head's line widths: from feed rates, and as simulated."""

from __future__ import annotations

import numpy as np
import pytest

from design.network import VesselNetwork
from firmware_profiles import Printer, load
from firmware_profiles.bead import BeadSection
from printctl.checks.lumens import Writing, check_network, read_filaments, read_layers, read_lines
from printctl.errors import UsageError
from sim.gcode.deposit.pneumatic import pneumatic_deposit
from sim.gcode.dry_run.run import dry_run
from tests.printctl.checks.lumens.small_gcode import (
    LAYER_MM,
    LINE_MM,
    UL_PER_E,
    gcode,
    section,
    tube,
)
from tests.printctl.checks.lumens.written_filaments import valve_gcode

PRINTER = load(Printer, "pneumatic_marlin")
HEAD = PRINTER.pneumatic
assert HEAD is not None
FLOW, SPEED, LAYERS = 0.09, 0.09 / section(LINE_MM), 8
"""The flow that makes lines of the small prints' width at 10 mm/s."""
WRITING = Writing(PRINTER, flow_ul_s=FLOW)
CENTRE = (20.0, 30.0)


def tubes(speed: float = SPEED) -> bytes:
    passes = []
    for k in range(LAYERS):
        height = np.full((97, 1), (k + 1) * LAYER_MM)
        passes += [(np.hstack([ring, height]), speed) for ring in tube(0.3, centre=CENTRE)]
    return valve_gcode(passes, HEAD.opens, HEAD.closes, HEAD.opening_delay_s)


def test_lines_are_those_that_a_plunger_would_write() -> None:
    air, _ = read_layers(tubes(), WRITING)
    pushed = read_lines(gcode([tube(0.3, centre=CENTRE)] * LAYERS), UL_PER_E)
    assert len(air) == len(pushed)
    assert air.width == pytest.approx(pushed.width, rel=1e-3)
    assert air.start == pytest.approx(pushed.start, abs=1e-4)
    assert air.layer.tolist() == pushed.layer.tolist()


def test_the_dry_run_lays_more_where_the_head_is_slow() -> None:
    """A move of length s from stand to stand takes s/v + v/a: a short one gets more per mm.

    A little less, since Marlin's motors don't begin from zero.
    """
    passes = [
        ([[10, y, (k + 1) * LAYER_MM], [10 + way, y, (k + 1) * LAYER_MM]], SPEED)
        for k in range(3)
        for y, way in ((10.0, 20.0), (11.0, 1.0))
    ]
    file = valve_gcode(passes, HEAD.opens, HEAD.closes, HEAD.opening_delay_s)
    ideal, ran = read_layers(file, WRITING)
    more = SPEED / PRINTER.acceleration_mm_s2
    asked = section(LINE_MM)
    laid = BeadSection().area(ran.width, LAYER_MM)
    assert laid[::2] == pytest.approx(asked * (1 + more * SPEED / 20), rel=2e-3)
    assert (laid[1::2] < asked * (1 + more * SPEED)).all()
    assert (laid[1::2] > asked * (1 + 0.7 * more * SPEED)).all()
    assert ran.start * 80 == pytest.approx(np.rint(ran.start * 80), abs=1e-6)
    assert ideal.width == pytest.approx(LINE_MM, rel=1e-6)


def test_a_tube_is_open_and_half_the_speed_closes_it() -> None:
    network = VesselNetwork.from_segments(
        np.array([[0, 0, 0], [0, 0, LAYERS * LAYER_MM]]), np.array([[0, 1]]), np.array([0.3]),
        np.zeros(1, np.int64), np.zeros(1, np.int64),
    )  # fmt: skip
    place = np.array([*CENTRE, 0.0])
    lines, ran = read_layers(tubes(), WRITING)
    found = check_network(lines, network, place, ran, 0.05)
    assert found.refusal is None
    assert found.ideal.narrowest_mm[0] == pytest.approx(0.6, abs=3e-3)
    # Lines of four times the ink about a lumen of 0.6 whose innermost axis is at 0.375.
    slow, ran = read_layers(tubes(SPEED / 4), WRITING)
    wide = LINE_MM + 3 * section(LINE_MM) / LAYER_MM
    swollen = check_network(slow, network, place, ran, 0.05)
    assert swollen.ideal.narrowest_mm[0] == pytest.approx(0.75 - wide, abs=6e-3)
    assert swollen.ideal.conductance[0] < 0.02


def test_filaments_of_a_valve_are_as_thick_as_flow_over_speed() -> None:
    way = [[10, 10, 5], [20, 10, 5], [20, 14, 5]]
    file = valve_gcode([(way, 2.0)], HEAD.opens, HEAD.closes, HEAD.opening_delay_s)
    ideal, ran = read_filaments(file, WRITING)
    thick = 2 * np.sqrt(FLOW / 2.0 / np.pi)
    assert 2 * ideal.radius == pytest.approx(np.full(2, thick), rel=1e-6)
    assert 2 * np.median(ran.radius) == pytest.approx(thick, rel=0.01)


def test_a_file_that_never_opens_the_valve_or_a_flow_that_nobody_knows_is_refused() -> None:
    plunger = gcode([tube(0.3)] * 2)
    with pytest.raises(UsageError, match="valve open"):
        read_layers(plunger, WRITING)
    with pytest.raises(UsageError, match="--flow-ul-s"):
        read_layers(tubes(), Writing(PRINTER))


def test_the_lines_hold_the_ink_that_the_deposit_model_lays() -> None:
    file = tubes()
    _, ran = read_layers(file, WRITING)
    run = dry_run(file, PRINTER)
    laid = pneumatic_deposit(run.executed, file, PRINTER, FLOW, 0.03)
    length = np.linalg.norm(ran.end - ran.start, axis=1)
    high = (ran.high - ran.low)[ran.layer]
    held = (BeadSection().area(ran.width, high) * length).sum()
    assert held == pytest.approx(laid.written_ul, rel=1e-9)
