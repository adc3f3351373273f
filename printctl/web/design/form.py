"""The recipe's form: values, changes, and targets picked on the tissue."""

from __future__ import annotations

import copy
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, Final

from printctl.recipe.anatomy import INLETS
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


# Recipe fields that a click on the tissue surface can set.

_DIGITS: Final = 3
"""Of a place, mm."""
_AT: Final = ("vasculature",)


@dataclass(frozen=True)
class PickTarget:
    """What a picked place is for.

    Attributes
    ----------
    name : str
        As the page calls it.
    path : tuple of str or int
        Field that is written.
    key : str or int or None
        Within it: an inlet's name or number; None where the field is the place itself.
    """

    name: str
    path: Path
    key: str | int | None = None

    def value(self, data: Any, at: Sequence[float]) -> Any:
        """Return what the field is to hold with the place ``at``, mm."""
        place = [round(x, _DIGITS) for x in at]
        if self.key is None:
            return place
        written = value_at(data, self.path)
        if isinstance(self.key, str):
            return {**(written if isinstance(written, dict) else {}), self.key: {"at_mm": place}}
        kept = list(written) if isinstance(written, list) else []
        return [*kept[: self.key], {"at_mm": place}, *kept[self.key + 1 :]]


def pick_targets(data: Any) -> tuple[PickTarget, ...]:
    """Return what can be picked for a recipe's vessels; nothing where these aren't grown."""
    part = value_at(data, _AT)
    return tuple(_targets(part)) if isinstance(part, Mapping) else ()


def _targets(part: Mapping[str, Any]) -> Iterator[PickTarget]:
    grow, anatomy = part.get("grow"), part.get("anatomy")
    if grow == "tree" and isinstance(anatomy, Mapping):
        for name in INLETS.get(str(anatomy.get("template")), ()):
            yield PickTarget(name.replace("_", " "), (*_AT, "anatomy", "inlets"), name)
    elif grow == "tree":
        inlets = part.get("inlets")
        count = len(inlets) if isinstance(inlets, list) else 0
        yield PickTarget("a further inlet", (*_AT, "inlets"), count)
        for k in range(count):
            yield PickTarget(f"inlet {k + 1}", (*_AT, "inlets"), k)
    elif grow == "closed_loop":
        yield PickTarget("the artery's inlet", (*_AT, "root_mm"))
        yield PickTarget("the vein's outlet", (*_AT, "vein_root_mm"))
    elif grow == "forest":
        yield from _of_forest(part.get("networks"))


def _of_forest(networks: Any) -> Iterator[PickTarget]:
    for n, network in enumerate(networks if isinstance(networks, list) else ()):
        trees = network.get("trees") if isinstance(network, Mapping) else None
        for k, tree in enumerate(trees if isinstance(trees, list) else ()):
            kind = tree.get("kind", "tree") if isinstance(tree, Mapping) else "tree"
            path = (*_AT, "networks", n, "trees", k, "root_mm")
            yield PickTarget(f"network {n + 1}: {kind} {k + 1}", path)
