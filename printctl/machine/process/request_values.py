"""Read typed values (whole number, text, flag, list) from a client's JSON request, or refuse it."""

from __future__ import annotations

import math
from collections.abc import Mapping
from enum import StrEnum
from typing import Any, TypeVar

from printctl.machine.errors import Refused

Request = Mapping[str, Any]
Choice = TypeVar("Choice", bound=StrEnum)


def whole(request: Request, name: str) -> int:
    """Return a whole number that must be there.

    Raises
    ------
    Refused
        Here and below: for a value of another type.
    """
    value = request.get(name)
    if type(value) is not int:  # a bool is an int to isinstance
        raise _refusal(request, name, "a whole number")
    return value


def perhaps_whole(request: Request, name: str) -> int | None:
    """Return a whole number; None where there is none."""
    return None if request.get(name) is None else whole(request, name)


def perhaps_number(request: Request, name: str) -> float | None:
    """Return a finite number; None where there is none."""
    value = request.get(name)
    if value is None:
        return None
    if type(value) not in (int, float) or not math.isfinite(value):
        raise _refusal(request, name, "a number")
    return float(value)


def text(request: Request, name: str, default: str | None = None) -> str:
    """Return a text; without a default it must be there."""
    value = request.get(name, default)
    if not isinstance(value, str):
        raise _refusal(request, name, "a text")
    return value


def texts(request: Request, name: str) -> list[str]:
    """Return a list of texts; an empty one where there is none."""
    value = request.get(name, [])
    if not isinstance(value, list) or not all(isinstance(one, str) for one in value):
        raise _refusal(request, name, "a list of texts")
    return value


def flag(request: Request, name: str) -> bool:
    """Return true or false; false where there is none."""
    value = request.get(name, False)
    if not isinstance(value, bool):
        raise _refusal(request, name, "true or false")
    return value


def perhaps_object(request: Request, name: str) -> dict[str, Any] | None:
    """Return an object; None where there is none."""
    value = request.get(name)
    if value is not None and not isinstance(value, dict):
        raise _refusal(request, name, "an object")
    return value


def one_of(request: Request, name: str, choices: type[Choice]) -> Choice:
    """Return one of some words, which must be there."""
    value = request.get(name)
    if value not in list(choices):
        raise _refusal(request, name, f"one of {', '.join(choices)}")
    return choices(value)


def _refusal(request: Request, name: str, wanted: str) -> Refused:
    value = repr(request[name])[:80] if name in request else "missing"
    return Refused(f"{request.get('do')}: {name} is {value}, and must be {wanted}")
