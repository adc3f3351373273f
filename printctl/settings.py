"""Describe settings once: help, default and bounds, for every door that asks for them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, NamedTuple, TypeVar, dataclass_transform

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


@dataclass_transform(frozen_default=True, kw_only_default=True)
def settings(group: type[T]) -> type[T]:
    """Make a frozen dataclass of a class whose fields may be declared by `opt`."""
    for name, value in list(vars(group).items()):
        if isinstance(value, Declared):
            default = {} if value.default is ... else {"default": value.default}
            setattr(group, name, field(**default, metadata={"declared": value}))
    return dataclass(frozen=True, kw_only=True)(group)
