"""The recorded transcripts, replayed to the simulated printer: every row, byte for byte.

Masked, as the recording's README allows: the build's date in M115; positions and step counts in
rows of `STOPPED_IN_MOTION`, which depend on when a stop came. Not reproduced: none of the rows.

The recorder wrote down when answers came, not how long it waited before it sent the next row.
`GAPS` holds those waits where they matter, found from the recorded positions and counts.
"""

import re

import pytest

from firmware_profiles import Printer, load
from sim.gcode import checksum
from sim.marlin import MarlinPrinter
from sim.marlin_board import Board
from tests.sim.transcripts import Row, rows_of

UNWIRED = Board(thermistors=False)
DEFAULT_GAP_S = 0.7
AFTER_ANSWER_S = 0.2

GAPS = {
    "long move then M410 1 s later": 1.0,
    "slow moves; then M410 0.5 s later": 0.5,
    "slow moves; then M112 0.5 s later": 0.5,
    # The arc and M155 before M500: G92 then finds the motors at 23723 steps.
    "G2": 0.8145,
    "M155 no arg": 0.8145,
    # No answer within the recorder's patience: the EEPROM is being written.
    "M500": 2.0,
    "20 G1 lines (280 B) in one write, 115200: RX buffer 128, BUFSIZE 4, planner 16": 6.0,
    "30 numbered lines in one write (563 B): overflow?": 6.0,
}
AFTER_STORE_S = 1.29
"""After the G92 that follows M500: the arc's last block ends 263 ms into the next row."""

STOPPED_IN_MOTION = {
    "pos after M410": 20,
    "b'M114\\n'": 10,
    "slow moves; then M112 0.5 s later": 10,
    "b'G92 X0\\n'": 80,
}
"""Steps by which a count may differ."""

NUMBER = re.compile(rb"-?\d+\.\d+|\d+")
BUILD = re.compile(rb"\(Nov 20 2026 \d\d:\d\d:\d\d\)")


def printer_of(second_build: bool) -> MarlinPrinter:
    profile = load(Printer, "marlin_avr")
    if second_build:
        profile = profile.model_copy(update={"emergency_parser": False, "advanced_ok": True})
    return MarlinPrinter(profile, board=UNWIRED)


def gap_of(row: Row) -> float:
    if row.sent == b"G92 X0\n" and b"Stored" in row.expected:
        return AFTER_STORE_S
    return GAPS.get(row.title, max(row.last_s + AFTER_ANSWER_S, DEFAULT_GAP_S))


def same(answer: bytes, row: Row) -> bool:
    masked, expected = BUILD.sub(b"DATE", answer), BUILD.sub(b"DATE", row.expected)
    if masked == expected:
        return True
    steps = STOPPED_IN_MOTION.get(row.title or repr(row.sent))
    if steps is None or NUMBER.sub(b"#", masked) != NUMBER.sub(b"#", expected):
        return False
    pairs = zip(NUMBER.findall(masked), NUMBER.findall(expected), strict=True)
    return all(abs(float(a) - float(b)) <= steps for a, b in pairs)


def differences(printer: MarlinPrinter, rows: list[Row]) -> list[tuple[str, bytes, bytes]]:
    found = []
    for row in rows:
        begin = printer.now
        if "hardware reset" in row.title:
            printer.reset()
        printer.receive(row.sent)
        printer.run_to(begin + gap_of(row))
        answer = printer.take_output()
        if not same(answer, row):
            found.append((row.title or repr(row.sent), row.expected, answer))
    return found


@pytest.mark.parametrize(("name", "count"), [("conf_avr.txt", 88), ("conf_avr2.txt", 58)])
def test_every_recorded_row_is_reproduced(name, count):
    rows = rows_of(name)
    assert len([row for row in rows if row.sent]) == count
    assert differences(printer_of(second_build=False), rows) == []


PING_S = 0.27
"""Between the recorder's single lines: 8 of them a 2 s block, one block ends at N9 and N17."""


def ping_pong(printer: MarlinPrinter, count: int) -> list[bytes]:
    """N1 … one by one, each a move of 2 s."""
    answers = []
    for number in range(1, count + 1):
        printer.receive(numbered(number))
        printer.advance(PING_S)
        answers.append(printer.take_output())
    return answers


def numbered(number: int) -> bytes:
    body = b"N%d G1 X%d F600" % (number, 20 * (number % 2))
    return b"%s*%d\n" % (body, checksum(body))


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
