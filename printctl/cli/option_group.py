"""Add options to a command that several commands share, or that a recipe's section declares."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Sequence
from dataclasses import fields
from functools import wraps
from typing import Any, get_type_hints

_KEYWORD = inspect.Parameter.KEYWORD_ONLY


def with_options_of(group: type[Any], name: str) -> Callable[[Callable[..., None]], Any]:
    """Give a command the fields of ``group`` as options, and its parameter ``name`` their values.

    Parameters
    ----------
    group : dataclass
        Each field's type is what typer takes of a parameter; each has a default.
    name : str
        A parameter of the command, of type ``group``: its options stand in the help where it does.
    """
    hints = get_type_hints(group, include_extras=True)
    options = [
        inspect.Parameter(one.name, _KEYWORD, default=one.default, annotation=hints[one.name])
        for one in fields(group)
    ]
    return with_options(options, name, lambda typed: group(**typed))


def with_options(
    options: Sequence[inspect.Parameter], name: str, value: Callable[[dict[str, Any]], Any]
) -> Callable[[Callable[..., None]], Any]:
    """Give a command ``options`` where its parameter ``name`` stands, which gets what they say.

    Parameters
    ----------
    value : callable
        Takes what was typed, by the options' names; returns what the parameter gets.
    """

    def grouped(command: Callable[..., None]) -> Callable[..., None]:
        @wraps(command)
        def called(**given: Any) -> None:
            typed = {one.name: given.pop(one.name) for one in options}
            command(**given, **{name: value(typed)})

        called.__signature__ = _replaced(command, name, options)  # type: ignore[attr-defined]
        return called

    return grouped


def _replaced(
    command: Callable[..., None], name: str, options: Sequence[inspect.Parameter]
) -> inspect.Signature:
    """The command's signature with ``options`` in the place of one parameter."""
    plain = inspect.signature(command, eval_str=True)
    parameters: list[inspect.Parameter] = []
    for one in plain.parameters.values():
        parameters += options if one.name == name else [one.replace(kind=_KEYWORD)]
    return plain.replace(parameters=parameters)
