"""Facts of a print on the first screen, in words."""

from __future__ import annotations

from typing import Any

import pytest

from printctl.web.job.print_facts import facts

PROGRESS = {
    "remaining_error_s": None,
    "ends_at": 0.0,
    "passes": False,
    "layer": 1,
    "layers": 2,
    "layers_done": 0,
    "vessels": 0,
    "ink_ul": 1.0,
    "ink_total_ul": 2.0,
    "ink_left_ul": None,
    "tip_mm": (53.5, 55.0, 10.0),
}


def told(state: str, **more: Any) -> dict[str, Any]:
    about = {"time_left_s": 1.0, "ended": False, "alarms": 0, "line_errors": 0, "last_alarm": ""}
    return {"state": state, "position_known": True, "progress": PROGRESS, **about, **more}


@pytest.mark.parametrize(
    ("state", "said"),
    [
        ("printing", "X53.50 Y55.00 Z10.00"),
        ("pausing", "X53.50 Y55.00 Z10.00"),
        ("paused", "raised from X53.50 Y55.00 Z10.00"),
        ("resuming", "raised from X53.50 Y55.00 Z10.00"),
        ("stopped", "raised from about X53.50 Y55.00 Z10.00"),
        ("done", "X53.50 Y55.00 Z10.00"),
    ],
)
def test_a_needle_that_a_pause_or_a_stop_has_raised_isn_t_told_to_be_in_the_part(state, said):
    assert facts(told(state), None)["tip"] == said
