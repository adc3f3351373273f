"""Lumen openings of an embedded print, from known filaments."""

from __future__ import annotations

import numpy as np
import pytest

from design.network import VesselNetwork
from firmware_profiles import Printer, load
from firmware_profiles.materials.bead import BeadSection
from gcode.dry_run.run import dry_run
from printctl.checks.lumens import (
    FilamentCheck,
    Writing,
    check_filaments,
    read_filaments,
    read_layers,
)
from printctl.checks.lumens.filament_check import segment_distances
from printctl.errors import UsageError
from tests.gcode.air_ink import pneumatic_deposit
from tests.printctl.checks.lumens.small_gcode import (
    LAYER_MM,
    LINE_MM,
    UL_PER_E,
    gcode,
    plunger_gcode,
    section,
    tube,
    valve_gcode,
)
from tests.printctl.networks import vessels

PRINTER = load(Printer, "generic_marlin")
WRITING = Writing(PRINTER, UL_PER_E)
HERE = np.zeros(3)
A, FORK = (10.0, 10.0, 5.0), (14.0, 10.0, 6.0)
B, C = (18.0, 12.0, 6.0), (18.0, 8.0, 8.0)


def fork(radii: tuple[float, float, float] = (0.4, 0.3, 0.3), trees=(0, 0, 0)) -> VesselNetwork:
    nodes = np.array([A, FORK, B, C])
    ends = np.array([[0, 1], [1, 2], [1, 3]])
    return VesselNetwork.from_segments(
        nodes, ends, np.array(radii), np.zeros(3, np.int64), np.array(trees)
    )


def check(passes, network: VesselNetwork, place=HERE, **more) -> FilamentCheck:
    ideal, stepped = read_filaments(plunger_gcode(passes, **more), WRITING)
    return check_filaments(ideal, stepped, network, place, 0.05)


def test_vessels_are_as_open_as_their_filaments_are_thick() -> None:
    found = check([([A, FORK], 0.8), ([FORK, B], 0.6), ([FORK, C], 0.5)], fork())
    assert found.refusal is None
    assert found.ideal.narrowest_mm == pytest.approx([0.8, 0.6, 0.5], abs=1e-3)
    assert found.ideal.conductance[1] == pytest.approx(1.0, abs=5e-3)
    # Poiseuille: (0.5 / 0.6)^4, but for the fork's own zone, which the others' ink fills.
    assert 0.48 < found.ideal.conductance[2] < 0.56
    assert found.passes == 3
    assert found.joints == pytest.approx([0.5 / 0.6], abs=0.01)


def test_a_vessel_that_the_plan_left_out_is_no_reason_to_refuse() -> None:
    """`toolpath.leave_out`, a refused crossing's remedy, was refused here (2026-11-26)."""
    ideal, stepped = read_filaments(plunger_gcode([([A, FORK, B], 0.8)]), WRITING)
    found = check_filaments(ideal, stepped, fork(), HERE, 0.05, frozenset({2}))
    assert found.refusal is None
    assert found.ideal.closed.tolist() == [False, False, True]
    other = check_filaments(ideal, stepped, fork(), HERE, 0.05, frozenset({1}))
    assert "not written through: vessel 2 (1 of 3)" in str(other.refusal)


def test_filaments_that_only_touch_leave_a_neck() -> None:
    """Two balls of radius 0.3 whose middles are 0.4 apart meet in a circle of radius √0.05."""
    network = vessels([[10, 10, 5], [20, 10, 5]], radius=0.3)
    passes = [([[10, 10, 5], [14.8, 10, 5]], 0.6), ([[15.2, 10, 5], [20, 10, 5]], 0.6)]
    found = check(passes, network)
    assert found.ideal.narrowest_mm[0] == pytest.approx(2 * np.sqrt(0.05), abs=0.02)
    assert found.refusal is None


def parallel(gap: float, trees: tuple[int, int]) -> VesselNetwork:
    """Two level vessels of 0.4 mm whose walls are designed ``gap`` apart."""
    return vessels(*([[10, y, 5], [20, y, 5]] for y in (10, 10.4 + gap)), tree=trees)


@pytest.mark.parametrize("trees", [(0, 0), (0, 1)])
def test_filaments_that_swell_into_each_other_merge(trees: tuple[int, int]) -> None:
    network = parallel(0.1, trees)
    paths = [network.points[network.offset[k] : network.offset[k + 1]] for k in (0, 1)]
    thin = check([(path, 0.4) for path in paths], network)
    assert thin.merges == ()
    thick = check([(path, 0.6) for path in paths], network)
    (merge,) = thick.merges
    assert merge.vessels == (0, 1)
    # Two circles of radius 0.3, 0.5 apart: half the chord is √(0.09 - 0.0625).
    assert merge.neck_mm == pytest.approx(2 * np.sqrt(0.09 - 0.25**2), abs=2e-3)
    if trees == (0, 1):
        assert "filaments of two trees merge: vessel 0 with 1" in str(thick.refusal)
    else:
        assert thick.refusal is None
        assert "merge beside their joints: 0 with 1" in thick.notes[0]


