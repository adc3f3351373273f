"""`printctl search`: grow and measure variants of a recipe, rank them, write the best one."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import typer

from printctl.cli.declare import command
from printctl.cli.options import JsonFlag, folder_to_write, messages, print_json, print_lines
from printctl.search import SearchResult, load_search, run_search
from printctl.search.results import count_lines, table_lines, write_results
from printctl.search.workers import WAIT_MIN, Workers
from printctl.settings import arg, opt


@command
def search(
    search_file: Path = arg("A YAML file.", metavar="SEARCH"),
    out: Path = opt("Folder; what it knows is kept.", ..., callback=folder_to_write),
    workers: int | None = opt(
        "Processes here, one a core by default; 0: this process alone, without Dask.",
        min=0,
        max=1024,
    ),
    scheduler: str | None = opt("A Dask cluster's, like tcp://HOST:8786.", metavar="ADDRESS"),
    wait_min: float = opt("For --scheduler, its first worker.", WAIT_MIN, min=0.0),
    limit: int | None = opt("Grow so many new candidates at most.", min=0),
    as_json: JsonFlag = False,
) -> None:
    """Grow and measure many variants of a recipe, rank them, and write the best as a recipe.

    Killed or interrupted, it goes on where it was. Exit code 1 when a candidate broke, or none
    keeps the limits though all are known.
    """
    asked, who = load_search(search_file), Workers(workers, scheduler, wait_min)
    result = run_search(asked, search_file.resolve().parent, out, messages(), who, limit)
    written = [str(path) for path in write_results(result, out)]
    if as_json:
        print_json(as_dict(result) | {"written": written})
    else:
        print_lines(*table_lines(result), *count_lines(result), *written)
    if result.broken or (result.best is None and not result.left):
        raise typer.Exit(1)


def as_dict(result: SearchResult) -> dict[str, Any]:
    """The ranked candidates as plain values."""
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
