"""Options, inputs and output that several subcommands share."""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.console import Console

from design.units import LengthUnit
from gcode.errors import GcodeError
from gcode.user_files import read_gcode_path, text_of
from printctl.cli.declare import wants_json
from printctl.errors import UsageError
from printctl.failures import JSON_PRINTED, message_and_code
from printctl.machine.network.host import KEY_FILE_VARIABLE, read_key
from printctl.settings import arg, opt


def folder_to_write(folder: Path | None) -> Path | None:
    """Return the folder of an --out; raise `UsageError` where it is a file, or lies in one."""
    for place in () if folder is None else (folder, *folder.parents):
        if place.exists() and not place.is_dir():
            raise UsageError(f"--out {folder}: {place} is a file; give a folder's name")
    return folder


def _checked(wanted: bool) -> bool:
    """Refuse --pdf before the work starts where no browser is installed."""
    if wanted:
        from report.print_page import browser_missing  # Only wanted here.

        missing = browser_missing()
        if missing is not None:
            raise UsageError(f"--pdf: {missing}")
    return wanted


RecipeArg = Annotated[Path, arg("The recipe, a YAML file.")]
GcodeArg = Annotated[Path, arg("The G-code file.")]
RunArg = Annotated[
    Path,
    arg("The print: its folder, its recipe's run folder, or its G-code file.", metavar="RUN"),
]
GoingOnArg = Annotated[
    Path | None,
    arg(
        "The print: its folder, its recipe's run folder, or its G-code file. Not needed while "
        "exactly one is running.",
        metavar="[RUN]",
    ),
]
YesFlag = Annotated[bool, opt("Start a print on a real printer without asking first.")]
HostKeyOption = Annotated[
    Path | None,
    opt("File with the key or password of a network host (or set PRINTCTL_HOST_KEY)."),
]
OutFolder = Annotated[Path, opt("Folder for the files.", callback=folder_to_write)]
PdfFlag = Annotated[
    bool,
    opt(
        "Also export the page as PDF, using an installed Chromium, Chrome or Edge.",
        callback=_checked,
    ),
]
ProgressFileOption = Annotated[
    Path | None, opt("Append progress to this file, one JSON line per step.")
]

CameraFile = Annotated[
    Path | None, opt("File of `printctl calibrate camera`: scale and distortion.")
]

# A print's set-up.
PrinterOption = Annotated[str, opt("Printer profile: a shipped name or a .yaml file.")]
_MOUNTED = {"show_default": "what is mounted"}
SyringeOption = Annotated[
    str | None, opt("Syringe profile: a shipped name or a .yaml file.", **_MOUNTED)
]
InkOption = Annotated[str | None, opt("Ink profile.", **_MOUNTED)]
StartOption = Annotated[
    str | None,
    opt(
        "Tip position before the first line in printer coordinates, mm; default: as set by the "
        "file's first lines (G92), otherwise 0,0,0.",
        metavar="X,Y,Z",
    ),
]
# A vessel network.
SourceArg = Annotated[Path, arg("A run folder, or a network: .csv, .vtp, .swc, .json, .npz, .txt.")]
UnitOption = Annotated[
    LengthUnit | None,
    opt("Length unit of the file, if it isn't specified there (.csv, .vtp, .stl, .swc, .txt)."),
]


def use_host_key(file: Path | None) -> None:
    """Have a network host's key read from a file, by this process and those that it starts."""
    if file is not None:
        os.environ[KEY_FILE_VARIABLE] = str(file.absolute())
        read_key()


def messages() -> Console:
    """Console for messages: stderr, so that stdout holds results only."""
    return Console(stderr=True, highlight=False, soft_wrap=True)


def print_note(note: str) -> None:
    """Say one line to people, whatever brackets stand in it."""
    messages().print(note, markup=False)


def print_notes(notes: Iterable[str]) -> None:
    """Say what a user should know beside the result, a line each."""
    for note in notes:
        print_note(f"note: {note}")


def print_dim(notes: Iterable[str]) -> None:
    """Say what was read and how, a line each; nothing beside JSON."""
    for note in () if wants_json() else notes:
        messages().print(note, style="dim", markup=False)


def print_warning(text: str) -> None:
    """Say what spoils a result."""
    messages().print(text, style="yellow", markup=False)


def print_json(value: Any) -> None:
    """Print one JSON object on stdout."""
    JSON_PRINTED.set(True)
    sys.stdout.write(json.dumps(value, indent=1, allow_nan=False, default=float) + "\n")


def print_lines(*lines: str) -> None:
    """Print results for people on stdout."""
    sys.stdout.write("\n".join(lines) + "\n")


def print_result(
    facts: Any, lines: Iterable[str] | Callable[[], Iterable[str]], passed: bool = True
) -> None:
    """Print a result: with --json one object, else ``lines``, which are made only then.

    Where not ``passed`` the command ends by it, with exit code 1.
    """
    if wants_json():
        print_json(facts)
    else:
        print_lines(*(lines() if callable(lines) else lines))
    if not passed:
        raise typer.Exit(1)


def is_typed(context: typer.Context, name: str) -> bool:
    """Whether an option stands on the command line, by its parameter's name."""
    source = context.get_parameter_source(name)
    return source is not None and source.name == "COMMANDLINE"


def refuse_typed(context: typer.Context, names: Iterable[str], why: str) -> None:
    """Raise `UsageError` for the first of these parameters that stands on the command line.

    The message is ``why``, after the option as it is typed.
    """
    words = {one.name: one.opts[0] for one in context.command.params}
    for name in names:
        if is_typed(context, name):
            raise UsageError(f"{words[name]} {why}")


def refuse_input_as_output(out: Path | None, *inputs: Path) -> None:
    """Raise `UsageError` where a file that the command reads is to be written, by any name."""
    if out is None or not out.exists():
        return
    for one in inputs:
        if one.exists() and out.samefile(one):
            raise UsageError(f"{out} is what this command reads; give another name to write to")


def gcode_to_write(out: Path, *inputs: Path) -> None:
    """Raise `UsageError` for a folder, or a file that the command reads, as the G-code's name."""
    if out.is_dir():
        raise UsageError(f"{out} is a folder; give the name of a .gcode file in it")
    refuse_input_as_output(out, *inputs)


def read_gcode_file(path: Path) -> bytes:
    """Read a G-code file that the user named; raise `UsageError` if it can't be or is no text."""
    try:
        gcode = read_gcode_path(path)
        text_of(gcode)
    except OSError as exc:
        raise UsageError(f"{path} can't be read: {exc.strerror}; check the path") from exc
    except GcodeError as exc:
        raise UsageError(f"{path}: {exc}") from exc
    return gcode


def message_of(exc: Exception) -> str | None:
    """Return the user's message for a failure; None for an internal error."""
    known = message_and_code(exc)
    return None if known is None else known[0]
