"""Add a dataclass's fields to a command as options, so that several commands can share them."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from dataclasses import fields
from functools import wraps
from typing import Any, get_type_hints


def with_options_of(group: type[Any], name: str) -> Callable[[Callable[..., None]], Any]:
    """Give a command the fields of ``group`` as options, and its parameter ``name`` their values.

    Parameters
    ----------
    group : dataclass
        Each field's type is what typer takes of a parameter; each has a default.
    name : str
        A parameter of the command, of type ``group``: its options stand in the help where it does.
    """

    def grouped(command: Callable[..., None]) -> Callable[..., None]:
        hints = get_type_hints(group, include_extras=True)
        options = [
            inspect.Parameter(
                one.name,
                inspect.Parameter.KEYWORD_ONLY,
                default=one.default,
                annotation=hints[one.name],
            )
            for one in fields(group)
        ]

        @wraps(command)
        def called(**given: Any) -> None:
            taken = {one.name: given.pop(one.name) for one in options}
            command(**given, **{name: group(**taken)})

        called.__signature__ = _replaced(command, name, options)  # type: ignore[attr-defined]
        return called

    return grouped


def _replaced(
    command: Callable[..., None], name: str, options: list[inspect.Parameter]
) -> inspect.Signature:
    """The command's signature with ``options`` in the place of one parameter."""
    plain = inspect.signature(command, eval_str=True)
    parameters: list[inspect.Parameter] = []
    for one in plain.parameters.values():
        kept = one.replace(kind=inspect.Parameter.KEYWORD_ONLY)
        parameters += options if one.name == name else [kept]
    return plain.replace(parameters=parameters)
