"""Read a calibration's CSV file: named columns, units in the names, ``# key=value`` on top."""

from __future__ import annotations

import csv
import math
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from printctl.checks.made_for import MadeFor, read_made_for
from printctl.errors import UsageError


@dataclass(frozen=True)
class Readings:
    """A table of readings.

    Attributes
    ----------
    numbers : dict of str to (n,) float64
    words : dict of str to list of str
        Columns that aren't numbers.
    last_digit : dict of str to float
        Of each column of numbers, the finest that stands in it: 0.01 for 12.30, 1 for 12.
    facts : dict of str to float
        What the lines ``# key=value`` say, as `printctl calibrate` wrote them.
    header : list of str
        Columns that are there, wanted or not.
    recorded : MadeFor
        Set-up of the test, as its lines ``# printctl part: name`` have it; empty in a sheet of
        one's own.
    """

    numbers: dict[str, NDArray[np.float64]]
    words: dict[str, list[str]]
    facts: dict[str, float]
    last_digit: dict[str, float] = field(default_factory=dict)
    recorded: MadeFor = field(default_factory=dict)
    header: list[str] = field(default_factory=list)

    def __len__(self) -> int:
        return len(next(iter(self.numbers.values())))


def read_readings(path: Path, numbers: tuple[str, ...], words: tuple[str, ...] = ()) -> Readings:
    """Read a file; rows whose last number is empty weren't measured and are left out.

    Raises
    ------
    UsageError
        For a missing file or column, or what isn't a number; the message names the line.
    """
    try:
        lines = path.read_text(encoding="utf-8-sig").splitlines()
    except OSError as exc:
        raise UsageError(f"{path} can't be read: {exc.strerror}; give a CSV file") from exc
    except UnicodeDecodeError as exc:
        raise UsageError(f"{path} isn't a text file; give a CSV file in UTF-8") from exc
    facts = _facts(lines)
    kept = [(at, text) for at, text in enumerate(lines, 1) if text.strip() and text[0] != "#"]
    if not kept:
        raise UsageError(f"{path} is empty; it wants the columns {', '.join((*words, *numbers))}")
    header = [name.strip() for name in next(csv.reader([kept[0][1]]))]
    missing = [name for name in (*numbers, *words) if name not in header]
    if missing:
        raise UsageError(
            f"{path}, line {kept[0][0]}: no column {missing[0]!r} (there are {', '.join(header)}); "
            f"it wants {', '.join((*words, *numbers))}, units as in the names"
        )
    rows = [(at, _row(path, at, header, next(csv.reader([text])))) for at, text in kept[1:]]
    rows = [(at, row) for at, row in rows if row.get(numbers[-1])]
    if not rows:
        raise UsageError(f"{path} has no reading in the column {numbers[-1]!r}; fill it in")
    return Readings(
        {name: np.array([_number(path, at, name, row) for at, row in rows]) for name in numbers},
        {name: [row.get(name, "") for _, row in rows] for name in words},
        facts,
        {name: min(_last_digit(row[name]) for _, row in rows) for name in numbers},
        read_made_for("\n".join(lines).encode()),
        header,
    )


def _row(path: Path, at: int, header: list[str], values: list[str]) -> dict[str, str]:
    if len(values) > len(header) and any(values[len(header) :]):
        raise UsageError(
            f"{path}, line {at}: {len(values)} values for {len(header)} columns; a decimal comma "
            "counts as a column's end: write 1.25, not 1,25"
        )
    return dict(zip(header, map(str.strip, values), strict=False))


def _facts(lines: list[str]) -> dict[str, float]:
    facts = {}
    for text in lines:
        if text.startswith("#"):
            key, _, value = text[1:].partition("=")
            try:
                facts[key.strip()] = float(value)
            except ValueError:
                continue
    return facts


def _last_digit(text: str) -> float:
    """Step of the last digit as written: ``12.30`` has 0.01, ``1.5e-3`` has 1e-4."""
    mantissa, _, power = text.lower().partition("e")
    return float(10.0 ** (int(power or 0) - len(mantissa.partition(".")[2])))


def _number(path: Path, at: int, name: str, row: dict[str, str]) -> float:
    try:
        value = float(row.get(name, ""))
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise UsageError(
            f"{path}, line {at}: {name} is {row.get(name, '')!r}, not a number; write it like 1.25"
        )
    return value
