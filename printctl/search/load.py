"""Read and validate a YAML search file; report its errors."""

from __future__ import annotations

from pathlib import Path

from pydantic import ValidationError

from printctl.errors import RecipeError
from printctl.recipe.load import read_mapping, refusal
from printctl.search.model import SearchFile

_TAGS = ("values", "range")


def load_search(path: Path) -> SearchFile:
    """Read and validate a YAML search file.

    Raises
    ------
    RecipeError
        With the path of every wrong key, its value, the limit and the remedy.
    """
    data = read_mapping(path, "search file", "docs/search.md shows one")
    try:
        return SearchFile.model_validate(data)
    except ValidationError as exc:
        raise RecipeError(refusal(exc, str(path), _user_path)) from exc


def _user_path(loc: tuple[int | str, ...]) -> list[int | str]:
    """Without pydantic's word for the kind of ``vary.KEY``."""
    if len(loc) > 2 and loc[0] == "vary" and loc[2] in _TAGS:
        return [*loc[:2], *loc[3:]]
    return list(loc) or ["search file"]
