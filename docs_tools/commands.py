"""Write docs/commands.md from the command line's own help: `python -m docs_tools.commands`."""

from __future__ import annotations

import typing
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final, Literal

import typer

from design.files import write_text
from printctl.cli.help_examples import ALWAYS, MANUAL
from printctl.cli.main import app

PAGE: Final = Path(__file__).parents[1] / "docs" / "commands.md"
HEAD: Final = """# Commands

Made from the commands' own help by `make docs`; `printctl COMMAND --help` says the same. Exit codes
are 0 done, 1 failed, 2 wrong use, 3 a safety check refused, 4 the printer failed. Results go to
stdout, all else to stderr. An option that takes one value is given once.

`printctl --install-completion` makes the shell complete commands, options, profile names and files.
"""


def commands() -> Iterator[tuple[str, Any]]:
    """Every command and group but the root, as ``calibrate weigh``, in the order of help."""
    yield from _below(typer.main.get_command(app), ())


def page() -> str:
    """The whole page."""
    return "\n".join([HEAD, *(_section(name, command) for name, command in commands())])


def _below(command: Any, path: tuple[str, ...]) -> Iterator[tuple[str, Any]]:
    if path:
        yield " ".join(path), command
    for name in command.list_commands(None) if hasattr(command, "list_commands") else ():
        yield from _below(command.get_command(None, name), (*path, name))


def _section(name: str, command: Any) -> str:
    is_group = hasattr(command, "list_commands")
    shown = [one for one in command.params if one.name != "help" and not one.hidden]
    parts = [f"## {name}", "", command.help.strip(), ""]
    parts += ["```text", *MANUAL[name].examples, "```", ""]
    if shown and not is_group:
        parts += ["| | | default |", "|---|---|---|", *map(_row, shown), ""]
    codes = {k: v for k, v in MANUAL[name].exit_codes().items() if ALWAYS.get(k) != v}
    if codes:
        said = "; ".join(f"{code} {meaning}" for code, meaning in codes.items())
        parts += [f"Exit codes besides 0 and 2: {said}.", ""]
    return "\n".join(parts)


def _row(param: Any) -> str:
    names = ", ".join(f"`{one}`" for one in (*param.opts, *param.secondary_opts))
    value = _value(param)
    cells = (f"{names} {value}".strip(), param.help, _default(param))
    return (
        "| " + " | ".join(str(cell).replace("|", "\\|").replace("\n", " ") for cell in cells) + " |"
    )


def _value(param: Any) -> str:
    """What is given for it: choices, a hint, bounds; nothing for a flag."""
    choices = _choices(param.type_descriptor.annotation)
    words = " ".join(f"`{one}`" for one in choices) if choices else (param.metavar or "")
    low, high = param.min, param.max
    if low is None and high is None:
        return words
    bounds = (
        f"{low:g} to {high:g}"
        if None not in (low, high)
        else (f"from {low:g}" if high is None else f"up to {high:g}")
    )
    return f"{words} ({bounds})".strip()


def _choices(annotation: Any) -> tuple[str, ...]:
    if typing.get_origin(annotation) is Literal:
        return tuple(map(str, typing.get_args(annotation)))
    return tuple(one for inner in typing.get_args(annotation) for one in _choices(inner))


def _default(param: Any) -> str:
    if param.required:
        return "needed"
    if isinstance(getattr(param, "show_default", None), str):
        shown = param.show_default
        return shown if " " in shown else f"`{shown}`"
    default = param.default() if callable(param.default) else param.default
    if default in (None, False, (), []) or not getattr(param, "show_default", True):
        return ""
    return f"`{default:g}`" if isinstance(default, float) else f"`{default}`"


if __name__ == "__main__":
    write_text(PAGE, page())
