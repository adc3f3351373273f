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


def ranked_csv(found: SearchResult) -> str:
    """The table as CSV: what is varied, the objectives, then all else that was measured.

    Nothing in it tells when or where a candidate was grown.
    """
    search = found.drawn.search
    rest = [name for name in QUANTITIES if name not in search.objectives]
    names = [*search.objectives, *rest]
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    head = ["rank", "candidate", "state", "score", "front"]
    writer.writerow([*head, *search.vary, *names, "said", "key"])
    for row in found.rows:
        one = row.candidate
        told = [row.rank, one.number, row.state, row.score, row.front]
        varied = [_cell(one.values[key]) for key in search.vary]
        measured = [row.numbers.get(name) for name in names]
        writer.writerow([*told, *varied, *measured, row.said, one.key])
    return text.getvalue()


def _cell(value: Any) -> Any:
    return json.dumps(value) if isinstance(value, list | tuple | dict | bool) else value


def table_lines(found: SearchResult) -> list[str]:
    """The best rows in columns, for people."""
    search, rows = found.drawn.search, found.rows[:FIRST]
    head = ["rank", "front", "score", *(key.rpartition(".")[2] for key in search.vary)]
    cells = [[*head, *search.objectives], *(_row(found, row) for row in rows)]
    wide = [max(len(line[k]) for line in cells) for k in range(len(cells[0]))]
    shown = [
        "  ".join(cell.rjust(width) for cell, width in zip(line, wide, strict=True))
        for line in cells
    ]
    more = [""] + [row.said.split("\n")[0] for row in rows]
    return [f"{line}  {said}".rstrip() for line, said in zip(shown, more, strict=True)]


def _row(found: SearchResult, row: RankedCandidate) -> list[str]:
    search = found.drawn.search
    told = [str(row.rank), _number(row.front), _number(row.score)]
    varied = [_number(row.candidate.values[key]) for key in search.vary]
    return [*told, *varied, *(_number(row.numbers.get(name)) for name in search.objectives)]


def _number(value: Any) -> str:
    if value is None:
        return "–"
    return f"{value:.4g}" if isinstance(value, float) else str(value)


def count_lines(found: SearchResult) -> list[str]:
    """How far the search is, in sentences."""
    rows: Sequence[RankedCandidate] = found.rows
    states = {state: sum(row.state == state for row in rows) for state in dict.fromkeys(
        row.state for row in rows
    )}  # fmt: skip
    count = len(found.drawn.candidates)
    told = ", ".join(f"{number} {state}" for state, number in states.items())
    lines = [f"{len(rows)} of {count} candidates known ({found.kept} from before): {told or '–'}"]
    lines += [f"candidate {number} broke: {said}" for number, said in found.broken.items()]
    if found.left:
        lines.append("run the same command again for what is missing")
    return lines
