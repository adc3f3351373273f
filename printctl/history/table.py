"""Tabulate the print history as CSV: days, verdicts, safe cells."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import fields, replace
from datetime import datetime, timedelta
from itertools import islice
from typing import Any, Final, Literal

from printctl.errors import UsageError
from printctl.machine.process.contact import alive
from printctl.machine.records.record import JOURNAL
from printctl.pipeline.past.past_print import INTERRUPTED, PrintEntry


def day_begins(text: str, where: str) -> float:
    """When a day begins here, s since 1970; 0 for no text.

    Raises
    ------
    UsageError
    """
    return _day(text, where).timestamp() if text else 0.0


def day_ends(text: str, where: str) -> float:
    """When the next day begins here, s since 1970; 0 for no text.

    Raises
    ------
    UsageError
    """
    return (_day(text, where) + timedelta(days=1)).timestamp() if text else 0.0


def _day(text: str, where: str) -> datetime:
    try:
        day = datetime.strptime(text, "%Y-%m-%d")
        if 1971 <= day.year <= 9000:
            return day
    except ValueError:
        pass
    raise UsageError(f"{where} {text[:40]!r} is no day; write it like 2026-11-21")


Outcome = Literal["pass", "fail", "undecided", ""]


def outcome(verdict: Mapping[str, Any] | None) -> Outcome:
    """``pass``, ``fail``, ``undecided`` (neither is proven), or empty for none."""
    if verdict is None or not isinstance(verdict.get("passed"), bool):
        return ""
    if verdict["passed"]:
        return "pass"
    return "undecided" if verdict.get("undecided") is True else "fail"


HEADLINES: Final[dict[Outcome, str]] = {
    "pass": "Passed",
    "fail": "Failed",
    "undecided": "Undecided: the scan proves neither a pass nor a fail",
    "": "No verdict",
}
"""First line of a verdict, before its reasons."""


COLUMNS: Final = [field.name for field in fields(PrintEntry)]
_AT_ONCE: Final = 500
_TIMES: Final = ("started", "ended")
_DANGEROUS: Final = ("=", "+", "-", "@", "\t", "\r", "\n", "\uff1d", "\uff0b", "\uff0d", "\uff20")
"""What makes a spreadsheet calculate a cell (OWASP, CSV injection), full-width forms as well."""


def csv_lines(entries: Iterable[PrintEntry]) -> Iterator[str]:
    """The head, then a line a print, some hundred at once."""
    yield _lines([COLUMNS])
    waiting = iter(entries)
    while some := list(islice(waiting, _AT_ONCE)):
        yield _lines([[safe_cell(value) for value in row(entry)] for entry in some])


def tell_running(entry: PrintEntry) -> PrintEntry:
    """Tell a print that is going on from one whose link process died."""
    latest = entry.journal.name == JOURNAL and entry.state == INTERRUPTED
    if latest and entry.journal.exists() and alive(entry.journal.parent):
        return replace(entry, state="running")
    return entry


def row(entry: PrintEntry) -> list[Any]:
    """A print's values in the order of `COLUMNS`; times are local, alarms one text."""
    values = {name: getattr(entry, name) for name in COLUMNS}
    values |= {name: local_time(getattr(entry, name)) for name in _TIMES}
    values["journal"] = str(entry.journal)
    values["alarms"] = "; ".join(alarm.text for alarm in entry.alarms)
    return list(values.values())


def safe_cell(value: Any) -> Any:
    """A text that would be calculated gets an apostrophe before it, which spreadsheets hide."""
    if not isinstance(value, str):
        return value
    text = value.replace("\0", "")
    return f"'{text}" if text.lstrip(" \ufeff\u00a0").startswith(_DANGEROUS) else text


def local_time(seconds: float) -> str:
    """A time as people here write it; empty for none."""
    return f"{datetime.fromtimestamp(seconds):%Y-%m-%d %H:%M:%S}" if seconds > 0 else ""


def _lines(rows: list[list[Any]]) -> str:
    out = io.StringIO()
    csv.writer(out, lineterminator="\n").writerows(rows)
    return out.getvalue()
