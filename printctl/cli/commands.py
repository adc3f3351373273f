"""List of the subcommands; command group that imports each one's module only when it is used.

A command's module is imported when it is asked for, not before: `printctl pause` shouldn't wait
for the mesh library that `printctl solid` needs.
"""

from __future__ import annotations

import ast
import inspect
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import Any, Final

import typer
from typer.core import TyperCommand, TyperGroup

from printctl.cli.command_behaviour import with_common_behaviour
from printctl.cli.completion import matching_words, with_profiles
from printctl.cli.help_examples import with_manual
from printctl.errors import PrintctlError

# Extract the commands' help summaries from their source, without importing them.


def summary(module: str, attribute: str) -> str:
    """Return the docstring of a function, or the `help` of a group, that stands in a module.

    Parameters
    ----------
    module : str
        Its whole name.
    attribute : str
        A function's name, or one that a `typer.Typer(help=...)` is assigned to.

    Raises
    ------
    LookupError
        When the module has no such source.
    """
    spec = find_spec(module)
    if spec is None or spec.origin is None:
        raise LookupError(f"no source of {module}")
    for node in ast.parse(Path(spec.origin).read_text(encoding="utf-8")).body:
        if isinstance(node, ast.FunctionDef) and node.name == attribute:
            return ast.get_docstring(node) or ""
        if isinstance(node, ast.Assign) and isinstance(node.value, ast.Call):
            names = [one.id for one in node.targets if isinstance(one, ast.Name)]
            if attribute in names:
                return _help_of(node.value)
    raise LookupError(f"{module} has no function or group {attribute}")


def _help_of(call: ast.Call) -> str:
    for keyword in call.keywords:
        if keyword.arg == "help":
            return inspect.cleandoc(str(ast.literal_eval(keyword.value)))
    return ""


COMMANDS: dict[str, str] = {
    "run": "run:run",
    "design": "design:design",
    "toolpath": "toolpath:toolpath",
    "slice": "slice:slice_mesh",
    "simulate": "simulate:simulate",
    "print": "print_job:print_job",
    "station": "station:station",
    "status": "status:status",
    "stop": "stop:stop",
    "kill": "stop:kill",
    "pause": "pause:pause",
    "resume": "resume:resume",
    "reload": "reload:reload",
    "alive": "alive:alive",
    "recover": "recover:recover",
    "give-up": "give_up:give_up",
    "sim-printer": "sim_printer:sim_printer",
    "scan": "scan:scan",
    "register": "register:register",
    "dye": "dye:dye",
    "overlay": "overlay:overlay",
    "compare": "compare:compare_prints",
    "compensate": "compensate:compensate",
    "view": "view:view",
    "film": "film:film",
    "convert": "convert:convert",
    "solid": "solid:solid",
    "measure": "measure:measure",
    "search": "search:search",
    "flow": "flow:flow",
    "oxygen": "oxygen:oxygen",
    "lumens": "lumens:lumens",
    "ports": "ports:ports",
    "profiles": "profiles:profiles",
    "history": "history:history",
    "calibrate": "calibrate:calibrate",
    "observe": "observe:observe",
    "serve": "serve:serve",
    "doctor": "doctor:doctor",
    "init": "init:init",
    "recipe": "recipe:recipe",
}
"""Name to module of `printctl.cli` and what stands in it: a function, or a group of commands."""
CALLED_WITH: dict[str, dict[str, Any]] = {
    "sim-printer": {"allow_extra_args": True, "ignore_unknown_options": True}
}
"""Of commands that hand on what they are given."""
GO_ON: Final = frozenset({"run", "design", "search"})
"""Commands that don't do again what an interrupted one has finished."""


class _UserInterruptError(PrintctlError):
    """The user pressed Ctrl-C."""

    exit_code = 130


class LazyGroup(TyperGroup):
    """The subcommands of `COMMANDS`, in their order, each imported when it is used."""

    _listing = False
    """Whether only names and summaries are asked for, which need no import."""

    def invoke(self, ctx: Any) -> Any:
        """Run the command; Ctrl-C ends it with a word and exit code 130."""
        try:
            return super().invoke(ctx)
        except KeyboardInterrupt as exc:
            more = "; the same command goes on from what is done"
            goes_on = ctx.invoked_subcommand in GO_ON
            raise _UserInterruptError(f"interrupted{more if goes_on else ''}") from exc

    def list_commands(self, ctx: Any) -> list[str]:
        """Names, in the order of help."""
        return list(COMMANDS)

    def get_command(self, ctx: Any, cmd_name: str) -> Any:
        """The command of that name, or None."""
        if cmd_name not in COMMANDS:
            return None
        module, attribute = COMMANDS[cmd_name].split(":")
        module = f"printctl.cli.{module}"
        if self._listing:
            return TyperCommand(cmd_name, help=summary(module, attribute))
        loaded = getattr(import_module(module), attribute)
        if isinstance(loaded, typer.Typer):
            command: Any = typer.main.get_group(loaded)
        else:
            alone = typer.Typer(add_completion=False, rich_markup_mode="markdown")
            alone.command(cmd_name, context_settings=CALLED_WITH.get(cmd_name))(loaded)
            command = typer.main.get_command(alone)
        command.name = cmd_name
        return with_common_behaviour(with_profiles(with_manual(command, cmd_name)))

    def format_help(self, ctx: Any, formatter: Any) -> None:
        """Write the help, with each command's summary."""
        self._listing = True
        try:
            super().format_help(ctx, formatter)
        finally:
            self._listing = False

    def shell_complete(self, ctx: Any, incomplete: str) -> Any:
        """What may be typed next; a command isn't loaded for its name alone."""
        if incomplete.startswith("-"):
            return super().shell_complete(ctx, incomplete)
        return matching_words(COMMANDS, incomplete)

    def resolve_command(self, ctx: Any, args: list[str]) -> Any:
        """Find what was typed; for a slip of the pen the base class looks at `commands`."""
        names: Any = dict.fromkeys(COMMANDS)
        self.commands = names
        return super().resolve_command(ctx, args)
