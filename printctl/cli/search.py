"""`printctl search`: grow and measure variants of a recipe, rank them, write the best one."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from printctl.cli.options import JsonFlag, folder_to_write, messages, print_json, print_lines
from printctl.search import SearchResult, load_search, run_search
from printctl.search.results import count_lines, table_lines, write_results
from printctl.search.workers import WAIT_MIN, Workers


def search(
    search_file: Annotated[
        Path, typer.Argument(metavar="SEARCH", help="A YAML file.", show_default=False)
    ],
    out: Annotated[
        Path,
        typer.Option(
            "--out",
            callback=folder_to_write,
            help="Folder; what it knows is kept.",
            show_default=False,
        ),
    ],
    workers: Annotated[
        int | None,
        typer.Option(
            "--workers",
            min=0,
            max=1024,
            help="Processes here, one a core by default; 0: this process alone, without Dask.",
            show_default=False,
        ),
    ] = None,
    scheduler: Annotated[
        str | None,
        typer.Option(
            "--scheduler", metavar="ADDRESS", help="A Dask cluster's, like tcp://HOST:8786."
        ),
    ] = None,
    wait_min: Annotated[
        float,
        typer.Option("--wait-min", min=0.0, help="For --scheduler, its first worker."),
    ] = WAIT_MIN,
    limit: Annotated[
        int | None, typer.Option("--limit", min=0, help="Grow so many new candidates at most.")
    ] = None,
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
