"""Recorded Marlin transcripts, replayed to the simulated printer byte for byte.

Masked, as the recording's README allows: the build's date in M115; positions and step counts in
rows of `STOPPED_IN_MOTION`, which depend on when a stop came. Not reproduced: none of the rows.

The recorder wrote down when answers came, not how long it waited before it sent the next row.
`GAPS` holds those waits where they matter, found from the recorded positions and counts.
"""

import re

import pytest

from tests.sim.transcripts import differences, numbered, ping_pong, printer_of, rows_of


@pytest.mark.parametrize(("name", "count"), [("conf_avr.txt", 88), ("conf_avr2.txt", 58)])
def test_every_recorded_row_is_reproduced(name, count):
    rows = rows_of(name)
    assert len([row for row in rows if row.sent]) == count
    assert differences(printer_of(second_build=False), rows) == []


def test_second_build_is_reproduced_up_to_its_kill():
    rows = rows_of("conf_avr3_stock_noEP_advok.txt")
    killed = next(i for i, row in enumerate(rows) if b"kill()" in row.expected)
    assert killed == 10
    assert differences(printer_of(second_build=True), rows[: killed + 1]) == []


def test_second_build_tells_free_places_as_planner_and_queue_fill():
    rows = rows_of("conf_avr3_stock_noEP_advok.txt")
    killed = next(i for i, row in enumerate(rows) if b"kill()" in row.expected)
    rest = rows[killed + 1 :]
    pings = [row for row in rest if re.search(r"N\d+$", row.title)]
    before, after = rest[: rest.index(pings[0])], rest[rest.index(pings[-1]) + 1 :]
    printer = printer_of(second_build=True)
    assert differences(printer, before) == []
    assert ping_pong(printer, len(pings)) == [row.expected for row in pings]
    assert differences(printer, after) == []
    assert printer.dead


@pytest.mark.parametrize("second_build", [True, False])
def test_m112_behind_full_queues_waits_without_emergency_parser_only(second_build):
    rows = rows_of("conf_avr4_m112_window.txt")
    first, second = (i for i, row in enumerate(rows) if row.title.startswith("==="))
    mine = rows[first + 1 : second] if second_build else rows[second + 1 :]
    assert [row.sent for row in mine] == [b"M302 P1\nG92 X0\n", b"N0 M110 N0*125\n", b"M112\n"]
    printer = printer_of(second_build)
    assert differences(printer, mine[:2]) == []
    ping_pong(printer, 18)
    printer.receive(b"".join(numbered(n) for n in range(19, 23)))
    printer.advance(0.4)
    assert printer.take_output() == b""
    assert differences(printer, mine[2:]) == []
    assert printer.dead
