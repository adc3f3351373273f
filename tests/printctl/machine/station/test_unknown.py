"""Unknown positions, inks and temperatures are shown as unknown, with the reason, in each state."""

from __future__ import annotations

from dataclasses import replace

import pytest

from printctl.cli.machine.station import _lines
from printctl.machine.control.board.heat import Temperature
from printctl.machine.control.idle.station_status import StationState, StationStatus, unknown_values
from printctl.machine.records.mounting import MountedParts

KNOWN = StationStatus(
    StationState.READY,
    position_mm=(10.0, 20.0, 30.0),
    position_trusted=True,
    homed=(True, True, True),
    ul_left=400.0,
    temperatures=(Temperature("nozzle", 21.0, 0.0),),
    mounted=MountedParts(syringe="hamilton_1ml"),
)
ALL = {"position", "ink", "temperatures"}


def test_a_printer_that_stands_by_homed_is_known() -> None:
    assert unknown_values(KNOWN) == {}
    assert "tip at X10.00 Y20.00 Z30.00" in list(_lines(KNOWN))
    assert KNOWN.to_dict()["unknown"] == {}
    assert StationStatus.from_dict(KNOWN.to_dict()) == KNOWN


@pytest.mark.parametrize("state", StationState)
def test_numbers_from_before_count_only_where_the_printer_answers(state: StationState) -> None:
    unknown = unknown_values(replace(KNOWN, state=state))
    if state in (StationState.READY, StationState.BUSY):
        assert unknown == {}
    elif state is StationState.PRINTING:  # the print itself counts them
        assert set(unknown) == {"position", "ink"}
    else:
        assert {"position", "temperatures"} <= set(unknown)
        assert all(unknown.values())


@pytest.mark.parametrize(
    ("change", "what", "reason"),
    [
        ({"position_mm": None}, "position", "hasn't reported it"),
        (
            {"position_trusted": False, "homed": (True, False, True)},
            "position",
            "Y not homed since the printer was connected, reset or stopped",
        ),
        ({"ul_left": None}, "ink", "the syringe's fill level wasn't set"),
        ({"ul_left": None, "mounted": MountedParts()}, "ink", "no syringe is specified"),
        ({"temperatures": ()}, "temperatures", "hasn't reported any"),
    ],
)
def test_what_is_unknown_says_why(change: dict[str, object], what: str, reason: str) -> None:
    status = replace(KNOWN, **change)  # type: ignore[arg-type]
    unknown = unknown_values(status)
    assert set(unknown) == {what}
    assert reason in unknown[what]
    told = " ".join(_lines(status))
    assert f"unknown: {unknown[what]}" in told
    assert "tip at" not in told or what != "position"
