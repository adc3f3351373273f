"""Read, set, remove and list a recipe's values by key path; find the form field of a key path.

A place is a path of keys and indices, as the user's file has them.
"""

from __future__ import annotations

import copy
from collections.abc import Iterator
from itertools import pairwise
from typing import Any

from printctl.web.design.schema import FormField, Node

Path = tuple[str | int, ...]


def value_at(data: Any, path: Path) -> Any:
    """Return the user's value at a path; None where there is none."""
    for key in path:
        if isinstance(data, dict) and isinstance(key, str):
            data = data.get(key)
        elif isinstance(data, list) and isinstance(key, int) and 0 <= key < len(data):
            data = data[key]
        else:
            return None
    return data


def set_value(form: Node, data: dict[str, Any], path: Path, value: Any) -> dict[str, Any]:
    """The data with ``value`` at a place; sections on the way come into being.

    A section of which there are several sorts begins with the keys that tell it from the others.
    """
    new = copy.deepcopy(data)
    inside: Any = new
    node: Node | None = form
    for key, following in pairwise(path):
        child, node = child_of(node, inside, key)
        there = value_at(inside, (key,))
        if there is None:
            default = child.default if child is not None else None
            there = [] if isinstance(following, int) else {}
            if node is not None and node.sort == "choice" and isinstance(default, dict):
                there = dict(default)
            _set(inside, key, there)
        inside = there
    _set(inside, path[-1], value)
    return new


def _set(inside: Any, key: str | int, value: Any) -> None:
    if isinstance(inside, list) and isinstance(key, int) and key >= len(inside):
        inside.append(value)
    else:
        inside[key] = value


def remove_value(form: Node, data: dict[str, Any], path: Path) -> dict[str, Any]:
    """The data without what is said at a place; sections that are empty then go, too.

    A section that may be left out stays when it is empty: ``oxygen: {}`` asks for oxygen.
    """
    new = copy.deepcopy(data)
    inside = value_at(new, path[:-1])
    if isinstance(inside, dict):
        inside.pop(path[-1], None)
    elif isinstance(inside, list) and isinstance(path[-1], int) and path[-1] < len(inside):
        del inside[path[-1]]
    field = field_at(form, new, path[:-1]) if len(path) > 1 else None
    if inside in ({}, []) and field is not None and not (field.node.optional or field.required):
        return remove_value(form, new, path[:-1])
    return new


def child_of(node: Node | None, value: Any, key: str | int) -> tuple[FormField | None, Node | None]:
    """Field and node of a key or index in what stands at a node."""
    if node is None:
        return None, None
    if node.sort == "choice":
        option = node.option(value)
        return (None, None) if option is None else child_of(option.node, value, key)
    if isinstance(key, int):
        if node.sort == "list":
            return None, node.items[0]
        return None, node.items[key] if 0 <= key < len(node.items) else None
    child = node.field(key)
    return child, None if child is None else child.node


def field_at(form: Node, data: Any, path: Path) -> FormField | None:
    """The field that a place belongs to; None for one that the form hasn't."""
    node: Node | None = form
    field: FormField | None = None
    for key in path:
        own, node = child_of(node, data, key)
        field = own if own is not None else field
        data = value_at(data, (key,))
        if node is None:
            return None
    return field


def form_values(form: Node, data: Any, strict: bool = True) -> Iterator[tuple[Path, Any]]:
    """Every value of a recipe with its place, as the form's inputs hold them.

    Raises
    ------
    KeyError
        For a key that the form hasn't; such keys are passed over unless ``strict``.
    """
    return _said(form, data, (), strict)


def _said(node: Node | None, value: Any, path: Path, strict: bool) -> Iterator[tuple[Path, Any]]:
    if node is None:
        if strict:
            raise KeyError(".".join(map(str, path)))
        return
    deeper = isinstance(value, dict | list) and node.sort in ("section", "choice", "list", "row")
    if not deeper or not value:
        yield path, value
        return
    pairs = value.items() if isinstance(value, dict) else enumerate(value)
    for key, inner in pairs:
        yield from _said(child_of(node, value, key)[1], inner, (*path, key), strict)


def user_path(form: Node, data: Any, loc: tuple[str | int, ...]) -> Path:
    """From pydantic's path to the user's: the tags of unions stand in the former alone."""
    node: Node | None = form
    path: list[str | int] = []
    rest = list(loc)
    while rest:
        key = rest.pop(0)
        if node is not None and node.sort == "choice":
            option = next((one for one in node.options if one.tag == key), None)
            if option is not None:
                node = option.node
                continue
        if node is not None and node.sort == "free":
            break
        path.append(key)
        _, node = child_of(node, data, key)
        data = value_at(data, (key,))
    return tuple(path)
