"""Read and validate a YAML recipe; report each error with key, value and remedy."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import yaml
from pydantic import BaseModel, ValidationError

from firmware_profiles.errors import wording
from firmware_profiles.yaml_file import read_yaml
from printctl.errors import RecipeError
from printctl.recipe.migrate import SCHEMA, migrated, steps_from
from printctl.recipe.model import Recipe

UserPath = Callable[[tuple[int | str, ...]], Sequence[int | str]]

_REMEDIES = {
    "extra_forbidden": "remove it or mend its spelling",
    "missing": "add it",
    "literal_error": "choose one of those named",
}
_MOST = 60
"""Characters of a wrong value that a message repeats."""


def load_recipe(path: Path, tell: Callable[[str], object] | None = None) -> Recipe:
    """Read and validate a YAML recipe, one of an older schema too.

    Parameters
    ----------
    path : Path
    tell : function, optional
        Told that the recipe is of an older schema, and how to bring the file to today's.

    Raises
    ------
    RecipeError
        With the path of every wrong key, its value, the limit and the remedy; or when the recipe
        is of a newer schema than this printctl knows.
    """
    data = read_mapping(path, "recipe", "`printctl init` writes a starter")
    if tell is not None and steps_from(data, str(path)):
        tell(
            f"note: {path} is of schema {data['schema']}, read as {SCHEMA}; "
            f"`printctl recipe migrate {path}` brings the file to it"
        )
    return parse_recipe(data, str(path))


def read_mapping(path: Path, kind: str, start: str) -> dict[str, Any]:
    """Keys and values of a YAML file.

    Parameters
    ----------
    path : Path
    kind : str
        What the file is, for messages.
    start : str
        Where one begins who has none.

    Raises
    ------
    RecipeError
        When it isn't there, isn't YAML or holds no keys.
    """
    try:
        data = read_yaml(path.read_text(encoding="utf-8"))
    except FileNotFoundError as exc:
        raise RecipeError(f"{kind} {path} doesn't exist; check the path, or: {start}") from exc
    except IsADirectoryError as exc:
        raise RecipeError(f"{kind} {path} is a folder; give the .yaml file in it") from exc
    except (yaml.YAMLError, UnicodeDecodeError) as exc:
        raise RecipeError(f"{path} isn't YAML: {exc}") from exc
    if not isinstance(data, dict):
        raise RecipeError(f"{path} holds no keys; {start}")
    return data


def parse_recipe(data: dict[str, Any], origin: str) -> Recipe:
    """Validate recipe ``data``, of an older schema too; ``origin`` names the file in messages."""
    data = migrated(data, steps_from(data, origin))
    try:
        return Recipe.model_validate(data)
    except ValidationError as exc:
        raise RecipeError(refusal(exc, origin)) from exc


def refusal(exc: ValidationError, origin: str, user_path: UserPath | None = None) -> str:
    """What is wrong with a file, a line for each key.

    Parameters
    ----------
    exc : ValidationError
    origin : str
        The file.
    user_path : function, optional
        From pydantic's path of a key to the one that the user wrote; a recipe's by default.
    """
    path_of = user_path or _user_path
    lines = [sentence(dict(problem), path_of(problem["loc"])) for problem in exc.errors()]
    return "\n".join([f"{origin} can't be used:", *lines])


def sentence(problem: dict[str, Any], path: Sequence[int | str]) -> str:
    """One line of a refusal: the key's path, what is wrong with which value, and the remedy."""
    place = ".".join(str(part) for part in path)
    if problem["type"] == "union_tag_invalid":
        return f"  {place}: {_kind_words(problem, place)}"
    message = wording(problem)
    value = problem["input"]
    shown = "" if isinstance(value, dict | BaseModel) else f" (is {_short(value)})"
    remedy = _REMEDIES.get(problem["type"])
    where = f"{place}: " if place else ""
    return f"  {where}{message}{shown}" + (f"; {remedy}" if remedy else "")


def _kind_words(problem: dict[str, Any], place: str) -> str:
    """What is wrong with a section whose kind isn't known."""
    tag, choices = problem["ctx"]["tag"], problem["ctx"]["expected_tags"]
    value = problem["input"]
    if not isinstance(value, dict):
        return f"must be keys with values (is {_short(value)}), of a kind of {choices}"
    if tag.lower() == "none":
        return f"doesn't say its kind; give one of {choices}"
    return f"{tag!r} isn't a kind of {place}; choose one of {choices}"


def _short(value: Any) -> str:
    """A value as it was written, or its beginning and how long it is."""
    text = repr(value)
    return text if len(text) <= _MOST else f"{text[:_MOST]} ... ({len(text)} characters)"


def _user_path(loc: tuple[int | str, ...]) -> list[int | str]:
    """Drop the union tags that pydantic puts into a path; the user never wrote them."""
    tagged = {"tissue", "vasculature", "toolpath", "scan"}
    if len(loc) > 2 and loc[0] in tagged:
        return [loc[0], *loc[2:]]
    return list(loc)
