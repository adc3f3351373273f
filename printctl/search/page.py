"""Build the HTML result page of a search: goals, Pareto plot, ranked candidates."""

from __future__ import annotations

from typing import Any

from printctl.search.figure import pareto_svg
from printctl.search.model import Objective, Range
from printctl.search.quantities import QUANTITIES
from printctl.search.run import SearchResult
from printctl.search.table import count_lines
from registration.report.page_frame import render
from registration.report.svg import inline_figure
from registration.report.tables import Column, Table, make_table


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
