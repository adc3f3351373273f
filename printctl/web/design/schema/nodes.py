"""Types of the recipe form's tree: fields, sections, choices, with units, limits and defaults."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any, Literal

Sort = Literal[
    "section", "choice", "list", "row", "number", "text", "flag", "one_of", "profile", "file",
    "free",
]  # fmt: skip
"""``row`` is a tuple of fixed length, ``one_of`` a literal, ``free`` any YAML value."""


@dataclass(frozen=True)
class FormField:
    """A key of a section.

    Attributes
    ----------
    key : str
        As the file has it.
    node : Node
    required : bool
    default : JSON value
        Taken where the key isn't given; None, too, where nothing stands for it.
    help : str
    unit : str
        From the key's suffix; empty without.
    """

    key: str
    node: Node
    required: bool
    default: Any
    help: str
    unit: str

    @property
    def label(self) -> str:
        """Key in words, without its unit."""
        return self.key.replace("_", " ")


@dataclass(frozen=True)
class Option:
    """One of several sections of which a recipe has one.

    Attributes
    ----------
    tag : str
    node : Node
    begin : mapping
        Keys that say that it is this one.
    """

    tag: str
    node: Node
    begin: dict[str, Any]


@dataclass(frozen=True)
class Node:
    """What may stand at a place of a recipe.

    Attributes
    ----------
    sort : Sort
    title : str
        First line of what the model says of itself.
    optional : bool
        Whether null may stand there.
    fields : tuple of FormField
        Of a section.
    options : tuple of Option
        Of a choice.
    tag_of : function or None
        Of a choice: the tag of what stands there.
    items : tuple of Node
        Of a row each; of a list the one that is repeated.
    low, high : float or None
        Bounds of a number.
    open_low, open_high : bool
        Whether the bound itself is out.
    whole : bool
        Whether only whole numbers are taken.
    values : tuple
        Of a ``one_of``.
    profile : str
        Sort of the profiles that are named.
    """

    sort: Sort
    title: str = ""
    optional: bool = False
    fields: tuple[FormField, ...] = ()
    options: tuple[Option, ...] = ()
    tag_of: Callable[[Any], str] | None = None
    items: tuple[Node, ...] = ()
    low: float | None = None
    high: float | None = None
    open_low: bool = False
    open_high: bool = False
    whole: bool = False
    values: tuple[Any, ...] = ()
    profile: str = ""

    def field(self, key: str) -> FormField | None:
        """The field of a section with that key."""
        return next((one for one in self.fields if one.key == key), None)

    def option(self, value: Any) -> Option | None:
        """The option of a choice that a value, or its absence, stands for."""
        if not isinstance(value, dict) or self.tag_of is None:
            return None
        tag = self.tag_of(value)
        return next((one for one in self.options if one.tag == tag), None)

    @property
    def bounds(self) -> str:
        """Limits of a number in words; empty without any."""
        low, high = "", ""
        if self.low is not None:
            low = f"{'above' if self.open_low else 'from'} {self.low:.12g}"
        if self.high is not None:
            high = f"{'below' if self.open_high else 'to'} {self.high:.12g}"
        return f"{low} {high}".strip()

    def as_json(self) -> dict[str, Any]:
        """For the API."""
        data: dict[str, Any] = {"sort": self.sort}
        data |= {
            name: getattr(self, name)
            for name in ("title", "optional", "low", "high", "whole", "profile")
            if getattr(self, name) not in (None, "", False)
        }
        if self.values:
            data["values"] = list(self.values)
        if self.fields:
            data["fields"] = [_field_json(one) for one in self.fields]
        if self.options:
            data["options"] = [{"tag": o.tag, "node": o.node.as_json()} for o in self.options]
        if self.items:
            data["items"] = [one.as_json() for one in self.items]
        return data

    def walk(self, path: tuple[str, ...] = ()) -> Iterator[tuple[tuple[str, ...], FormField]]:
        """Every field below with the keys to it; options and items count as their place."""
        for one in self.fields:
            yield (*path, one.key), one
            yield from one.node.walk((*path, one.key))
        for option in self.options:
            yield from option.node.walk(path)
        for item in self.items:
            yield from item.walk(path)


def _field_json(one: FormField) -> dict[str, Any]:
    return {
        "key": one.key,
        "required": one.required,
        "default": one.default,
        "help": one.help,
        "unit": one.unit,
        "node": one.node.as_json(),
    }
