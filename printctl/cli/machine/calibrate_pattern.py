"""`printctl calibrate pattern`: write a calibration print of lines, gaps, joints or bridges."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

import numpy as np
import typer

from firmware_profiles import Ink, load
from printctl.calibration import widths as measuring
from printctl.calibration.pattern_job import (
    LineShape,
    PatternMachine,
    PatternOptions,
    pattern_job,
    write_pattern_job,
)
from printctl.calibration.patterns import COLUMNS, WrittenPattern, read_pattern
from printctl.checks.set_up import ProfileNames
from printctl.cli import options as cli
from printctl.cli.declare import command, json_command, wants_json
from printctl.cli.machine.calibrate_measured import (
    AcceptChange,
    Write,
    machine_parts,
    print_estimates,
)
from printctl.errors import UsageError
from printctl.settings import arg, numbers_of, of, opt, three_numbers
from registration.devices.lens import read_lens

_OWN = {
    "lines": {"speeds", "flow_factors", "length", "repeats", "steps"},
    "spiral": {"speed", "turns", "pitch"},
    "joint": {"speed", "overlaps"},
    "bridge": {"speed", "spans", "height"},
    "comb": {"speed", "gaps"},
    "squares": {"speed", "across"},
}
"""Options of each pattern alone."""
_CORNERS = 4


@command
def pattern(
    *,
    context: typer.Context,
    name: Literal["lines", "spiral", "joint", "bridge", "comb", "squares"] = arg(
        "Pattern: lines, spiral, joint, bridge, comb or squares."
    ),
    output: Path = opt(
        "G-code file to write; .csv, .json and .svg files are written next to it.",
        ...,
        "--output",
        "-o",
    ),
    needle: str | None = opt("Needle profile.", show_default="what is mounted"),
    printer: str | None = opt(
        "Printer profile: shipped name or .yaml file.", None, "--printer", "--profile"
    ),
    syringe: cli.SyringeOption = None,
    ink: cli.InkOption = None,
    bath: str | None = of(ProfileNames, "bath"),
    dish: str | None = of(ProfileNames, "dish"),
    dish_centre: str | None = of(ProfileNames, "dish_centre"),
    bath_depth: float | None = of(ProfileNames, "bath_depth"),
    at: str = opt(
        "Centre of the pattern and height of its lines, mm.", "100,100,5", metavar="X,Y,Z"
    ),
    width: float | None = opt("Bead width, mm; default: the needle bore."),
    layer: float | None = opt("Layer height, mm; default: half the bead width."),
    round_bead: bool | None = opt(
        "Print round filaments in a bath (default with --bath), or flat beads on a plate.",
        None,
        "--round/--flat",
    ),
    own: PatternOptions,
) -> None:
    """Write a calibration print: G-code, a drawing, a sheet to type widths into.

    It is printed with `printctl print`; `printctl calibrate widths` reads it, and of squares
    `printctl observe frame --printed`.
    """
    has = ", ".join(f"--{one.replace('_', '-')}" for one in sorted(_OWN[name]))
    cli.refuse_typed(
        context,
        sorted(set().union(*_OWN.values()) - _OWN[name]),
        f"changes nothing about the pattern {name}, which has {has}; leave it out, or write "
        "another pattern",
    )
    place, shape = three_numbers(at, "--at"), LineShape(width, layer, round_bead)
    held = {"syringe": syringe, "ink": ink, "needle": needle}
    parts = machine_parts(printer, tuple(held), **held, bath=bath, dish=dish)
    machine = PatternMachine(*(parts[part] for part in PatternMachine._fields))
    bath, dish = parts["bath"] or None, parts["dish"] or None
    placed = ProfileNames(machine.needle, bath, dish, dish_centre, bath_depth)
    job = pattern_job(output, name, own, shape, machine, placed, place)
    lines, seconds, notes = write_pattern_job(job)
    start, made = ",".join(f"{value:g}" for value in job.at_mm), job.written.pattern
    if not made.bead.round_bead:
        notes = (
            *notes,
            f"lines {made.bead.layer_mm:g} mm high on a plate: --at's Z must be that much above it "
            "(--bath or --round for filaments in a bath)",
        )
    cli.print_notes(notes)
    reads = "and what `printctl observe frame --printed` needs"
    if made.name in COLUMNS:
        reads = "the sheet to fill in, and what `printctl calibrate widths` needs to read them or "
        reads += "a picture"
    x, y = made.size_mm
    cli.print_lines(
        f"{job.path}: {lines} lines, {seconds:.0f} s, {x:.1f} x {y:.1f} mm; put the tip to {start} "
        f"and print it with --start {start}",
        f"{', '.join(map(str, job.beside))}: what is where, {reads}",
    )


@json_command
def widths(
    file: Path = arg("The completed measurement sheet (.csv), or an image."),
    pattern: Path | None = opt("JSON file of the pattern; default: FILE with the suffix .json."),
    um_per_px: float | None = opt(
        "Image scale from a stage micrometer, instead of the frame.", min=0.01, max=1000
    ),
    marks: str | None = opt(
        "Pixel coordinates of the frame corners if it isn't detected: lower left, lower right, "
        "upper right, upper left, as on the drawing.",
        metavar="U,V,…",
    ),
    camera: cli.CameraFile = None,
    flow_factor: float | None = opt(
        "Flow factor from weighing; the swelling is then reported.", min=0.2, max=5
    ),
    ink: str | None = opt("Ink profile for --write; default: the ink it was printed with."),
    write: Write = None,
    accept_change: AcceptChange = False,
) -> None:
    """Widths of a calibration print, and what they say of the ink.

    Of a picture it writes, beside it, NAME.measured.png to judge by, and NAME.widths.csv.
    """
    typed = file.suffix.lower() == ".csv"
    if typed and (um_per_px is not None or marks is not None or camera is not None):
        raise UsageError(
            "--um-per-px, --marks and --camera are of a picture; a sheet has its widths in mm"
        )
    if um_per_px is not None and camera is not None:
        raise UsageError("--camera has the scale: leave --um-per-px out, or --camera")
    written = _pattern(file, pattern)
    if written.pattern.name not in ("lines", "spiral") and flow_factor is not None:
        raise UsageError(
            "--flow-factor belongs to lines or a spiral; this is a pattern of "
            f"{written.pattern.name}"
        )
    notes: list[str] = []
    if typed:
        measured = measuring.read_sheet(file, written)
    else:
        lens = None if camera is None else read_lens(camera)
        corners = None if marks is None else _corners(marks)
        seen = measuring.measure_picture(
            file, written, measuring.PictureFacts(um_per_px, corners, lens)
        )
        drawn, table = seen.save(file)
        cli.print_note(f"wrote {drawn} (judge by it) and {table}")
        measured, notes = seen.measured, seen.notes
    answer = measuring.fit_measured(written, measured, measuring.GivenValues(flow_factor))
    if not wants_json():
        cli.print_lines(*answer.table)
    print_estimates(answer.lines, [*notes, *answer.notes])
    if write is not None:
        written.mounted.refuse_other(ink)
        held = load(Ink, ink or written.mounted.ink)
        cli.print_note(f"wrote {write}: {answer.save(write, held, accept_change=accept_change)}")


def _pattern(file: Path, named: Path | None) -> WrittenPattern:
    if not file.is_file():
        raise UsageError(f"{file} doesn't exist; give the sheet (.csv) or a picture")
    if named is None:
        named = file.with_suffix(".json")
        if not named.is_file():
            raise UsageError(
                f"{named} isn't there: name the file that `printctl calibrate pattern` wrote "
                "beside the G-code (--pattern)"
            )
    written = read_pattern(named)
    if written.pattern.name not in COLUMNS:
        raise UsageError(
            f"{named} is a pattern of {written.pattern.name}, which ties a camera to the printer "
            "and has no widths to read; use printctl observe frame --printed"
        )
    return written


def _corners(text: str) -> np.ndarray:
    values = numbers_of(text.replace(";", ","), "--marks")
    if len(values) != 2 * _CORNERS:
        raise UsageError(
            f"--marks {text!r} has {len(values)} numbers; give {2 * _CORNERS}: u,v of the lower "
            "left, lower right, upper right and upper left corner"
        )
    return np.array(values).reshape(_CORNERS, 2)
