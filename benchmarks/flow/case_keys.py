"""Checked access to the keys of parsed JSON and YAML input files.

Every function raises `FlowError` with the place, the key and what to write there.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Set
from typing import Any

from design.errors import FlowError


def parse_json(text: str) -> Any:
    """Parse JSON; refuse infinite numbers and a key given twice (unless a comment)."""
    try:
        return json.loads(text, object_pairs_hook=_once, parse_constant=_refuse)
    except FlowError:  # which is a ValueError too
        raise
    except (ValueError, RecursionError) as exc:
        raise FlowError(f"not readable as JSON: {exc}") from exc


def _once(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    data = dict(pairs)
    if len(data) < len(pairs):
        names = [name for name, _ in pairs if not name.startswith("_")]
        twice = next((name for name in names if names.count(name) > 1), None)
        if twice is not None:
            raise FlowError(f"the key {twice!r} stands twice in one object; leave one out")
    return data


def _refuse(constant: str) -> None:
    raise FlowError(f"{constant} isn't a number in JSON; write a finite one")


def check_keys(data: Any, place: str, known: Set[str]) -> Mapping[str, Any]:
    """Return ``data`` as a mapping of known keys; those that begin with ``_`` are comments."""
    if not isinstance(data, Mapping):
        raise FlowError(f"{place} is {_short(data)}; write an object with keys")
    if data.keys() <= known:
        return data
    for key in data:
        if key not in known and not key.startswith("_"):
            names = ", ".join(sorted(known)) or "none"
            raise FlowError(f"{place} has the key {key!r}, which isn't modelled; known: {names}")
    return data


def entries(data: Mapping[str, Any], key: str) -> list[Any]:
    """Return the list under ``key``; an absent one is empty."""
    value = data.get(key, [])
    if not isinstance(value, list):
        raise FlowError(f"{key} is {_short(value)}; write a list")
    return value


def text(data: Mapping[str, Any], key: str, place: str) -> str:
    """Return the name under ``key``: printable text without comma or quotation mark."""
    value = data.get(key)
    if not isinstance(value, str) or not value:
        raise FlowError(f"{place}: {key} is {_short(value)}; write a name")
    if not value.isprintable() or set(value) & set(',"'):
        raise FlowError(
            f"{place}: {key} is {_short(value)}; a name has no comma, quotation mark or line "
            "break, which would break the table of results"
        )
    return value


def number(data: Mapping[str, Any], key: str, place: str, default: float | None = None) -> float:
    """Return the finite number under ``key``, or ``default`` where it is absent."""
    if key not in data and default is not None:
        return default
    value = data.get(key)
    if type(value) is float and math.isfinite(value):
        return value
    if isinstance(value, list):
        raise FlowError(f"{place}: {key} changes over time, which isn't modelled; write a number")
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise FlowError(f"{place}: {key} is {_short(value)}; write a number")
    try:
        amount = float(value)
    except OverflowError:  # an integer of hundreds of digits
        amount = math.inf
    if not math.isfinite(amount):
        raise FlowError(f"{place}: {key} is {_short(value)}; write a finite number")
    return amount


def whole(
    data: Mapping[str, Any], key: str, place: str, least: int, default: int | None = None
) -> int:
    """Return the integer under ``key``, at least ``least``."""
    value = data.get(key, default)
    if isinstance(value, float) and value.is_integer():
        value = int(value)
    if isinstance(value, bool) or not isinstance(value, int) or value < least:
        raise FlowError(f"{place}: {key} is {_short(value)}; write an integer of {least} or more")
    return value


def flag(data: Mapping[str, Any], key: str, place: str, default: bool) -> bool:
    """Return the truth value under ``key``."""
    value = data.get(key, default)
    if not isinstance(value, bool):
        raise FlowError(f"{place}: {key} is {_short(value)}; write true or false")
    return value


def _short(value: Any) -> str:
    if value is None:
        return "missing"
    shown = repr(value)
    return shown if len(shown) <= 40 else f"{shown[:37]}..."
