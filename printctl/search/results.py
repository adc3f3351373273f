"""Write a search's results: ranked table, plot, page, and the best candidate's recipe."""

from __future__ import annotations

import csv
import io
import json
import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

import yaml

from design.files import write_bytes, write_text
from printctl.recipe.load import recipe_data
from printctl.search.figure import pareto_png, pareto_svg
from printctl.search.model import Objective, Range
from printctl.search.quantities import QUANTITIES
from printctl.search.rank import RankedCandidate
from printctl.search.run import SearchResult
from report.page_frame import render
from report.sections.tables import Column, Table, make_table
from report.svg import inline_figure

_WITH_FILES = ("tissue", "vasculature", "flow", "toolpath", "scan")


def best_recipe(result: SearchResult, row: RankedCandidate, out: Path) -> str:
    """The candidate's recipe as YAML text.

    The user's files that it names are told as seen from ``out``, where it is put.
    """
    data = recipe_data(row.candidate.recipe)
    seen = {name: _seen(result, name, out) for name in row.candidate.task.files}
    for section in _WITH_FILES:
        if section in data:
            data[section] = _renamed(data[section], seen)
    head = (
        f"# Candidate {row.candidate.number} of the search {result.drawn.search.name}, the best of "
        f"{len(result.rows)}.\n# {row.candidate.label}\n"
    )
    return head + yaml.safe_dump(data, sort_keys=False, allow_unicode=True)


def _seen(result: SearchResult, name: str, out: Path) -> str:
    path = result.drawn.folder / name
    try:
        return Path(os.path.relpath(path, out.resolve())).as_posix()
    except ValueError:  # on Windows, from another drive
        return str(path)


def _renamed(value: Any, names: dict[str, str]) -> Any:
    if isinstance(value, dict):
        return {key: _renamed(one, names) for key, one in value.items()}
    if isinstance(value, list):
        return [_renamed(one, names) for one in value]
    return names.get(value, value) if isinstance(value, str) else value


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


def search_html(result: SearchResult) -> str:
    """The page as one file that opens offline; the same results give the same text."""
    search, best = result.drawn.search, result.best
    context = {
        "name": search.name,
        "count": count_lines(result)[0].split(" (")[0],
        "drawn": search.draw.replace("_", " "),
        "seed": search.seed,
        "picture": inline_figure(pareto_svg(result), "Goals against each other", "pareto-"),
        "best": best and best.candidate.label,
        "varied": [(key, _range(one)) for key, one in search.vary.items()],
        "sought": [
            (QUANTITIES[name].title, _wanted(one)) for name, one in search.objectives.items()
        ],
        "table": ranked_table(result),
    }
    return render("search.html", context)


def _range(one: tuple[Any, ...] | Range) -> str:
    if not isinstance(one, Range):
        return ", ".join(map(str, one))
    words = [f"{one.low:g} to {one.high:g}"]
    words += [f"{one.steps} steps"] if one.steps else []
    words += [word for word in ("whole", "log") if getattr(one, word)]
    return ", ".join(words)


def _wanted(one: Objective) -> str:
    words: list[str] = [one.goal] if one.goal else []
    words += [f"weight {one.weight:g}"] if one.goal and one.weight != 1 else []
    words += [f"at least {one.at_least:g}"] if one.at_least is not None else []
    words += [f"at most {one.at_most:g}"] if one.at_most is not None else []
    return ", ".join(words)


def ranked_table(result: SearchResult) -> Table:
    """A row for each candidate, the best first."""
    search = result.drawn.search
    varied = {f"v{k}": key for k, key in enumerate(search.vary)}
    columns = (
        Column("rank", "Rank"),
        Column("state", "State", kind="text"),
        Column("score", "Score"),
        Column("front", "Front"),
        *(Column(short, key, kind="text") for short, key in varied.items()),
        *(
            Column(name, QUANTITIES[name].label, QUANTITIES[name].unit)
            for name in search.objectives
        ),
        Column("said", "Why", kind="text"),
    )
    rows = [
        {
            "rank": row.rank,
            "state": row.state,
            "score": row.score,
            "front": row.front,
            **{short: row.candidate.values[key] for short, key in varied.items()},
            **{name: row.numbers.get(name) for name in search.objectives},
            "said": row.said or None,
        }
        for row in result.rows
    ]
    return make_table("candidates", rows, columns, order="the best first")


TABLE: Final = "ranked.csv"
PICTURE: Final = "pareto.png"
PAGE: Final = "search.html"
BEST: Final = "best.yaml"


def write_results(result: SearchResult, out: Path) -> list[Path]:
    """Write all of it; return what was written.

    Raises
    ------
    OSError
        When a file can't be written.
    """
    write_text(out / TABLE, ranked_csv(result))
    write_bytes(out / PICTURE, pareto_png(result))
    write_text(out / PAGE, search_html(result))
    names = [TABLE, PICTURE, PAGE]
    if result.best is None:
        (out / BEST).unlink(missing_ok=True)  # an earlier one, of other limits
    else:
        write_text(out / BEST, best_recipe(result, result.best, out))
        names.append(BEST)
    return [out / name for name in names]


def result_dict(result: SearchResult) -> dict[str, Any]:
    """Return the ranked candidates as plain values, for JSON."""
    rows = [
        {
            "rank": row.rank,
            "candidate": row.candidate.number,
            "state": row.state,
            "score": row.score,
            "front": row.front,
            "values": dict(row.candidate.values),
            "numbers": dict(row.numbers),
            "said": row.said,
        }
        for row in result.rows
    ]
    return {"candidates": rows, "left": result.left, "broken": dict(result.broken)}
