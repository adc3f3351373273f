"""Ranked table of a search: CSV text at full precision, and the first rows for the terminal."""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Sequence
from typing import Any, Final

from printctl.search.quantities import QUANTITIES
from printctl.search.rank import RankedCandidate
from printctl.search.run import SearchResult

FIRST: Final = 10
"""Rows on the terminal."""


def ranked_csv(result: SearchResult) -> str:
    """The table as CSV: what is varied, the objectives, then all else that was measured.

    Nothing in it tells when or where a candidate was grown.
    """
    search = result.drawn.search
    rest = [name for name in QUANTITIES if name not in search.objectives]
    names = [*search.objectives, *rest]
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    head = ["rank", "candidate", "state", "score", "front"]
    writer.writerow([*head, *search.vary, *names, "said", "key"])
    for row in result.rows:
        one = row.candidate
        cells = [row.rank, one.number, row.state, row.score, row.front]
        varied = [_cell(one.values[key]) for key in search.vary]
        measured = [row.numbers.get(name) for name in names]
        writer.writerow([*cells, *varied, *measured, row.said, one.key])
    return text.getvalue()


def _cell(value: Any) -> Any:
    return json.dumps(value) if isinstance(value, list | tuple | dict | bool) else value


def table_lines(result: SearchResult) -> list[str]:
    """The best rows in columns, for people."""
    search, rows = result.drawn.search, result.rows[:FIRST]
    head = ["rank", "front", "score", *(key.rpartition(".")[2] for key in search.vary)]
    cells = [[*head, *search.objectives], *(_row(result, row) for row in rows)]
    wide = [max(len(line[k]) for line in cells) for k in range(len(cells[0]))]
    shown = [
        "  ".join(cell.rjust(width) for cell, width in zip(line, wide, strict=True))
        for line in cells
    ]
    more = [""] + [row.said.split("\n")[0] for row in rows]
    return [f"{line}  {note}".rstrip() for line, note in zip(shown, more, strict=True)]


def _row(result: SearchResult, row: RankedCandidate) -> list[str]:
    search = result.drawn.search
    cells = [str(row.rank), _number(row.front), _number(row.score)]
    varied = [_number(row.candidate.values[key]) for key in search.vary]
    return [*cells, *varied, *(_number(row.numbers.get(name)) for name in search.objectives)]


def _number(value: Any) -> str:
    if value is None:
        return "–"
    return f"{value:.4g}" if isinstance(value, float) else str(value)


def count_lines(result: SearchResult) -> list[str]:
    """How far the search is, in sentences."""
    rows: Sequence[RankedCandidate] = result.rows
    states = {state: sum(row.state == state for row in rows) for state in dict.fromkeys(
        row.state for row in rows
    )}  # fmt: skip
    count = len(result.drawn.candidates)
    counts = ", ".join(f"{number} {state}" for state, number in states.items())
    lines = [
        f"{len(rows)} of {count} candidates known ({result.kept} from before): {counts or '–'}"
    ]
    lines += [f"candidate {number} broke: {reason}" for number, reason in result.broken.items()]
    if result.left:
        lines.append("run the same command again for what is missing")
    return lines
