"""JSON objects of a registration: their type, and conversion of nested values."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, NotRequired, TypedDict, TypeGuard

Record = Mapping[str, Any]
"""A JSON object, as of ``registration.json``."""


class Verdict(TypedDict):
    """On a print, or on several; ``passed`` is None where none of them has a verdict."""

    passed: bool | None
    undecided: bool
    causes: NotRequired[list[str]]
    reasons: list[str]


def json_ready(value: Any) -> Any:
    """Return nested values with string keys, and None for NaN and infinity, which JSON has not."""
    if isinstance(value, dict):
        return {str(key): json_ready(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [json_ready(item) for item in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value


def json_object(record: Record) -> dict[str, Any]:
    """Return a record with its values as `json_ready` gives them."""
    return {str(key): json_ready(value) for key, value in record.items()}


def is_number(value: Any) -> TypeGuard[float]:
    """Whether ``value`` is a finite number (a bool isn't one)."""
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)