def test_distances_of_pieces_are_those_of_many_sampled_points() -> None:
    random = np.random.default_rng(1)
    ends = random.normal(size=(4, 40, 3))
    ends[1, 0] = ends[0, 0]  # a piece without length
    ends[3, 1] = ends[2, 1] + 2 * (ends[1, 1] - ends[0, 1])  # parallel ones
    away, at = segment_distances(*ends)
    share = np.linspace(0, 1, 201)
    for k in range(40):
        one = ends[0, k] + share[:, None] * (ends[1, k] - ends[0, k])
        other = ends[2, k] + share[:, None] * (ends[3, k] - ends[2, k])
        sampled = np.linalg.norm(one[:, None] - other[None], axis=2).min()
        assert away[k] <= sampled + 1e-9
        assert away[k] == pytest.approx(sampled, abs=0.02)
        assert np.isfinite(at[k]).all()


# --- ink of several heads, read at each tip's own position
PRINTER_HEADS = load(Printer, "two_syringe_marlin")
# Both tips' lines meet at x = 60: the second stands 40 mm beside the first.
JOB = b"""M218 T1 X0 Y0 Z0
M280 P1 S90
T0 S1
M280 P0 S10
G92 E0
G1 X50 Y50 Z10 F300
G1 X60 E1 F600
M280 P0 S90
T1 S1
G92 E0
M280 P1 S10
G1 X20 Y50 F3000
G1 X30 E2 F600
G1 Z10.1 F300
G1 X20 E4 F600
"""
START = (50.0, 50.0, 10.0)
AREAS = (0.15, 0.30)


def writing(**said: object) -> Writing:
    return Writing(PRINTER_HEADS, start_mm=START, **said)  # type: ignore[arg-type]


def layers(**said: object) -> Writing:
    return writing(layer_mm=0.1, beads=(BeadSection("rectangle"),), **said)


def test_layers_of_two_heads_lie_where_their_tips_were() -> None:
    for lines in read_layers(JOB, layers(ul_per_e_of_heads=AREAS)):
        np.testing.assert_allclose(lines.start[:, 0], [50, 60, 70], atol=1e-9)
        np.testing.assert_allclose(lines.end[:, 0], [60, 70, 60], atol=1e-9)
        assert lines.layer.tolist() == [0, 0, 1]
        # Cross-section over the layer: each head by its own syringe.
        np.testing.assert_allclose(lines.width, [0.15, 0.6, 0.6], rtol=1e-6)


# --- pneumatic head's line widths: from feed rates, and as simulated
PRINTER_AIR = load(Printer, "pneumatic_marlin")
HEAD = PRINTER_AIR.pneumatic
assert HEAD is not None
FLOW, SPEED, LAYERS = 0.09, 0.09 / section(LINE_MM), 8
"""The flow that makes lines of the small prints' width at 10 mm/s."""
WRITING_AIR = Writing(PRINTER_AIR, flow_ul_s=FLOW)
CENTRE = (20.0, 30.0)


def tubes(speed: float = SPEED) -> bytes:
    passes = []
    for k in range(LAYERS):
        height = np.full((97, 1), (k + 1) * LAYER_MM)
        passes += [(np.hstack([ring, height]), speed) for ring in tube(0.3, centre=CENTRE)]
    return valve_gcode(passes, HEAD.opens, HEAD.closes, HEAD.opening_delay_s)


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
    ideal, ran = read_layers(file, WRITING_AIR)
    more = SPEED / PRINTER_AIR.acceleration_mm_s2
    asked = section(LINE_MM)
    laid = BeadSection().area(ran.width, LAYER_MM)
    assert laid[::2] == pytest.approx(asked * (1 + more * SPEED / 20), rel=2e-3)
    assert (laid[1::2] < asked * (1 + more * SPEED)).all()
    assert (laid[1::2] > asked * (1 + 0.7 * more * SPEED)).all()
    assert ran.start * 80 == pytest.approx(np.rint(ran.start * 80), abs=1e-6)
    assert ideal.width == pytest.approx(LINE_MM, rel=1e-6)


def test_a_file_that_never_opens_the_valve_or_a_flow_that_nobody_knows_is_refused() -> None:
    plunger = gcode([tube(0.3)] * 2)
    with pytest.raises(UsageError, match="valve open"):
        read_layers(plunger, WRITING_AIR)
    with pytest.raises(UsageError, match="--flow-ul-s"):
        read_layers(tubes(), Writing(PRINTER_AIR))


def test_the_lines_hold_the_ink_that_the_deposit_model_lays() -> None:
    file = tubes()
    _, ran = read_layers(file, WRITING_AIR)
    run = dry_run(file, PRINTER_AIR)
    laid = pneumatic_deposit(run.executed, file, PRINTER_AIR, FLOW, 0.03)
    length = np.linalg.norm(ran.end - ran.start, axis=1)
    high = (ran.high - ran.low)[ran.layer]
    held = (BeadSection().area(ran.width, high) * length).sum()
    assert held == pytest.approx(laid.written_ul, rel=1e-9)
