"""Field tree behind the recipe form: node types, units, conversion from pydantic models.

Goes in: the recipe's pydantic models. Comes out: a tree of fields with units and limits.
"""

from __future__ import annotations

import inspect
import types
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cache
from typing import Annotated, Any, Final, Literal, Union, get_args, get_origin

from annotated_types import Ge, Gt, Le, Lt
from pydantic import BaseModel, Discriminator, Tag
from pydantic.fields import FieldInfo

from printctl.recipe import Recipe

# Types of the recipe form's tree: fields, sections, choices, with units, limits and defaults.

Sort = Literal[
    "section", "choice", "list", "row", "number", "text", "flag", "one_of", "profile", "file",
    "free",
]  # fmt: skip
"""``row`` is a tuple of fixed length, ``one_of`` a literal, ``free`` any YAML value."""


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


def _field_json(one: FormField) -> dict[str, Any]:
    return {
        "key": one.key,
        "required": one.required,
        "default": one.default,
        "help": one.help,
        "unit": one.unit,
        "node": one.node.as_json(),
    }


# Read the physical unit of a recipe key from the key's suffix.

_BY_SUFFIX: Final = {
    "mmhg_min_ml": "mmHg·min/mL",
    "ml_min_per_ml": "mL/min per mL",
    "mol_per_cell_s": "mol/(cell·s)",
    "ml_mmhg": "mL/mmHg",
    "ml_min": "mL/min",
    "mpa_sn": "mPa·sⁿ",
    "mpa_s": "mPa·s",
    "pa_s": "Pa·s",
    "mm2_s": "mm²/s",
    "mm_s": "mm/s",
    "dyn_cm2": "dyn/cm²",
    "per_ml": "per mL",
    "g_cm3": "g/cm³",
    "millimolar": "mmol/L",
    "mmhg": "mmHg",
    "percent": "%",
    "degrees": "°",
    "deg": "°",
    "kpa": "kPa",
    "mm": "mm",
    "um": "µm",
    "ul": "µL",
    "gb": "GB",
    "min": "min",
    "s": "s",
}
"""The longest that fits counts."""


def unit_of(key: str) -> str:
    """The unit that a key's suffix says; empty for none."""
    for suffix, unit in _BY_SUFFIX.items():
        if key.endswith(f"_{suffix}"):
            return unit
    return ""


# Convert the recipe's pydantic models to the form's tree of fields with units and limits.

_UNIONS = (Union, types.UnionType)
_SCALARS: dict[Any, Node] = {
    bool: Node("flag"),
    int: Node("number", whole=True),
    float: Node("number"),
    str: Node("text"),
}


@cache
def recipe_form() -> Node:
    """The form of a recipe."""
    return section(Recipe)


def section(model: type[BaseModel]) -> Node:
    """The form of one model."""
    doc = (inspect.getdoc(model) or "").split("\n\n")[0].replace("\n", " ")
    fields = tuple(_field(name, info) for name, info in model.model_fields.items())
    return Node("section", title=doc, fields=fields)


def _field(name: str, info: FieldInfo) -> FormField:
    key = info.alias or name
    metadata = [*info.metadata, *([_said_by(info.discriminator)] if info.discriminator else [])]
    node = _marked(_node(info.annotation, metadata), info)
    default = None if info.is_required() else _plain(info.get_default(call_default_factory=True))
    return FormField(
        key, node, info.is_required(), default, info.description or node.title, unit_of(key)
    )


def _plain(value: Any) -> Any:
    """A default as a file would hold it."""
    if isinstance(value, BaseModel):
        return value.model_dump(mode="json", by_alias=True, exclude_unset=True)
    return [_plain(one) for one in value] if isinstance(value, tuple) else value


