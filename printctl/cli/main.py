"""Entry point of the command line: the command group, and its error handling."""

from __future__ import annotations

import gc
import sys
from typing import Final

import typer
from rich.console import Console

from printctl.cli.commands import LazyGroup
from printctl.failures import message_and_code

_YOUNG: Final = 20_000
"""Objects between two searches for circles: imports make many and drop none (700 by default)."""

app = typer.Typer(
    name="printctl",
    cls=LazyGroup,
    help="From a tissue's shape to a perfusable print, and the proof that the print is right.",
    no_args_is_help=True,
    add_completion=True,
    pretty_exceptions_enable=False,
    rich_markup_mode="markdown",
)


@app.callback()
def printctl() -> None:
    """Hold the subcommands."""


def main() -> None:
    """Run the command line; a user's mistake ends in one message, never in a traceback."""
    gc.set_threshold(_YOUNG)
    try:
        app(standalone_mode=True)
    except Exception as exc:
        known = message_and_code(exc)
        if known is None:
            raise
        _fail(*known)
    finally:
        gc.freeze()  # what ends needs no search for circles among all that it has loaded


def _fail(message: str, code: int) -> None:
    Console(stderr=True, highlight=False, soft_wrap=True).print(
        f"[bold red]printctl:[/] {message.replace('[', chr(92) + '[')}"
    )
    sys.exit(code)
