"""Describe settings once: help, default and bounds, for every door that asks for them."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass, field, is_dataclass
from typing import Any, Final, NamedTuple, TypeVar, dataclass_transform, get_args

from printctl.errors import UsageError

T = TypeVar("T")


class Declared(NamedTuple):
    """What stands in place of a default: the help, the default (... for none), names, bounds."""

    text: str
    default: Any
    names: tuple[str, ...]
    facts: Mapping[str, Any]
    is_argument: bool = False


def opt(text: str, default: Any = None, *names: str, **facts: Any) -> Any:
    """Declare an option, named like the field or parameter unless ``names`` are given.

    Parameters
    ----------
    text : str
        Its help.
    default : object
        ``...`` where it must be given.
    **facts
        min, max, metavar and so on, as of `typer.Option`.
    """
    return Declared(text, default, names, facts)


def arg(text: str, default: Any = ..., **facts: Any) -> Any:
    """Declare an argument; see `opt`."""
    shown: dict[str, Any] = {"show_default": False} if default is ... else {}
    return Declared(text, default, (), shown | facts, is_argument=True)


_UNITS: Final = {"s": "s", "min": "min", "mm": "mm", "um": "µm", "ul": "µL", "mm_s": "mm/s"}
_BOUNDS: Final = {"ge": "min", "le": "max"}


def of(model: Any, key: str, *names: str, **facts: Any) -> Any:
    """Declare an option that stands for a field of a model, by what the model says of it.

    Parameters
    ----------
    model : type
        A pydantic model, or made by `settings`.
    key : str
        The field's; its unit is given where an option's name lacks it.
    **facts
        As of `opt`; a ``default`` in place of the model's, which the help then names, or
        ``otherwise`` in its place.
    """
    if is_dataclass(model):
        return model.__dataclass_fields__[key].metadata["declared"]
    info = model.model_fields[key]
    text, usual = info.description or "", info.get_default(call_default_factory=True)
    text = re.sub(
        r"\w+_\w+",
        lambda word: f"--{word[0].replace('_', '-')}" if word[0] in model.model_fields else word[0],
        text,
    ).rstrip(".")
    unit = next((end for end in ("mm_s", key.rpartition("_")[2]) if key.endswith(f"_{end}")), "")
    sign = _UNITS.get(unit, "") if names else ""
    if sign and not names[0].endswith(unit) and not re.search(rf"\b{sign}\b", text):
        text += f" ({sign})"
    default = facts.pop("default", usual)
    shown = f"{usual:g}" if isinstance(usual, float) else usual
    if default is None and usual is not None:
        text += f"; else {facts.pop('otherwise', shown)}"
    return opt(f"{text}.", default, *names, **(_bounds(info) | facts))


def _bounds(info: Any) -> dict[str, Any]:
    """Bounds of a field, its optional value's included."""
    inner = (one for arg in get_args(info.annotation) for one in getattr(arg, "__metadata__", ()))
    stated = [*info.metadata, *(rule for one in inner for rule in getattr(one, "metadata", ()))]
    return {
        name: getattr(rule, bound)
        for rule in stated
        for bound, name in _BOUNDS.items()
        if hasattr(rule, bound)
    }


@dataclass_transform(frozen_default=True)
def settings(group: type[T]) -> type[T]:
    """Make a frozen dataclass of a class whose fields may be declared by `opt`."""
    for name, value in list(vars(group).items()):
        if isinstance(value, Declared):
            default = {} if value.default is ... else {"default": value.default}
            setattr(group, name, field(**default, metadata={"declared": value}))
    return dataclass(frozen=True)(group)


def three_numbers(text: str, option: str) -> tuple[float, float, float]:
    """Read ``X,Y,Z``.

    Raises
    ------
    UsageError
        When the text isn't three finite numbers.
    """
    try:
        x, y, z = (float(part) for part in text.split(","))
    except ValueError as exc:
        unit = "µm" if option.endswith("-um") else "mm"
        raise UsageError(
            f"{option} {text!r} isn't X,Y,Z in {unit}; write it like 100,100,10"
        ) from exc
    if not all(map(math.isfinite, (x, y, z))):
        raise UsageError(f"{option} {text!r} has a number that isn't finite")
    return x, y, z


def two_numbers(text: str, option: str) -> tuple[float, float]:
    """Read ``LOW,HIGH``.

    Raises
    ------
    UsageError
        When the text isn't two finite numbers, the lower one first.
    """
    try:
        low, high = (float(part) for part in text.split(","))
    except ValueError as exc:
        raise UsageError(f"{option} {text!r} isn't LOW,HIGH; write it like -40,20") from exc
    if not -math.inf < low < high < math.inf:
        raise UsageError(f"{option} {text!r} must be two finite numbers, the lower one first")
    return low, high


def numbers_of(text: str, option: str) -> list[float]:
    """Read ``1,2,3``.

    Raises
    ------
    UsageError
        When one isn't a number.
    """
    try:
        return [float(word) for word in text.split(",")]
    except ValueError as exc:
        raise UsageError(f"{option} {text!r} isn't a list of numbers; write it like 2,4,6") from exc
