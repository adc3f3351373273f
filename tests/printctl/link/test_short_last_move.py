"""Job whose last move is too short for the firmware to execute."""

from __future__ import annotations

import pytest

from printctl.link.states import LinkState
from tests.printctl.link.simulated import gcode, printed, wire


@pytest.mark.parametrize("moves", [3, 40])
def test_last_move_below_the_firmwares_least_steps_is_no_renamed_place(tmp_path, moves):
    """Seen on a real Marlin: 5 steps of X and Y short of the place that it tells."""
    last = 50 + (moves - 1) % 2 * 3.5
    status, _ = printed(gcode(moves) + b"G1 X%.4f\n" % (last + 0.0625), tmp_path, wire())
    assert status.state is LinkState.DONE
    assert status.position_known
