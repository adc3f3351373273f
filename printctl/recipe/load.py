"""Read a recipe and say clearly what is wrong with it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import yaml
from pydantic import ValidationError

from printctl.errors import RecipeError
from printctl.recipe.model import Recipe

_REMEDIES = {
    "extra_forbidden": "remove it or mend its spelling",
    "missing": "add it",
    "literal_error": "choose one of those named",
}


def load_recipe(path: Path) -> Recipe:
    """Read and validate a YAML recipe.

    Raises
    ------
    RecipeError
        With the path of every wrong key, its value, the limit and the remedy.
    """
    try:
        data = yaml.safe_load(path.read_text(encoding="utf-8"))
    except FileNotFoundError as exc:
        raise RecipeError(
            f"recipe {path} doesn't exist; check the path, or write a starter with `printctl init`"
        ) from exc
    except IsADirectoryError as exc:
        raise RecipeError(f"recipe {path} is a folder; give the .yaml file in it") from exc
    except (yaml.YAMLError, UnicodeDecodeError) as exc:
        raise RecipeError(f"{path} isn't YAML: {exc}") from exc
    if not isinstance(data, dict):
        raise RecipeError(f"{path} holds no keys; start from `printctl init`")
    return parse_recipe(data, str(path))


def parse_recipe(data: dict[str, Any], origin: str) -> Recipe:
    """Validate recipe ``data``; ``origin`` names the file in messages."""
    try:
        return Recipe.model_validate(data)
    except ValidationError as exc:
        lines = [_sentence(dict(problem)) for problem in exc.errors()]
        raise RecipeError("\n".join([f"{origin} can't be used:", *lines])) from exc


def _sentence(problem: dict[str, Any]) -> str:
    """One line: the key's path, what is wrong with which value, and the remedy."""
    place = ".".join(str(part) for part in _user_path(problem["loc"])) or "recipe"
    if problem["type"] == "union_tag_invalid":
        tag, choices = problem["ctx"]["tag"], problem["ctx"]["expected_tags"]
        return f"  {place}: {tag!r} isn't a kind of {place}; choose one of {choices}"
    message = str(problem["msg"]).removeprefix("Value error, ")
    value = problem["input"]
    shown = "" if isinstance(value, dict) else f" (is {value!r})"
    remedy = _REMEDIES.get(problem["type"])
    return f"  {place}: {message}{shown}" + (f"; {remedy}" if remedy else "")


def _user_path(loc: tuple[int | str, ...]) -> list[int | str]:
    """Drop the union tags that pydantic puts into a path; the user never wrote them."""
    tagged = {"tissue", "vasculature", "toolpath", "scan"}
    if len(loc) > 2 and loc[0] in tagged:
        return [loc[0], *loc[2:]]
    return list(loc)
