"""Convert the recipe's pydantic models to the form's tree of fields with units and limits."""

from __future__ import annotations

import inspect
import types
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cache
from typing import Annotated, Any, Literal, Union, get_args, get_origin

from annotated_types import Ge, Gt, Le, Lt
from pydantic import BaseModel, Discriminator, Tag
from pydantic.fields import FieldInfo

from printctl.recipe import Recipe
from printctl.web.design.schema.nodes import FormField, Node, Option
from printctl.web.design.schema.units import unit_of

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
