"""Subcommands of `printctl`: their list, imported only when used; what all have in common."""

from __future__ import annotations

import ast
import inspect
from collections import Counter
from collections.abc import Callable, Iterable
from functools import partial
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import Any, Final, NamedTuple

import typer
from typer.core import TyperCommand, TyperGroup

from printctl.cli.declare import declared
from printctl.errors import PrintctlError, UsageError


def equipped(command: Any, name: str) -> Any:
    """Give a command, and those in it, what all have in common.

    That is the shipped names for options of profiles, the refusal of options given twice or without
    their value, and help that ends with examples and keeps names whole. A group has no options of
    its own.
    """
    inner = getattr(command, "commands", {})
    for word, one in inner.items():
        equipped(one, f"{name} {word}")
    for param in command.params:
        kind = PROFILES.get(param.opts[0])
        if kind is not None and (command.name, param.opts[0]) not in OTHERWISE:
            # Typer's own way in is where an option is declared: these are, in many places.
            param._custom_shell_complete = partial(_profile_names, kind)
    if not inner:
        command.parse_args = partial(_parse_once, command, command.parse_args)
    command.format_help = partial(_write_help, command, name, command.format_help)
    return command


def _write_help(
    command: Any, name: str, write: Callable[[Any, Any], None], ctx: Any, formatter: Any
) -> None:
    """Write help with its examples, by tables that keep names whole; both loaded for it alone."""
    examples = import_module("printctl.cli.help_examples")
    examples.use_name_tables()
    if name in examples.MANUAL:
        command.epilog = examples.MANUAL[name].epilog()
        command.rich_markup_mode = "markdown"
    write(ctx, formatter)


def _parse_once(command: Any, parse: Callable[..., Any], ctx: Any, args: list[str]) -> Any:
    """Parse, once no option is repeated or takes another for its value."""
    # What is typed twice is known to the parser alone, which keeps the last.
    values, _, given = command.make_parser(ctx).parse_args(args=list(args))
    if not ctx.resilient_parsing:
        _refuse_repeated(given)
        _refuse_swallowed(command, values)
    return parse(ctx, args)


def _refuse_repeated(given: list[Any]) -> None:
    """Refuse an option of one value that stands several times."""
    for param, times in Counter(given).items():
        flag = getattr(param, "is_flag", False) and not param.secondary_opts
        if times == 1 or param.param_type_name != "option" or param.multiple or param.count or flag:
            continue
        names = "/".join([*param.opts, *param.secondary_opts])
        raise UsageError(
            f"{names} is given {'twice' if times == 2 else f'{times} times'}, and takes one value; "
            "give it once"
        )


def _refuse_swallowed(command: Any, values: dict[str, Any]) -> None:
    """Refuse an option whose value is the name of another: its own value was left out."""
    options = [param for param in command.params if param.param_type_name == "option"]
    names = {name for param in options for name in (*param.opts, *param.secondary_opts)}
    for param in options:
        value = values.get(param.name)
        for word in value if isinstance(value, list) else [value]:
            if isinstance(word, str) and word in names:
                raise UsageError(
                    f"{'/'.join(param.opts)} takes a value, and {word} follows it, which is an "
                    f"option; give the value behind {param.opts[-1]}"
                )


# Options and choices come from typer, files from the shell itself. Profiles are offered by the
# option's name, which nearly always means the same.
_KINDS: Final = "Bath", "Dish", "Ink", "Needle", "Plate", "Printer", "Syringe"
PROFILES: Final = {f"--{kind.lower()}": kind for kind in _KINDS} | {"--profile": "Printer"}
"""Class of `firmware_profiles` by the option that names one; it is imported when Tab is pressed."""
OTHERWISE: Final = {("flow", "--profile")}
"""Command and option that means another thing there: of the pulse, in this case."""


class CompletionWord(NamedTuple):
    """A word that may come next, as typer takes it."""

    value: str
    type: str = "plain"
    help: str | None = None


def matching_words(words: Iterable[str], begun: str) -> list[CompletionWord]:
    """Those of the words that begin as what was typed."""
    return [CompletionWord(word) for word in words if word.startswith(begun)]


def _profile_names(kind: str, ctx: Any, param: Any, begun: str) -> list[CompletionWord]:
    """A file of the user's own is completed by the shell, as no shipped name begins like it."""
    profiles = import_module("firmware_profiles")
    return matching_words(profiles.shipped(getattr(profiles, kind)), begun)


