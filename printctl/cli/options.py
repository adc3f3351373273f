"""Options shared by subcommands; parse numbers, read G-code files, print results to stdout."""

from __future__ import annotations

import json
import math
import sys
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.console import Console

from printctl.errors import UsageError
from printctl.failures import JSON_PRINTED
from sim.user_files import read_gcode_path

RecipeArg = Annotated[Path, typer.Argument(help="The recipe, a YAML file.", show_default=False)]
JsonFlag = Annotated[
    bool, typer.Option("--json", help="Print one JSON object on stdout and nothing else there.")
]
YesFlag = Annotated[
    bool, typer.Option("--yes", help="Start a print on a real printer without asking first.")
]
PrinterOption = Annotated[
    str, typer.Option("--printer", help="Printer profile: a shipped name or a .yaml file.")
]
SyringeOption = Annotated[
    str, typer.Option("--syringe", help="Syringe profile: a shipped name or a .yaml file.")
]
StartOption = Annotated[
    str | None,
    typer.Option(
        "--start",
        metavar="X,Y,Z",
        help="Where the needle's tip stands before the first line, printer's frame, mm; where the "
        "file's first lines tell it (G92), else 0,0,0, if not given.",
    ),
]


def messages() -> Console:
    """Console for messages: stderr, so that stdout holds results only."""
    return Console(stderr=True, highlight=False, soft_wrap=True)


def print_note(note: str) -> None:
    """Say one line to people, whatever brackets stand in it."""
    messages().print(note, markup=False)


def print_json(value: Any) -> None:
    """Print one JSON object on stdout."""
    JSON_PRINTED.set(True)
    sys.stdout.write(json.dumps(value, indent=1, allow_nan=False, default=float) + "\n")


def print_lines(*lines: str) -> None:
    """Print results for people on stdout."""
    sys.stdout.write("\n".join(lines) + "\n")


def three_numbers(text: str, option: str) -> tuple[float, float, float]:
    """Read ``X,Y,Z``.

    Raises
    ------
    UsageError
        When the text isn't three finite numbers.
    """
    try:
        x, y, z = (float(part) for part in text.split(","))
    except ValueError as exc:
        unit = "µm" if option.endswith("-um") else "mm"
        raise UsageError(
            f"{option} {text!r} isn't X,Y,Z in {unit}; write it like 100,100,10"
        ) from exc
    if not all(map(math.isfinite, (x, y, z))):
        raise UsageError(f"{option} {text!r} has a number that isn't finite")
    return x, y, z


def two_numbers(text: str, option: str) -> tuple[float, float]:
    """Read ``LOW,HIGH``.

    Raises
    ------
    UsageError
        When the text isn't two finite numbers, the lower one first.
    """
    try:
        low, high = (float(part) for part in text.split(","))
    except ValueError as exc:
        raise UsageError(f"{option} {text!r} isn't LOW,HIGH; write it like -40,20") from exc
    if not -math.inf < low < high < math.inf:
        raise UsageError(f"{option} {text!r} must be two finite numbers, the lower one first")
    return low, high


def folder_to_write(folder: Path | None) -> Path | None:
    """Return the folder of an --out, which may be there or not.

    Raises
    ------
    UsageError
        Where it is a file, or lies in one.
    """
    for place in () if folder is None else (folder, *folder.parents):
        if place.exists() and not place.is_dir():
            raise UsageError(f"--out {folder}: {place} is a file; give a folder's name")
    return folder


def refuse_input_as_output(out: Path | None, *inputs: Path) -> None:
    """Refuse to write over a file that the command reads.

    Raises
    ------
    UsageError
        Where ``out`` is one of ``inputs``, by whatever name.
    """
    if out is None or not out.exists():
        return
    for one in inputs:
        if one.exists() and out.samefile(one):
            raise UsageError(f"{out} is what this command reads; give another name to write to")


def read_gcode_file(path: Path) -> bytes:
    """Read a G-code file that the user named.

    Raises
    ------
    UsageError
        When it can't be read.
    """
    try:
        return read_gcode_path(path)
    except OSError as exc:
        raise UsageError(f"{path} can't be read: {exc.strerror}; check the path") from exc