def _node(annotation: Any, metadata: Sequence[Any] = ()) -> Node:
    """The node of an annotation and of what is said beside it."""
    origin, args = get_origin(annotation), get_args(annotation)
    if origin is Annotated:
        return _annotated(args, metadata)
    if origin in _UNIONS:
        return _union(args, metadata)
    if origin is Literal:
        return Node("one_of", values=args)
    if origin is tuple:
        return _tuple(args)
    if inspect.isclass(annotation) and issubclass(annotation, BaseModel):
        return section(annotation)
    return _bounded(_SCALARS.get(annotation, Node("free")), metadata)


def _annotated(args: tuple[Any, ...], metadata: Sequence[Any]) -> Node:
    base, *more = args
    infos = [one for one in more if isinstance(one, FieldInfo)]
    plain = [one for one in more if not isinstance(one, FieldInfo)]
    for info in infos:
        plain += info.metadata
        if info.discriminator:
            plain.append(_said_by(info.discriminator))
    node = _node(base, [*plain, *metadata])
    for info in infos:
        node = _marked(node, info)
    return node


def _said_by(key: str | Discriminator) -> Discriminator:
    return key if isinstance(key, Discriminator) else Discriminator(key)


def _marked(node: Node, info: FieldInfo) -> Node:
    """A text that names a profile or a file, as the model marks it."""
    extra = info.json_schema_extra if isinstance(info.json_schema_extra, dict) else {}
    if node.sort == "text" and "profile" in extra:
        return replace(node, sort="profile", profile=str(extra["profile"]))
    return replace(node, sort="file") if node.sort == "text" and extra.get("file") else node


def _tuple(args: tuple[Any, ...]) -> Node:
    if len(args) == 2 and args[1] is Ellipsis:
        return Node("list", items=(_node(args[0]),))
    return Node("row", items=tuple(_node(one) for one in args))


def _bounded(node: Node, metadata: Sequence[Any]) -> Node:
    for one in metadata:
        if isinstance(one, Gt):
            node = replace(node, low=float(str(one.gt)), open_low=True)
        elif isinstance(one, Ge):
            node = replace(node, low=float(str(one.ge)))
        elif isinstance(one, Lt):
            node = replace(node, high=float(str(one.lt)), open_high=True)
        elif isinstance(one, Le):
            node = replace(node, high=float(str(one.le)))
    return node


def _union(args: tuple[Any, ...], metadata: Sequence[Any]) -> Node:
    members = [one for one in args if one is not type(None)]
    optional = len(members) < len(args)
    if len(members) == 1:
        return replace(_node(members[0], metadata), optional=optional)
    nodes = [_node(one) for one in members]
    by = next((one for one in metadata if isinstance(one, Discriminator)), None)
    if by is None or any(node.sort != "section" for node in nodes):
        return Node("free", optional=optional)
    tag_of = _tagger(by.discriminator)
    tags = [_tag(one, node, by.discriminator) for one, node in zip(members, nodes, strict=True)]
    pairs = zip(tags, nodes, strict=True)
    options = tuple(Option(tag, node, _begin(node, tag, tag_of)) for tag, node in pairs)
    return Node("choice", optional=optional, options=options, tag_of=tag_of)


def _tagger(by: str | Callable[[Any], Any]) -> Callable[[Any], str]:
    if isinstance(by, str):
        return lambda value: str(value.get(by))
    return lambda value: str(by(value))


def _tag(member: Any, node: Node, by: str | Callable[[Any], Any]) -> str:
    """As pydantic calls a member of a union."""
    tags = [one.tag for one in get_args(member)[1:] if isinstance(one, Tag)]
    if tags:
        return str(tags[0])
    named = node.field(by) if isinstance(by, str) else None
    return str(named.node.values[0]) if named is not None else ""


def _begin(node: Node, tag: str, tag_of: Callable[[Any], str]) -> dict[str, Any]:
    """The keys by which a section is told from the others, with values to begin with."""
    begin = {
        one.key: one.node.values[0]
        for one in node.fields
        if one.required and one.node.sort == "one_of" and len(one.node.values) == 1
    }
    for one in node.fields:
        if tag_of(begin) == tag:
            break
        if one.required:
            begin[one.key] = one.node.values[0] if one.node.values else ""
    return begin
