"""JSON Schema of the recipe, with units and tags for a form, and a recipe's fields by it."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import cache
from typing import Any, Final

from pydantic.json_schema import GenerateJsonSchema, JsonSchemaValue
from pydantic_core import core_schema

from printctl.recipe.model import Recipe

KeyPath = tuple[str | int, ...]
Schema = dict[str, Any]

_UNITS: Final = {
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
"""Unit by a key's suffix; the first that fits counts."""


@cache
def recipe_schema() -> Schema:
    """Return pydantic's JSON Schema of a recipe, with what a form needs besides.

    ``title`` is a key in words, ``unit`` what its suffix says. A union of sections (``oneOf``) has
    ``tags``, the sections' names in the same order, and ``begins``: the keys, with values to begin
    with, by which each is told from the others. ``profile`` and ``file`` mark names of such.
    """
    schema = Recipe.model_json_schema(by_alias=True, schema_generator=_FormSchema)
    for model in (schema, *schema["$defs"].values()):
        model["description"] = model.get("description", "").split("\n\n")[0].replace("\n", " ")
        for key, field in model.get("properties", {}).items():
            suffix = next((one for one in _UNITS if key.endswith(f"_{one}")), "")
            field["title"] = key.removesuffix(f"_{suffix}").replace("_", " ")
            if suffix:
                field["unit"] = _UNITS[suffix]
    for union in _unions(schema):
        tag_of = union.pop("tag_of")
        options = zip(union["tags"], union["oneOf"], strict=True)
        union["begins"] = [_begin(resolved(node, schema), tag, tag_of) for tag, node in options]
    return schema


class _FormSchema(GenerateJsonSchema):
    """Pydantic's JSON Schema with the tags of unions."""

    def tagged_union_schema(self, schema: core_schema.TaggedUnionSchema) -> JsonSchemaValue:
        made, by = super().tagged_union_schema(schema), schema["discriminator"]
        key = by if isinstance(by, str) else ""
        tag_of = by if callable(by) else lambda value: value.get(key)
        return {**made, "tags": list(schema["choices"]), "tag_of": tag_of}

    def sort(self, value: JsonSchemaValue, parent_key: str | None = None) -> JsonSchemaValue:
        return value  # in the model's order


def _unions(value: Any) -> Iterator[Schema]:
    if isinstance(value, dict):
        if "tag_of" in value:
            yield value
        value = list(value.values())
    for one in value if isinstance(value, list) else ():
        yield from _unions(one)


def _begin(node: Schema, tag: str, tag_of: Callable[[Any], Any]) -> Schema:
    needed = [(key, node["properties"][key]) for key in node.get("required", ())]
    begin = {key: one["const"] for key, one in needed if "const" in one}
    for key, one in needed:
        if tag_of(begin) == tag:
            break
        begin.setdefault(key, one["enum"][0] if "enum" in one else "")
    return begin


_INNER: Final = {"properties", "items", "prefixItems"}
"""Of a node whose values are made of others."""


def resolved(node: Schema, root: Schema | None = None) -> Schema:
    """Return a node without references, and without the null beside what else may stand there."""
    if "$ref" in node:
        definition = (root or recipe_schema())["$defs"][node["$ref"].removeprefix("#/$defs/")]
        return resolved({**definition, **{k: v for k, v in node.items() if k != "$ref"}}, root)
    rest = [one for one in node.get("anyOf", ()) if one.get("type") != "null"]
    if len(rest) == 1:
        return resolved({**rest[0], **{k: v for k, v in node.items() if k != "anyOf"}}, root)
    return node


def child_of(node: Schema, key: str | int) -> Schema | None:
    """Return what may stand at a key or index; None for one that the recipe hasn't."""
    found: Any = node.get("properties", {}).get(key)
    if isinstance(key, int):
        found = dict(enumerate(node.get("prefixItems", ()))).get(key, node.get("items"))
    return resolved(found) if isinstance(found, dict) else None


def option_of(node: Schema, value: Any) -> Schema:
    """Return the section of a union that a value is, by its keys; the node where it is no union."""
    if "tags" not in node or not isinstance(value, dict):
        return node
    found, most = {}, -1
    for option, begin in zip(node["oneOf"], node["begins"], strict=True):
        section = resolved(option)
        same = (value.get(k) == section["properties"][k].get("const", value.get(k)) for k in begin)
        if most < len(begin) and all(key in value for key in begin) and all(same):
            found, most = section, len(begin)
    return found


def fields_of(
    value: Any, node: Schema | None = None, path: KeyPath = ()
) -> Iterator[tuple[KeyPath, Any, Schema]]:
    """Give every value of a recipe that isn't made of others, with path and node.

    Unknown keys are left out.
    """
    node = option_of(resolved(recipe_schema() if node is None else node), value)
    inside = value if isinstance(value, dict | list) and _INNER & node.keys() else ()
    if not inside:
        yield path, value, node
    pairs = inside.items() if isinstance(inside, dict) else enumerate(inside)
    for key, inner in pairs:
        child = child_of(node, key)
        if child is not None:
            yield from fields_of(inner, child, (*path, key))


def user_path(loc: KeyPath) -> KeyPath:
    """Return the user's path of pydantic's, which has tags of unions and kinds of values, too."""
    node: Schema | None = recipe_schema()
    path: list[str | int] = []
    for key in loc:
        if node is not None and key in node.get("tags", ()):
            node = resolved(node["oneOf"][node["tags"].index(key)])
            continue
        if node is None or not _INNER & node.keys():
            break
        path.append(key)
        node = child_of(node, key)
    return tuple(path)
