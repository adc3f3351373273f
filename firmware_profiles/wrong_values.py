"""Turn a pydantic validation error into a short phrase: must be above 0, is missing."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

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
