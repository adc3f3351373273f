"""Options that several subcommands share, and how results leave on stdout."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.console import Console

RecipeArg = Annotated[Path, typer.Argument(help="The recipe, a YAML file.", show_default=False)]
JsonFlag = Annotated[
    bool, typer.Option("--json", help="Print one JSON object on stdout and nothing else there.")
]
PrinterOption = Annotated[
    str, typer.Option("--printer", help="Printer profile: a shipped name or a .yaml file.")
]


def messages() -> Console:
    """Where people are spoken to: stderr, so that stdout holds results only."""
    return Console(stderr=True, highlight=False, soft_wrap=True)


def print_json(value: Any) -> None:
    """Print one JSON object on stdout."""
    sys.stdout.write(json.dumps(value, indent=1, allow_nan=False, default=float) + "\n")


def print_lines(*lines: str) -> None:
    """Print results for people on stdout."""
    sys.stdout.write("\n".join(lines) + "\n")
