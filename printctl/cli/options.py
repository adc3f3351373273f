"""Options and output that several subcommands share."""

from __future__ import annotations

import json
import math
import sys
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.console import Console

from design.units import BLOOD_MPA_S, LengthUnit
from printctl.errors import UsageError
from printctl.failures import JSON_PRINTED, message_and_code
from printctl.pipeline.lock import run_lock
from printctl.progress_file import ProgressFile
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


# Options shared by commands on vessel networks: file, unit, tissue mesh, inlet flow, viscosity.

SourceArg = Annotated[
    Path,
    typer.Argument(
        help="A run folder, or a network: .csv, .vtp, .swc, .json, .npz, .txt.", show_default=False
    ),
]
UnitOption = Annotated[
    LengthUnit | None,
    typer.Option("--unit", help="Of the file, where it doesn't say (.csv, .vtp, .stl, .swc)."),
]
TissueOption = Annotated[
    Path | None,
    typer.Option("--tissue", help="A closed mesh, or a run folder; a run has its own."),
]
TissueUnitOption = Annotated[
    LengthUnit | None, typer.Option("--tissue-unit", help="Of the tissue's mesh.")
]
InletFlowOption = Annotated[
    float | None,
    typer.Option(
        "--inlet-flow-ml-min", min=1e-9, help="In place of a run's own; of a file 0.25 without it."
    ),
]
ViscosityOption = Annotated[
    float | None,
    typer.Option(
        "--viscosity-mpa-s",
        min=1e-6,
        help=f"In place of a run's own; of a file {BLOOD_MPA_S:g}, blood's, without it.",
    ),
]


def _checked(wanted: bool) -> bool:
    if wanted:
        from registration.report.print_page import browser_missing  # Only wanted here.

        missing = browser_missing()
        if missing is not None:
            raise UsageError(f"--pdf: {missing}")
    return wanted


PdfFlag = Annotated[
    bool,
    typer.Option(
        "--pdf",
        help="Print the page to a PDF too, by an installed Chromium, Chrome or Edge.",
        # Before the work starts.
        callback=_checked,
    ),
]


# `--progress-file` option: write a command's progress to a file for other programs to read.

ProgressFileOption = Annotated[
    Path | None,
    typer.Option("--progress-file", help="Append progress to this file, a line of JSON a step."),
]


def message_of(exc: Exception) -> str | None:
    """Return the user's message for a failure; None for an internal error."""
    known = message_and_code(exc)
    return None if known is None else known[0]


@dataclass
class Steps:
    """A command's few steps, told as a run's stages; nothing without a file.

    Attributes
    ----------
    path : Path or None
    folder : Path
        Which the command works in; locked meanwhile where progress is asked for.
    names : sequence of str
    """

    path: Path | None
    folder: Path
    names: Sequence[str]
    _at: list[str] = field(default_factory=list)
    _told: ProgressFile | None = None

    @contextmanager
    def whole(self) -> Iterator[None]:
        """Tell the end, too, whichever way it comes."""
        if self.path is None:
            yield
            return
        progress = ProgressFile(self.path)
        with ExitStack() as stack:
            stack.enter_context(progress.whole(message_of))
            stack.enter_context(run_lock(self.folder))
            progress.begin(self.names, self.names[-1])
            self._told = progress
            yield
            progress.done(self._at[-1], "")

    def begin(self, name: str) -> None:
        """Say that a step begins, and that the one before has ended."""
        if self._told is None:
            return
        if self._at:
            self._told.done(self._at[-1], "")
        self._at.append(name)
        self._told.stage(name, 0.0)


# Command-line options of a print's set-up: needle, bath, dish, shaft crossings to accept.

NeedleOption = Annotated[
    str | None,
    typer.Option(
        "--needle", help="Needle profile; force and walls need it. Of several heads: left,right."
    ),
]
ThinnestBoreOption = Annotated[
    float,
    typer.Option(
        "--thinnest-bore",
        min=0.05,
        max=2.0,
        help="Narrowest line, over the needle's bore (0.8 of 0.2 mm are 0.16 mm); try it on the "
        "ink first.",
    ),
]
BathOption = Annotated[
    str | None, typer.Option("--bath", help="Bath profile; chemistry and warmth need it.")
]
DishOption = Annotated[str | None, typer.Option("--dish", help="Dish profile; walls need it.")]
DishCentreOption = Annotated[
    str | None,
    typer.Option("--dish-centre", metavar="X,Y", help="Printer's frame; below --start if not."),
]
BathDepthOption = Annotated[
    float | None, typer.Option("--bath-depth", help="How high the dish is filled, mm.", min=0.1)
]
