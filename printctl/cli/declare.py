"""Make a command's options of what its parameters, and dataclasses that it takes, declare."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from contextvars import ContextVar
from dataclasses import MISSING, fields, is_dataclass
from functools import wraps
from typing import Annotated, Any, Final, NamedTuple, Protocol, TypeVar, get_origin, get_type_hints

import typer

from printctl.settings import Declared, opt

F = TypeVar("F", bound=Callable[..., Any])
_WANTS_JSON: Final[ContextVar[bool]] = ContextVar("wants_json", default=False)
_JSON: Final = opt("Print one JSON object on stdout and nothing else there.", False, "--json")


class OptionGroup(Protocol):
    """Several options that make one value, as a parameter's default."""

    def parameters(self) -> list[inspect.Parameter]:
        """The options; `Declared` in place of defaults, or annotated as typer takes them."""

    def value(self, typed: dict[str, Any]) -> Any:
        """What the command's parameter gets."""


class _Fields(NamedTuple):
    """The fields of a dataclass as options."""

    group: type[Any]

    def parameters(self) -> list[inspect.Parameter]:
        hints = get_type_hints(self.group, include_extras=True)
        made = []
        for one in fields(self.group):
            default = inspect.Parameter.empty if one.default is MISSING else one.default
            made.append(keyword(one.name, hints[one.name], one.metadata.get("declared", default)))
        return made

    def value(self, typed: dict[str, Any]) -> Any:
        return self.group(**typed)


def keyword(name: str, annotation: Any, default: Any) -> inspect.Parameter:
    """A parameter that is given by name."""
    return inspect.Parameter(
        name, inspect.Parameter.KEYWORD_ONLY, default=default, annotation=annotation
    )


def wants_json() -> bool:
    """Whether the command that runs was given --json."""
    return _WANTS_JSON.get()


def json_command(function: F) -> F:
    """`command` with the option --json, for `wants_json`."""
    return command(function, keyword("as_json", bool, _JSON))


def command(function: F, *more: inspect.Parameter) -> F:
    """Give a function the signature that typer reads, of what its parameters declare.

    A parameter of a dataclass, or whose default is an `OptionGroup`, stands for several options.
    ``more`` options aren't handed to the function.
    """
    groups: dict[str, tuple[OptionGroup, list[str]]] = {}
    made: list[inspect.Parameter] = []
    for one in inspect.signature(function, eval_str=True).parameters.values():
        group: Any = one.default if hasattr(one.default, "parameters") else None
        if isinstance(one.annotation, type) and is_dataclass(one.annotation):
            group = _Fields(one.annotation)
        members = [one] if group is None else group.parameters()
        made += map(_plain, members)
        if group is not None:
            groups[one.name] = (group, [member.name for member in members])
    usual = {one.name: one.default for one in made if one.default is not one.empty}
    made += map(_plain, more)

    @wraps(function)
    def called(*placed: Any, **named: Any) -> Any:
        given = usual | dict(zip((one.name for one in made), placed, strict=False)) | named
        for name, (group, members) in groups.items():
            given[name] = group.value({member: given.pop(member) for member in members})
        token = _WANTS_JSON.set(given.pop("as_json", wants_json()))
        try:
            return function(**given)
        finally:
            _WANTS_JSON.reset(token)

    called.__signature__ = inspect.Signature(made)  # type: ignore[attr-defined]
    return called  # type: ignore[return-value]


def _plain(one: inspect.Parameter) -> inspect.Parameter:
    """The parameter as typer reads it; declared by its default, or in its annotation."""
    declared, kind, default = one.default, one.annotation, one.default
    if isinstance(declared, Declared):
        default = one.empty if declared.default is ... else declared.default
    elif get_origin(kind) is Annotated and isinstance(kind.__metadata__[0], Declared):
        (declared,), kind = kind.__metadata__, kind.__origin__
    else:
        return one.replace(kind=one.KEYWORD_ONLY)
    names = declared.names
    made = typer.Argument if declared.is_argument else typer.Option
    if not (names or declared.is_argument):
        word = "--" + one.name.replace("_", "-")
        both = kind in (bool, bool | None) and default is not False
        names = (f"{word}/--no-{word[2:]}" if both else word,)
    return keyword(
        one.name, Annotated[kind, made(*names, help=declared.text, **declared.facts)], default
    )


def declared(function: Callable[..., Any]) -> Callable[..., Any]:
    """The function as `command` makes it, if it isn't made so already."""
    return function if hasattr(function, "__signature__") else command(function)


def group(app: typer.Typer, *commands: Callable[..., Any], **named: Callable[..., Any]) -> Any:
    """Add commands to a group, under their own names or those given."""
    for name, one in ({one.__name__: one for one in commands} | named).items():
        app.command(name.replace("_", "-"))(declared(one))
    return app
