"""Migrate recipes of older schemas to the current one, step by step.

A step is a list of changes, each a key that has another name or another value now. Because it is
said and not programmed, the same step changes what was read from a file and the file's own text,
where comments and order stay as they are.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from copy import deepcopy
from dataclasses import dataclass
from typing import Any, Final

import yaml

from firmware_profiles.yaml_file import read_yaml
from printctl.errors import RecipeError

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
        text = _put(text, value, str(yaml.safe_dump(change.value(old))).split("\n")[0])
    return text if change.name is None else _put(text, key, change.name)


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


def _put(text: str, node: Any, words: str) -> str:
    return text[: node.start_mark.index] + words + text[node.end_mark.index :]
