"""Format records of report.json as table rows of text cells with sort keys and marks."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, Final, Literal

import numpy as np
from numpy.typing import NDArray

from kernels.arrays import FloatArray
from registration.json_ready import Record, is_number
from report.wording import MISSING, decimals_for, fixed, plain

MAX_ROWS: Final = 1000
"""Rows a table of the page shows at most; report.json has them all."""


@dataclass(frozen=True)
class Column:
    """How one key of the records is shown.

    Attributes
    ----------
    key : str
        Of the record.
    label, unit : str
        Of the heading.
    kind : "number" or "text" or "mark" or "signed"
        A mark is a bool, shown as a word with a colour; signed numbers carry their plus.
    factor : float
        Multiplies a number before it is shown.
    digits : int
        Significant digits of the column's largest number; the others share its decimals.
    """

    key: str
    label: str
    unit: str = ""
    kind: Literal["number", "text", "mark", "signed"] = "number"
    factor: float = 1.0
    digits: int = 3

    @property
    def numeric(self) -> bool:
        """Whether the column is set flush right."""
        return self.kind in ("number", "signed")


@dataclass(frozen=True)
class Cell:
    """One cell: what is read, what is sorted by, and a mark (good, bad) if it has one."""

    text: str
    order: str
    mark: Literal["", "good", "bad"] = ""


@dataclass(frozen=True)
class Row:
    """Cells, the vessel of the 3D view they belong to, and the bar's two shares of its track."""

    cells: Sequence[Cell]
    vessel: int | None = None
    bar: tuple[float, float] | None = None


@dataclass(frozen=True)
class Table:
    """A table ready for the template.

    Attributes
    ----------
    name : str
        Distinguishes it on the page.
    total : int
        Records there were, of which ``rows`` shows the first `MAX_ROWS`.
    order : str
        By what those were chosen, for the reader.
    """

    name: str
    columns: Sequence[Column]
    rows: Sequence[Row]
    total: int
    order: str = ""
    bars: bool = field(default=False)


def make_table(
    name: str,
    records: Sequence[Record],
    columns: Sequence[Column],
    bar_keys: tuple[str, str] | None = None,
    order: str = "",
) -> Table:
    """Set records into columns; a column that no record fills is left out.

    Parameters
    ----------
    records : sequence of mappings
        Any key may be missing.
    bar_keys : (str, str) or None
        Keys of two numbers to be drawn against each other (designed, measured).
    order : str
        By what the records are sorted, told to the reader where rows are left out.
    """
    used = [c for c in columns if any(r.get(c.key) is not None for r in records)]
    decimals = {c.key: decimals_for([_scaled(r, c) for r in records], c.digits) for c in used}
    top = max((r[k] for r in records for k in bar_keys or () if is_number(r.get(k))), default=0)
    rows = [
        Row([_cell(r, c, decimals[c.key]) for c in used], vessel_index(r), _bar(r, bar_keys, top))
        for r in records[:MAX_ROWS]
    ]
    bars = any(row.bar is not None for row in rows)
    return Table(name, used, rows, len(records), order, bars)


def vessel_index(record: Record) -> int | None:
    """Number of the network's vessel a record speaks of, if it names one."""
    vessel = record.get("vessel")
    if isinstance(vessel, int) and not isinstance(vessel, bool):
        return vessel
    if isinstance(vessel, str) and vessel.isascii() and vessel.isdigit():
        return int(vessel)
    return None


def columns(rows: Sequence[Record], keys: Sequence[str], count: int) -> dict[str, FloatArray]:
    """The records' values by key and number of vessel; only keys with any value."""
    by_key = {key: per_vessel(rows, key, count) for key in keys}
    return {key: values for key, values in by_key.items() if np.isfinite(values).any()}


def per_vessel(rows: Sequence[Record], key: str, count: int) -> NDArray[np.float64]:
    """The records' values by number of vessel, (count,); NaN where there is none."""
    values = np.full(count, np.nan)
    for row in rows:
        index, value = vessel_index(row), row.get(key)
        if index is not None and 0 <= index < count and is_number(value):
            values[index] = float(value)
    return values


def _scaled(record: Record, column: Column) -> Any:
    value = record.get(column.key)
    if not is_number(value):
        return None
    return value if column.factor == 1.0 else value * column.factor


def _cell(record: Record, column: Column, decimals: int) -> Cell:
    value = record.get(column.key)
    if column.kind == "mark":
        return _marked(value)
    if column.kind == "text":
        text = MISSING if value is None else plain(value)
        return Cell(text, repr(value) if is_number(value) else text)
    scaled = _scaled(record, column)
    text = fixed(scaled, decimals)
    if column.kind == "signed" and scaled is not None and scaled > 0:
        text = f"+{text}"
    return Cell(text, "" if scaled is None else repr(float(scaled)))


def _marked(value: Any) -> Cell:
    if not isinstance(value, bool):
        return Cell(MISSING, "")
    return Cell("yes", "1", "good") if value else Cell("no", "0", "bad")


def _bar(record: Record, keys: tuple[str, str] | None, top: float) -> tuple[float, float] | None:
    if keys is None or top <= 0 or not all(is_number(record.get(k)) for k in keys):
        return None
    first, second = (max(100.0 * record[k] / top, 0.0) for k in keys)
    return (first, second)
