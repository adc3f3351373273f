"""Write docs/commands.md from the command line's own help: `python -m docs_tools.commands`."""

from __future__ import annotations

import typing
from collections.abc import Iterator
from itertools import starmap
from pathlib import Path
from typing import Any, Final, Literal

import typer

from design.files import write_text
from printctl.cli.help_examples import ALWAYS, MANUAL, PRINTS, REACHES
from printctl.cli.main import app

MAX_NAMED: Final = 6
"""Of more commands than this, a group of shared options gives only the number."""
PAGE: Final = Path(__file__).parents[1] / "docs" / "commands.md"
HEAD: Final = """# Commands

Made from the commands' own help by `make docs`; `printctl COMMAND --help` has the same. Exit codes:
0 done, 1 failed, 2 wrong use; where a command lists them, 3 a safety check refused it, 4 the
printer or the link to it failed, or the print was stopped. Results go to stdout, all else to
stderr. An option that takes one value is given once.

`printctl --install-completion` makes the shell complete commands, options, profile names and files.
"""


def commands() -> Iterator[tuple[str, Any]]:
    """Every command and group but the root, as ``calibrate weigh``, in the order of help."""
    yield from _below(typer.main.get_command(app), ())


def page() -> str:
    """The whole page."""
    shared = _shared()
    sections = (_section(name, command, shared) for name, command in commands())
    return "\n".join([HEAD, _shared_section(shared), *sections])


def _below(command: Any, path: tuple[str, ...]) -> Iterator[tuple[str, Any]]:
    if path:
        yield " ".join(path), command
    for name in command.list_commands(None) if hasattr(command, "list_commands") else ():
        yield from _below(command.get_command(None, name), (*path, name))


def _shown(command: Any) -> list[Any]:
    """Parameters in the order of help; none of a group."""
    if hasattr(command, "list_commands"):
        return []
    return [one for one in command.params if one.name != "help" and not one.hidden]


def _shared() -> dict[str, tuple[str, ...]]:
    """Parameters that several commands take with the same help, and those commands."""
    takers: dict[str, list[str]] = {}
    for name, command in commands():
        for param in _shown(command):
            takers.setdefault(_item(param), []).append(name)
    return {item: tuple(names) for item, names in takers.items() if len(names) > 1}


def _shared_section(shared: dict[str, tuple[str, ...]]) -> str:
    by_takers: dict[tuple[str, ...], list[str]] = {}
    for item, names in shared.items():
        by_takers.setdefault(names, []).append(item)
    parts = ["## Shared options", "", "Each command names the ones that it takes.", ""]
    for names, items in sorted(by_takers.items(), key=lambda pair: -len(pair[0])):
        takers = ", ".join(f"`{name}`" for name in names)
        parts += [takers if len(names) <= MAX_NAMED else f"{len(names)} commands", "", *items, ""]
    return "\n".join(parts)


def _section(name: str, command: Any, shared: dict[str, tuple[str, ...]]) -> str:
    parts = [f"## {name}", "", command.help.strip(), ""]
    if hasattr(command, "list_commands"):
        return "\n".join(parts)
    parts += [*(f"    {example}" for example in MANUAL[name].examples), ""]
    items = [(param, _item(param)) for param in _shown(command)]
    own = [item for _, item in items if item not in shared]
    parts += [*own, ""] if own else []
    shared_names = ", ".join(_names(param) for param, item in items if item in shared)
    parts += [f"[Shared](#shared-options): {shared_names}.", ""] if shared_names else []
    codes = {k: v for k, v in MANUAL[name].exit_codes().items() if ALWAYS.get(k) != v}
    if codes:
        parts += [f"Exit codes: {'; '.join(starmap(_exit_code, codes.items()))}.", ""]
    return "\n".join(parts)


def _exit_code(code: int, meaning: str) -> str:
    """The code alone where the page's head gives its meaning."""
    in_head = (code, meaning) in (*PRINTS.items(), *REACHES.items())
    return f"{code}" if in_head else f"{code} {meaning}"


def _item(param: Any) -> str:
    """One parameter as an item of a list, as Typer's own pages have it."""
    default = _default(param)
    head = f"{_head(param)} {_value(param)}".strip()
    line = f"- {head}: {param.help}" + (f" Default {default}." if default else "")
    return line.replace("\n", " ")


def _head(param: Any) -> str:
    return f"{_names(param)} (needed)" if param.required else _names(param)


def _names(param: Any) -> str:
    return ", ".join(f"`{one}`" for one in (*param.opts, *param.secondary_opts))


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
        return ""
    if isinstance(getattr(param, "show_default", None), str):
        shown = param.show_default
        return shown if " " in shown else f"`{shown}`"
    default = param.default() if callable(param.default) else param.default
    if default in (None, False, (), [], "") or not getattr(param, "show_default", True):
        return ""
    return f"`{default:g}`" if isinstance(default, float) else f"`{default}`"


if __name__ == "__main__":
    write_text(PAGE, page())
