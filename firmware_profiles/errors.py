"""Error of a profile that is missing or has invalid keys, and its messages."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

from pydantic import BaseModel, ValidationError


class ProfileError(ValueError):
    """A profile that is missing, has an unknown key or an impossible value."""


_SHOWN: Final = 60
"""Longest value shown, characters."""
_BOUNDS: Final = {
    "exclusiveMinimum": "above",
    "minimum": "at least",
    "exclusiveMaximum": "below",
    "maximum": "at most",
}
_KINDS: Final = {
    "string": "text",
    "number": "a number",
    "integer": "a whole number",
    "boolean": "true or false",
    "array": "a list",
}


def refuse(exc: ValidationError, model: type[BaseModel], file: str) -> str:
    """Return a line for each wrong key: file, key, what it must be and what it is.

    Parameters
    ----------
    exc : ValidationError
    model : type
        Of the profile.
    file : str
    """
    schema = model.model_json_schema()
    return "\n".join(f"{file}: {_sentence(dict(one), schema)}" for one in exc.errors())


def _sentence(problem: dict[str, Any], schema: dict[str, Any]) -> str:
    place, kind = ".".join(map(str, problem["loc"])), problem["type"]
    if kind == "missing":
        return f"{place} is missing; add it: {_must_be(schema, problem['loc'])}"
    if kind == "extra_forbidden":
        return f"{place} is no key here{_is(problem)}; mend its spelling or remove it"
    if kind == "value_error":
        words = str(problem["ctx"]["error"])
        shown = "" if not place or isinstance(problem["input"], dict) else _is(problem)
        return f"{place}: {words}{shown}" if place else words
    if kind in ("model_type", "model_attributes_type"):
        need = _must_be(schema, problem["loc"])
        return f"{place or 'the file'} must be {need}{_is(problem)}"
    if kind == "union_tag_invalid":
        context = problem["ctx"]
        key = f"{place}.{context['discriminator'].strip(chr(39))}"
        return f"{key} must be one of {context['expected_tags']} (is {_short(context['tag'])})"
    if kind == "union_tag_not_found":
        return f"{place}.{problem['ctx']['discriminator'].strip(chr(39))} is missing; add it"
    return f"{place} {wording(problem)}{_is(problem)}"


def _is(problem: dict[str, Any]) -> str:
    return f" (is {_short(problem['input'])})"


def _short(value: object) -> str:
    if value is None:
        return "empty"
    text = repr(value)
    return text if len(text) <= _SHOWN else f"{text[:_SHOWN]}..."


def _must_be(schema: dict[str, Any], loc: tuple[int | str, ...]) -> str:
    """Tell what a key must be, by the profile's JSON schema."""
    part = schema
    for step in loc:
        options = [_resolved(schema, one) for one in part.get("anyOf", part.get("oneOf", [part]))]
        inner = [one.get("properties", {}).get(step, one.get("items")) for one in options]
        part = _resolved(schema, next((one for one in inner if one), {}))
    return _words(part)


def _resolved(schema: dict[str, Any], part: dict[str, Any]) -> dict[str, Any]:
    name = str(part.get("$ref", "")).rpartition("/")[2]
    return {**schema["$defs"][name], **part} if name else part


def _words(part: dict[str, Any]) -> str:
    if "enum" in part:
        return f"one of {', '.join(map(str, part['enum']))}"
    if "properties" in part:
        return f"keys {', '.join(part.get('required', part['properties']))}, each with its value"
    bounds = [f" {words} {part[key]:g}" for key, words in _BOUNDS.items() if key in part]
    return _KINDS.get(part.get("type", ""), "a value") + " and".join(bounds)


_SORTS: Final = {
    "bool": "true or false",
    "dict": "keys with values",
    "float": "a number",
    "int": "a whole number",
    "list": "a list",
    "model": "keys with values",
    "model_attributes": "keys with values",
    "string": "text",
    "tuple": "a list",
}
"""By the part of pydantic's type before ``_type`` or ``_parsing``."""
_WORDS: Final = {
    "extra_forbidden": "is no key here",
    "finite_number": "must be a finite number",
    "greater_than": "must be above {gt:g}",
    "greater_than_equal": "must be at least {ge:g}",
    "int_from_float": "must be a whole number",
    "json_invalid": "isn't JSON: {error}",
    "less_than": "must be below {lt:g}",
    "less_than_equal": "must be at most {le:g}",
    "literal_error": "must be one of {expected}",
    "missing": "is missing",
    "multiple_of": "must be a multiple of {multiple_of:g}",
    "string_pattern_mismatch": "must be written as {pattern}",
    "string_too_long": "must have at most {max_length} characters",
    "string_too_short": "must have at least {min_length} characters",
    "too_long": "must have at most {max_length} entries",
    "too_short": "must have at least {min_length} entries",
    "union_tag_invalid": "{discriminator} is {tag!r}; it must be one of {expected_tags}",
    "union_tag_not_found": "{discriminator} is missing",
}


def wording(problem: Mapping[str, Any]) -> str:
    """Return what is wrong with a value, to be read behind its place.

    Parameters
    ----------
    problem : mapping
        One of pydantic's ``ValidationError.errors()``.
    """
    kind, context = str(problem["type"]), problem.get("ctx", {})
    if kind in _WORDS:
        return _WORDS[kind].format(**context)
    if kind == "value_error":
        return str(problem["msg"]).removeprefix("Value error, ")
    sort = kind.removesuffix("_type").removesuffix("_parsing")
    if sort in _SORTS:
        return f"must be {_SORTS[sort]}"
    words = str(problem["msg"])
    return words.replace("Input should be", "must be").replace("Input should", "must")
