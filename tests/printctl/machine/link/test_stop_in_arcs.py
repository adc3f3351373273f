"""Stop during an arc: Marlin continues generating segments after M410."""

from __future__ import annotations

import numpy as np
import pytest

from printctl.machine.link.states import LinkState
from tests.printctl.machine.link.test_stop_in_waits import HEADER, MARLIN, Moment, stopped

CIRCLES = HEADER + "G3 X90 Y50 I20 J0 E0.5 F900\nG3 X50 Y50 I-20 J0 E1.0 F900\n" * 2
MIDDLE, RADIUS_MM = np.array([70.0, 50.0]), 20.0


@pytest.mark.parametrize("parser", [True, False])
@pytest.mark.parametrize("after_s", [0.4, 1.5, 3.0])
def test_a_stop_in_an_arc_never_leaves_the_arc(tmp_path, after_s, parser):
    printer = MARLIN.model_copy(update={"emergency_parser": parser})
    status, wire = stopped(Moment(b"G3 X50", after_s), tmp_path, printer, job=CIRCLES)
    assert (status.state, status.position_known) == (LinkState.STOPPED, True), status
    motion = wire.printer.executed()
    across = np.any(motion.start[:, :2] != motion.end[:, :2], axis=1)
    middles = (motion.start[across, :2] + motion.end[across, :2]) / 2
    away = np.linalg.norm(middles - MIDDLE, axis=1) - RADIUS_MM
    assert np.abs(away).max() < 0.05
    stood = motion.end[across][-1, :2]
    assert np.linalg.norm(stood - [50.0, 50.0]) > 1.0  # the circle isn't made to its end


@pytest.mark.parametrize("parser", [True, False])
def test_nothing_is_begun_behind_the_arc(tmp_path, parser):
    printer = MARLIN.model_copy(update={"emergency_parser": parser})
    job = CIRCLES + "G1 X50 Y20 E1.2\n"
    _, wire = stopped(Moment(b"G1 X50", 0.0), tmp_path, printer, job=job)
    assert wire.printer.executed().end[:, 1].min() > 29.9
