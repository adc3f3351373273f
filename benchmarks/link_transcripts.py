"""Replay recorded Marlin transcripts to the simulated printer, row by row."""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Any

from benchmarks.machine import row
from tests.sim.transcripts import Row, differences, numbered, ping_pong, printer_of, rows_of

Found = tuple[int, int]
"""Rows that differ, and rows."""


def transcript_rows() -> Iterator[dict[str, Any]]:
    """Rows of all four recordings; masked as their README allows."""
    found = [*map(_whole, ("conf_avr.txt", "conf_avr2.txt")), _second_build()]
    found += [_behind_full_queues(True), _behind_full_queues(False)]
    different, count = (sum(numbers) for numbers in zip(*found, strict=True))
    made = row("transcript rows that differ", different, f"of {count}", "0", not different)
    yield made | {"clock": "virtual", "masked": "build date; counts of stops in motion"}


def _whole(name: str) -> Found:
    rows = rows_of(name)
    return len(differences(printer_of(second_build=False), rows)), len(rows)


def _second_build() -> Found:
    """Up to its kill, then from its reset on with lines sent one by one."""
    rows = rows_of("conf_avr3_stock_noEP_advok.txt")
    killed = next(i for i, one in enumerate(rows) if b"kill()" in one.expected)
    found = len(differences(printer_of(second_build=True), rows[: killed + 1]))
    rest = rows[killed + 1 :]
    pings = [one for one in rest if re.search(r"N\d+$", one.title)]
    first, after = rest.index(pings[0]), rest.index(pings[-1]) + 1
    printer = printer_of(second_build=True)
    found += len(differences(printer, rest[:first]))
    answers = ping_pong(printer, len(pings))
    found += sum(a != one.expected for a, one in zip(answers, pings, strict=True))
    return found + len(differences(printer, rest[after:])), len(rows)


def _behind_full_queues(second_build: bool) -> Found:
    rows = rows_of("conf_avr4_m112_window.txt")
    first, second = (i for i, one in enumerate(rows) if one.title.startswith("==="))
    mine: list[Row] = rows[first + 1 : second] if second_build else rows[second + 1 :]
    printer = printer_of(second_build)
    found = len(differences(printer, mine[:2]))
    ping_pong(printer, 18)
    printer.receive(b"".join(numbered(n) for n in range(19, 23)))
    printer.advance(0.4)
    found += printer.take_output() != b""
    return found + len(differences(printer, mine[2:])), len(mine)
