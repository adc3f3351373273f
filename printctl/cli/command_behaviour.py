"""Refuse options given twice, and keep names whole in help, in every command."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from importlib import import_module
from typing import Any

from printctl.errors import UsageError


def with_common_behaviour(command: Any) -> Any:
    """Give it to a command and those in it; a group has no options of its own."""
    inner = getattr(command, "commands", {})
    for one in inner.values():
        with_common_behaviour(one)
    if not inner:
        command.parse_args = _once(command)
    command.format_help = _whole(command.format_help)
    return command


def _once(command: Any) -> Callable[[Any, list[str]], Any]:
    """The command's way of parsing, once no option is repeated."""
    parse = command.parse_args

    def parse_args(ctx: Any, args: list[str]) -> Any:
        # What is typed twice is known to the parser alone, which keeps the last.
        given = command.make_parser(ctx).parse_args(args=list(args))[2]
        if not ctx.resilient_parsing:
            _refuse_repeated(given)
        return parse(ctx, args)

    return parse_args


def _whole(write: Callable[[Any, Any], None]) -> Callable[[Any, Any], None]:
    """A way of writing help, by tables that keep names whole."""

    def format_help(ctx: Any, formatter: Any) -> None:
        # Loaded for help alone.
        import_module("printctl.cli.help_table").use_name_tables()
        write(ctx, formatter)

    return format_help


def _refuse_repeated(given: list[Any]) -> None:
    """Refuse an option of one value that stands several times.

    Raises
    ------
    UsageError
    """
    for param, times in Counter(given).items():
        flag = getattr(param, "is_flag", False) and not param.secondary_opts
        if times == 1 or param.param_type_name != "option" or param.multiple or param.count or flag:
            continue
        names = "/".join([*param.opts, *param.secondary_opts])
        raise UsageError(
            f"{names} is given {'twice' if times == 2 else f'{times} times'}, and takes one value; "
            "give it once"
        )
