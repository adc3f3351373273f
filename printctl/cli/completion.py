"""Shell completion of commands, options, choices and profile names.

Options and choices come from typer, files from the shell itself. Profiles are offered by the
option's name, which nearly always means the same.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from importlib import import_module
from typing import Any, Final, NamedTuple

PROFILES: Final[dict[str, str]] = {
    "--bath": "Bath",
    "--dish": "Dish",
    "--ink": "Ink",
    "--needle": "Needle",
    "--plate": "Plate",
    "--printer": "Printer",
    "--profile": "Printer",
    "--syringe": "Syringe",
}
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


def with_profiles(command: Any) -> Any:
    """Have the options for profiles, of a command and of those in it, offer the shipped names."""
    for param in command.params:
        kind = PROFILES.get(param.opts[0])
        if kind is not None and (command.name, param.opts[0]) not in OTHERWISE:
            # Typer's own way in is where an option is declared: these are, in many places.
            param._custom_shell_complete = _names_of(kind)
    for inner in getattr(command, "commands", {}).values():
        with_profiles(inner)
    return command


def _names_of(kind: str) -> Callable[[Any, Any, str], list[CompletionWord]]:
    """A file of the user's own is completed by the shell, as no shipped name begins like it."""

    def names(ctx: Any, param: Any, begun: str) -> list[CompletionWord]:
        profiles = import_module("firmware_profiles")
        return matching_words(profiles.shipped(getattr(profiles, kind)), begun)

    return names
