"""Entry point of the command line: the command group, and its error handling."""

from __future__ import annotations

import contextlib
import gc
import json
import os
import sys
from itertools import takewhile
from typing import Annotated, Final

import typer
from rich.console import Console

from printctl.cli.commands import LazyGroup
from printctl.failures import JSON_PRINTED, error_facts, message_and_code

_YOUNG: Final = 100_000
"""Objects between two searches for circles: imports make many and drop none (700 by default).

A design makes a million: the searches took 0.13 s of CPU at 20,000."""

app = typer.Typer(
    name="printctl",
    cls=LazyGroup,
    help="From a tissue's shape to a perfusable print, and the proof that the print is right.",
    no_args_is_help=True,
    add_completion=True,
    pretty_exceptions_enable=False,
    rich_markup_mode="markdown",
)


def _print_version(wanted: bool) -> None:
    if wanted:
        from printctl.version import version

        typer.echo(f"printctl {version()}")
        raise typer.Exit


@app.callback()
def printctl(
    _: Annotated[
        bool,
        typer.Option(
            "--version", callback=_print_version, is_eager=True, help="Print the version."
        ),
    ] = False,
) -> None:
    """Hold the subcommands."""


def main() -> None:
    """Run the command line; a user's mistake ends in one message, never in a traceback.

    With ``--json`` a failure of whatever kind is one object on stdout, too.
    """
    _open_closed_streams()
    gc.set_threshold(_YOUNG)
    # Pydantic looks for plugins in what every installed package says of itself; none is wanted.
    os.environ.setdefault("PYDANTIC_DISABLE_PLUGINS", "1")
    JSON_PRINTED.set(False)
    try:
        app(standalone_mode=True)
    except SystemExit as end:
        refused = end.__context__  # what typer has told on stderr
        if isinstance(refused, typer.Abort):
            _report(refused, "a question wasn't answered; answer it, or give --yes", 1)
        elif (words := getattr(refused, "format_message", None)) is not None:
            _report(refused, words(), int(end.code or 0))
        raise
    except Exception as exc:
        known = message_and_code(exc)
        message, code = known or (f"internal error: {exc!r}", 1)
        _report(exc, message, code)
        if known is None:
            raise
        shown = message.replace("[", "\\[")
        Console(stderr=True, highlight=False, soft_wrap=True).print(
            f"[bold red]printctl:[/] {shown}"
        )
        sys.exit(code)
    finally:
        gc.freeze()  # what ends needs no search for circles among all that it has loaded


def _open_closed_streams() -> None:
    """Open the null device as each of stdin, stdout and stderr that is closed.

    The next file or pipe would get its number, and be a child process' stdin or stdout.
    """
    for number, (name, mode) in enumerate((("stdin", "r"), ("stdout", "w"), ("stderr", "w"))):
        try:
            os.fstat(number)
        except OSError:
            os.open(os.devnull, os.O_RDWR)  # gets the lowest free number, which is this one
            os.set_inheritable(number, True)
        if getattr(sys, name) is None:
            setattr(sys, name, open(number, mode, encoding="utf-8", closefd=False))  # noqa: SIM115


def _report(exc: BaseException | None, message: str, code: int) -> None:
    """Print a failure as one JSON object where ``--json`` was given and none was printed."""
    requested = "--json" in takewhile(lambda word: word != "--", sys.argv[1:])
    if requested and not JSON_PRINTED.get():
        with contextlib.suppress(OSError):  # nobody reads stdout any more
            print(json.dumps(error_facts(exc, message, code), indent=1), flush=True)
