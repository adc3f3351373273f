"""Read and replay recorded transcripts."""

import ast
import re
from dataclasses import dataclass, field
from pathlib import Path

from firmware_profiles import Printer, load
from gcode.motion.state import Board
from gcode.program.gcode import checksum
from sim.devices.families.marlin_printer import MarlinPrinter

DATA = Path(__file__).parent / "data" / "marlin"

_SENT = re.compile(r">> (b['\"].*)")
_REPLY = re.compile(r"<<\s+([\d.]+) ms (b['\"].*)")
_PING = re.compile(r"(N\d+) -> (\[.*\])")


@dataclass
class Row:
    """What was sent at one moment, and all that came before the next was."""

    title: str
    sent: bytes
    replies: list[tuple[float, bytes]] = field(default_factory=list)

    @property
    def expected(self) -> bytes:
        return b"".join(data for _, data in self.replies)

    @property
    def last_s(self) -> float:
        return self.replies[-1][0] * 1e-3 if self.replies else 0.0


def rows_of(name: str) -> list[Row]:
    """Rows of a transcript; notes of the recorder become rows that send nothing."""
    rows: list[Row] = []
    title = ""
    for text in (DATA / name).read_text(encoding="ascii").splitlines():
        if sent := _SENT.fullmatch(text):
            rows.append(Row(title, ast.literal_eval(sent[1])))
            title = ""
        elif reply := _REPLY.fullmatch(text):
            if title:
                rows.append(Row(title, b""))
                title = ""
            rows[-1].replies.append((float(reply[1]), ast.literal_eval(reply[2])))
        elif ping := _PING.fullmatch(text):
            answers = [(0.0, answer) for answer in ast.literal_eval(ping[2])]
            rows.append(Row(f"{title} {ping[1]}".strip(), b"", answers))
        elif text.startswith("## "):
            title = text[3:]
        elif text.startswith("==="):
            rows.append(Row(text, b""))
    return rows


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


PING_S = 0.27
"""Between the recorder's single lines: 8 of them a 2 s block, one block ends at N9 and N17."""


def ping_pong(printer: MarlinPrinter, count: int) -> list[bytes]:
    """N1 … one by one, each a move of 2 s."""
    answers = []
    for number in range(1, count + 1):
        printer.receive(ping(number))
        printer.advance(PING_S)
        answers.append(printer.take_output())
    return answers


def ping(number: int) -> bytes:
    return numbered(number, f"G1 X{20 * (number % 2)} F600")


def numbered(number: int, text: str) -> bytes:
    """A line with its number and checksum."""
    body = f"N{number} {text}".encode()
    return b"%s*%d\n" % (body, checksum(body))
