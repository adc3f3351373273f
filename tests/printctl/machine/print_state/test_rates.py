"""Speed and flow that a print is said to have are those of its next command."""

from __future__ import annotations

import time

import numpy as np
import pytest

from printctl.machine.prints.progress import JobTable, progress
from printctl.machine.records.replay import JournalledPrint
from printctl.machine.records.states import LinkState, Status

COUNT = np.zeros(4, dtype=np.int64)
TABLE = JobTable(
    time_s=np.array([0.0, 2.0, 3.0, 3.0]),
    ink_ul=np.array([0.0, 1.0, 1.0, 1.0]),
    plunger_mm=np.zeros(4),
    file_line=np.arange(4),
    layer=COUNT,
    vessel=COUNT,
    layers_done=COUNT,
    vessels_done=COUNT,
    tip_mm=np.array([[0, 0, 0], [6, 8, 0], [6, 8, 5], [6, 8, 5]], dtype=float),
    layer_count=1,
)


@pytest.mark.parametrize(
    ("executed", "state", "speed_mm_s", "flow_ul_s"),
    [
        (0, LinkState.PRINTING, 5.0, 0.5),
        (1, LinkState.PRINTING, 5.0, 0.0),
        (2, LinkState.PRINTING, None, None),  # a command that takes no time
        (3, LinkState.PRINTING, None, None),
        (0, LinkState.STOPPED, None, None),
    ],
)
def test_speed_and_flow_are_of_the_next_command(
    executed: int, state: LinkState, speed_mm_s: float | None, flow_ul_s: float | None
) -> None:
    status = Status(state, lines_done=executed, lines_executed=executed)
    made = progress(TABLE, status, JournalledPrint(), time.time(), None)
    assert (made.speed_mm_s, made.flow_ul_s) == (speed_mm_s, flow_ul_s)
