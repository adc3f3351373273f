"""Make the recipe text (YAML) of a search's candidate, for `printctl run`."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import yaml

from printctl.recipe.override import recipe_data
from printctl.search.rank import RankedCandidate
from printctl.search.run import SearchResult

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
