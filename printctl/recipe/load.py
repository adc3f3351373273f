"""Read, migrate, override and validate a YAML recipe; report each error with remedy."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from copy import deepcopy
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import yaml
from pydantic import BaseModel, ValidationError

from firmware_profiles.errors import wording
from firmware_profiles.yaml_file import read_yaml
from printctl.errors import RecipeError
from printctl.recipe.model import Recipe
from printctl.recipe.schema import user_path

STARTER: Final = Path(__file__).parent / "starter.yaml"
"""Runs as it stands, on the simulated printer."""


# A step is a list of changes, each a key that has another name or another value now. Because it is
# said and not programmed, the same step changes what was read from a file and the file's own text,
# where comments and order stay as they are.
SCHEMA: Final = 1
"""Version of the schema that this printctl writes and reads without a change."""


@dataclass(frozen=True)
class Change:
    """One key that is written otherwise now.

    ``path`` is where it stood, from the recipe's root through mappings; ``name`` what its last part
    is called now; ``value`` makes the new plain value (number, word, flag) of the old one.
    """

    path: tuple[str, ...]
    name: str | None = None
    value: Callable[[Any], Any] | None = None


@dataclass(frozen=True)
class Step:
    """From schema ``old`` to ``old + 1``; ``why`` is told to whoever migrates a file."""

    old: int
    why: str
    changes: tuple[Change, ...]


STEPS: Final[tuple[Step, ...]] = ()
"""In order of `old`. Schema 1 is the first, so that there is nothing to migrate from yet."""


def steps_from(
    data: Mapping[str, Any], origin: str, steps: Sequence[Step] | None = None
) -> tuple[Step, ...]:
    """The steps that recipe ``data`` needs; none for one of today, or for one that says no version.

    ``steps`` are those known, `STEPS` by default; ``origin`` names the file in messages.

    Raises
    ------
    RecipeError
        When the recipe is of a newer schema, or of one that no step leads away from.
    """
    schema = data.get("schema")
    if not isinstance(schema, int) or isinstance(schema, bool) or schema == SCHEMA:
        return ()  # What isn't a version at all is refused with the other wrong keys.
    if schema > SCHEMA:
        raise RecipeError(
            f"{origin} is of schema {schema}, and this printctl reads up to {SCHEMA}; it was "
            "written for a newer printctl: update this one, or ask for the recipe in an older "
            "schema"
        )
    known = STEPS if steps is None else steps
    needed = tuple(step for step in known if step.old >= schema)
    if [step.old for step in needed] != list(range(schema, SCHEMA)):
        raise RecipeError(
            f"{origin} is of schema {schema}, and none older than "
            f"{min((step.old for step in known), default=SCHEMA)} can be read; write its keys anew "
            "after `printctl init`"
        )
    return needed


def migrated(data: Mapping[str, Any], steps: Sequence[Step]) -> dict[str, Any]:
    """A copy of recipe ``data`` after ``steps``."""
    made = deepcopy(dict(data))
    for step in steps:
        for change in step.changes:
            _apply(made, change)
        made["schema"] = step.old + 1
    return made


def migrated_text(text: str, steps: Sequence[Step]) -> str:
    """The text of a recipe after ``steps``, its comments and order untouched."""
    for step in steps:
        for change in (*step.changes, Change(("schema",), value=lambda old: old + 1)):
            text = _rewritten(text, change)
    return text


def _apply(data: dict[str, Any], change: Change) -> None:
    inside: Any = data
    *sections, last = change.path
    for section in sections:
        inside = inside.get(section) if isinstance(inside, dict) else None
    if not isinstance(inside, dict) or last not in inside:
        return
    # In its place among the others, as in the text.
    entries = [
        ((change.name or key), (change.value(value) if change.value else value))
        if key == last
        else (key, value)
        for key, value in inside.items()
    ]
    inside.clear()
    inside.update(entries)


def _rewritten(text: str, change: Change) -> str:
    """``text`` with one key renamed, or its value replaced, where YAML says that they stand."""
    nodes = _find(yaml.compose(text, Loader=yaml.SafeLoader), change.path)
    if nodes is None:
        return text
    key, value = nodes
    if change.value is not None:
        old = read_yaml(text[value.start_mark.index : value.end_mark.index])
        text = _replace_text(text, value, str(yaml.safe_dump(change.value(old))).split("\n")[0])
    return text if change.name is None else _replace_text(text, key, change.name)


def _find(root: Any, path: Sequence[str]) -> tuple[Any, Any] | None:
    """Nodes of the key at ``path`` and of its value."""
    nodes = None
    for part in path:
        if not isinstance(root, yaml.MappingNode):
            return None
        nodes = next(((key, value) for key, value in root.value if key.value == part), None)
        if nodes is None:
            return None
        root = nodes[1]
    return nodes


def _replace_text(text: str, node: Any, words: str) -> str:
    return text[: node.start_mark.index] + words + text[node.end_mark.index :]


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


def refusal(exc: ValidationError, origin: str, path_of: UserPath = user_path) -> str:
    """What is wrong with a file, a line for each key.

    Parameters
    ----------
    exc : ValidationError
    origin : str
        The file.
    path_of : function, optional
        From pydantic's path of a key to the one that the user wrote; a recipe's by default.
    """
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


def overridden(recipe: Recipe, values: Mapping[str, Any], name: str, origin: str) -> Recipe:
    """The recipe of one part, under another name, with ``values`` in place of its own.

    Parameters
    ----------
    recipe : Recipe
        Its plate, if it has one, is left out.
    values : mapping of str to value
        Key as ``vasculature.terminals`` to what it is to be.
    name : str
    origin : str
        For messages: who asked for these values.

    Raises
    ------
    RecipeError
        For a key that the recipe hasn't, or a value that it refuses.
    """
    data = recipe_data(recipe)
    data["name"] = name
    for key, value in values.items():
        _set_key(data, key, value, origin)
    return parse_recipe(data, origin)


def recipe_data(recipe: Recipe) -> dict[str, Any]:
    """What the user said, as a file would hold it; the plate left out."""
    data = recipe.model_dump(mode="json", by_alias=True, exclude_unset=True)
    data.pop("plate", None)
    data["toolpath"] = recipe.toolpath.model_dump(mode="json", exclude_unset=True)
    data["toolpath"]["method"] = recipe.toolpath.method
    return data


def _set_key(data: dict[str, Any], key: str, value: Any, origin: str) -> None:
    *sections, last = key.split(".")
    inside = data
    for section in sections:
        inside = inside.setdefault(section, {})
        if not isinstance(inside, dict):
            raise RecipeError(
                f"{origin}: {key} goes into {section}, which holds no keys of its own; name the "
                "whole of it"
            )
    inside[last] = value