# Extract the commands' help summaries from their source, without importing them.
def summary(module: str, attribute: str) -> str:
    """Return the docstring of a function, or the help of a `typer.Typer`, named so in a module.

    Raises `LookupError` when the module's source has none.
    """
    spec = find_spec(module)
    source = Path((spec and spec.origin) or "").read_text(encoding="utf-8")
    for node in ast.parse(source).body:
        if isinstance(node, ast.FunctionDef) and node.name == attribute:
            return ast.get_docstring(node) or ""
        if isinstance(node, ast.Assign) and attribute in map(ast.unparse, node.targets):
            for one in ast.walk(node.value):
                if isinstance(one, ast.keyword) and one.arg == "help":
                    return inspect.cleandoc(str(ast.literal_eval(one.value)))
    raise LookupError(f"{module} has no help of {attribute}")


GROUPS: Final[dict[str, dict[str, str]]] = {
    "Design": {
        "init": "design.run:init",
        "run": "design.run:run",
        "recipe": "design.run:recipe",
        "design": "design.run:design",
        "search": "design.search:search",
        "flow": "design.flow:flow",
        "oxygen": "design.measure:oxygen",
        "measure": "design.measure:measure",
        "solid": "design.solid:solid",
    },
    "Prepare a print": {
        "toolpath": "design.run:toolpath",
        "slice": "design.slice:slice_mesh",
        "simulate": "machine.simulate:simulate",
        "lumens": "design.lumens:lumens",
    },
    "Machine": {
        "commission": "machine.commission:commission",
        "ports": "machine.station:ports",
        "profiles": "machine.profiles:profiles",
        "calibrate": "machine.calibrate:calibrate",
        "mount": "machine.mount:mount",
        "station": "machine.station:station",
        "print": "machine.print_job:print_job",
        "observe": "machine.observe:observe",
        "status": "machine.running_print:status",
        "pause": "machine.running_print:pause",
        "resume": "machine.running_print:resume",
        "reload": "machine.running_print:reload",
        "cancel": "machine.running_print:cancel",
        "emergency-stop": "machine.running_print:emergency_stop",
        "alive": "machine.running_print:confirm_presence",
        "recover": "machine.running_print:recover",
        "give-up": "machine.running_print:give_up",
        "history": "judge.history:history",
        "sim-printer": "machine.station:sim_printer",
    },
    "Judge": {
        "scan": "judge.scan:scan",
        "register": "judge.register:register",
        "overlay": "judge.overlay:overlay",
        "dye": "judge.dye:dye",
        "compare": "judge.compare:compare_prints",
        "compensate": "judge.compare:compensate",
    },
    "Files": {
        "view": "design.view:view",
        "film": "design.view:film",
        "convert": "design.solid:convert",
    },
    "Page and help": {
        "serve": "serve:serve",
        "doctor": "doctor:doctor",
    },
}
"""By panel of the help: name to module of `printctl.cli` and the function or group in it."""
COMMANDS: Final = {name: place for group in GROUPS.values() for name, place in group.items()}
ALIASES: Final = {
    "stop": "machine.running_print:stop",
    "kill": COMMANDS["emergency-stop"],
}
"""Earlier names, which still work but aren't listed."""
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
            done = f": {exc}" if str(exc) else ""
            raise _UserInterruptError(f"interrupted{done}{more if goes_on else ''}") from exc

    def list_commands(self, ctx: Any) -> list[str]:
        """Names, in the order of help."""
        return list(COMMANDS)

    def get_command(self, ctx: Any, cmd_name: str) -> Any:
        """The command of that name, or None."""
        place = COMMANDS.get(cmd_name) or ALIASES.get(cmd_name)
        if place is None:
            return None
        module, attribute = place.split(":")
        module = f"printctl.cli.{module}"
        if self._listing:
            panel = next(panel for panel, names in GROUPS.items() if cmd_name in names)
            return TyperCommand(cmd_name, help=summary(module, attribute), rich_help_panel=panel)
        loaded = getattr(import_module(module), attribute)
        if isinstance(loaded, typer.Typer):
            command: Any = typer.main.get_group(loaded)
        else:
            alone = typer.Typer(add_completion=False, rich_markup_mode="markdown")
            alone.command(cmd_name, context_settings=CALLED_WITH.get(cmd_name))(declared(loaded))
            command = typer.main.get_command(alone)
        command.name = cmd_name
        return equipped(command, cmd_name)

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
