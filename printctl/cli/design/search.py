"""`printctl search`: grow and measure variants of a recipe, rank them, write the best one."""

from __future__ import annotations

from pathlib import Path

from printctl.cli.declare import json_command
from printctl.cli.options import folder_to_write, messages, print_result
from printctl.search import load_search, run_search
from printctl.search.results import count_lines, result_dict, table_lines, write_results
from printctl.search.workers import WAIT_MIN, Workers
from printctl.settings import arg, opt


@json_command
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
) -> None:
    """Grow and measure many variants of a recipe, rank them, and write the best as a recipe.

    Killed or interrupted, it goes on where it was. Exit code 1 when a candidate broke, or none
    keeps the limits though all are known.
    """
    requested, who = load_search(search_file), Workers(workers, scheduler, wait_min)
    result = run_search(requested, search_file.resolve().parent, out, messages(), who, limit)
    written = [str(path) for path in write_results(result, out)]
    lines = [*table_lines(result), *count_lines(result), *written]
    passed = not result.broken and (result.best is not None or bool(result.left))
    print_result(result_dict(result) | {"written": written}, lines, passed)
