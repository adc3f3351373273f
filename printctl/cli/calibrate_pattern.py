"""`printctl calibrate pattern`: write a calibration print of lines, gaps, joints or bridges."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
import typer

from design.files import write_text
from design.toolpath.gcode import GcodeOptions, save_gcode, write_gcode
from firmware_profiles import Dish, Ink, Needle, Printer, Syringe, load
from printctl.calibration.patterns import (
    COLUMNS,
    Bead,
    LineSeries,
    Pattern,
    PatternSetUp,
    WrittenPattern,
    bridge_pattern,
    comb_pattern,
    joint_pattern,
    lines_pattern,
    pattern_path,
    sheet_svg,
    sheet_text,
    spiral_pattern,
    squares_pattern,
)
from printctl.checks.preflight import SetUp, file_checks, refuse_failed, warnings
from printctl.checks.set_up import ProfileNames, set_up
from printctl.cli import calibrate_pattern_options as options
from printctl.cli import set_up_options as mounting
from printctl.cli.calibrate_options import numbers_of
from printctl.cli.options import (
    SyringeOption,
    messages,
    print_lines,
    three_numbers,
)
from printctl.errors import UsageError
from sim.gcode.dry_run.run import dry_run

_BESIDE = (".svg", ".csv", ".json")
_OWN = {
    "lines": {"speeds", "flow_factors", "length", "repeats", "steps"},
    "spiral": {"speed", "turns", "pitch"},
    "joint": {"speed", "overlaps"},
    "bridge": {"speed", "spans", "height"},
    "comb": {"speed", "gaps"},
    "squares": {"speed", "across"},
}
"""Options of each pattern alone."""
_ACROSS_MM: Final = 50.0
_CLEAR_MM: Final = 1.5
"""Between needle and dish."""


def pattern(
    context: typer.Context,
    name: options.Name,
    output: options.Output,
    needle: options.NeedleName,
    printer: options.PrinterName = "generic_marlin",
    syringe: SyringeOption = "hamilton_1ml",
    ink: options.InkName = "collagen_fresh",
    bath: mounting.BathOption = None,
    dish: mounting.DishOption = None,
    dish_centre: mounting.DishCentreOption = None,
    bath_depth: mounting.BathDepthOption = None,
    at: options.At = "100,100,5",
    width: options.Width = None,
    layer: options.Layer = None,
    round_bead: options.RoundBead = None,
    speeds: options.Speeds = "2,5,8",
    flow_factors: options.FlowFactors = "0.8,1,1.2",
    length: options.Length = 24.0,
    repeats: options.Repeats = 1,
    steps: options.Steps = 2,
    speed: options.Speed = 5.0,
    turns: options.Turns = 5.0,
    pitch: options.Pitch = None,
    gaps: options.Gaps = None,
    overlaps: options.Overlaps = "-1.5,-1,-0.5,0,0.5,1",
    spans: options.Spans = "1,2,3,4,6",
    height: options.Height = 2.0,
    across: options.Across = None,
) -> None:
    """Write a calibration print: G-code, a drawing, a sheet to type widths into.

    It is printed with `printctl print`; `printctl calibrate widths` reads it, and of squares
    `printctl observe frame --printed`.
    """
    _refuse_others(context, name)
    place = three_numbers(at, "--at")
    _refuse_beside(output)
    wide = load(Needle, needle).inner_mm if width is None else width
    bead = _bead(wide, layer, bath is not None if round_bead is None else round_bead, ink)
    own = _Own(speeds, flow_factors, length, repeats, steps, speed, turns, pitch, gaps, overlaps,
               spans, height, _across(across, dish, needle))  # fmt: skip
    machine, material = load(Printer, printer), load(Ink, ink)
    _refuse_air(machine)
    named = ProfileNames(needle, bath, dish, dish_centre, bath_depth)
    set_for = set_up(machine, syringe, ink, place, named)
    used = PatternSetUp(printer, syringe, ink, needle, material.flow_factor, material.swell_factor)
    _write(
        _Job(
            output,
            WrittenPattern(_made(name, bead, own), used, place),
            set_for,
            place,
            load(Syringe, syringe),
        )
    )


@dataclass(frozen=True)
class _Own:
    """Options of single patterns, as they were said (`_OWN`)."""

    speeds: str
    flow_factors: str
    length: float
    repeats: int
    steps: int
    speed: float
    turns: float
    pitch: float | None
    gaps: str | None
    overlaps: str
    spans: str
    height: float
    across: float


def _made(name: str, bead: Bead, own: _Own) -> Pattern:
    """Return the pattern of a name, by its options as they were said."""
    if name == "lines":
        return lines_pattern(bead, _asked(own))
    if name == "spiral":
        pitch = 5 * bead.width_mm if own.pitch is None else own.pitch
        return spiral_pattern(bead, own.speed, own.turns, pitch)
    if name == "joint":
        return joint_pattern(bead, numbers_of(own.overlaps, "--overlaps"), own.speed)
    if name == "bridge":
        return bridge_pattern(bead, numbers_of(own.spans, "--spans"), own.height, own.speed)
    if name == "squares":
        return squares_pattern(bead, own.across, own.speed)
    return comb_pattern(bead, _gaps(own.gaps, bead.width_mm), own.speed)


def _asked(own: _Own) -> LineSeries:
    return LineSeries(
        numbers_of(own.speeds, "--speeds"),
        numbers_of(own.flow_factors, "--flow-factors"),
        own.length,
        own.repeats,
        own.steps,
    )


def _refuse_beside(output: Path) -> None:
    """Refuse a name that a file beside the G-code gets."""
    if output.suffix.lower() in _BESIDE:
        raise UsageError(
            f"-o {output}: that is to be the G-code, and {', '.join(_BESIDE)} are written beside "
            "it; end it in .gcode"
        )


def _bead(wide: float, layer: float | None, round_bead: bool, ink: str) -> Bead:
    high = wide / 2 if layer is None else layer
    if not 0.02 <= wide <= 5 or not 0.01 <= high <= 5:
        raise UsageError(
            f"a line {wide:g} mm wide in layers of {high:g} mm: give 0.02 to 5 mm (--width) and "
            "0.01 to 5 mm (--layer)"
        )
    return Bead(wide, high, round_bead, load(Ink, ink).bead)


def _refuse_others(context: typer.Context, name: str) -> None:
    """Refuse what belongs to another pattern: it would do nothing."""
    others = sorted(set().union(*_OWN.values()) - _OWN[name])
    for option in others:
        source = context.get_parameter_source(option)
        if source is not None and source.name == "COMMANDLINE":
            own = ", ".join(f"--{one.replace('_', '-')}" for one in sorted(_OWN[name]))
            raise UsageError(
                f"--{option.replace('_', '-')} changes nothing about the pattern {name}, which "
                f"has {own}; leave it out, or write another pattern"
            )


@dataclass(frozen=True)
class _Job:
    """What is to be written, where."""

    path: Path
    written: WrittenPattern
    set_up: SetUp
    at_mm: tuple[float, float, float]
    syringe: Syringe


def _gaps(text: str | None, width: float) -> list[float]:
    if text is not None:
        return numbers_of(text, "--gaps")
    return [round(width * part, 3) for part in (0.2, 0.35, 0.5, 0.75, 1.0, 1.5, 2.0)]


def _refuse_air(machine: Printer) -> None:
    if machine.pneumatic is not None:
        raise UsageError(
            f"{machine.name} has a pneumatic head, and these prints vary what a plunger pushes; "
            "weigh its flow instead: printctl calibrate weigh"
        )


def _write(job: _Job) -> None:
    """Check the job as a print is, then write its files."""
    setup, made, ink = job.set_up, job.written.pattern, job.set_up.ink
    middle = np.array([*made.size_mm, 0.0]) / 2
    options = GcodeOptions(
        start_mm=job.at_mm,
        relieve_ul=0.0,
        plunger_ul_s=ink.plunger_ul_s,
        flow_factor=ink.flow_factor,
    )
    place = np.array(job.at_mm) - middle
    gcode = write_gcode(pattern_path(made, ink), setup.printer, job.syringe, place, options)
    run = dry_run(gcode.data, setup.printer, job.at_mm)
    checks = file_checks(run, setup)
    refuse_failed(checks)
    for text in warnings(checks):
        messages().print(f"note: {text}", markup=False)
    base = job.path
    save_gcode(base, base.with_suffix(".map.npz"), [gcode])
    write_text(base.with_suffix(".json"), job.written.as_text())
    if made.name in COLUMNS:
        write_text(base.with_suffix(".csv"), sheet_text(job.written))
    write_text(base.with_suffix(".svg"), sheet_svg(job.written))
    _tell(job, made, gcode.line_count, run.duration_s)


def _tell(job: _Job, made: Pattern, lines: int, seconds: float) -> None:
    start = ",".join(f"{value:g}" for value in job.at_mm)
    x, y = made.size_mm
    if not made.bead.round_bead:
        messages().print(
            f"note: lines {made.bead.layer_mm:g} mm high on a plate: --at's Z must be that much "
            "above it (--bath or --round for filaments in a bath)",
            markup=False,
        )
    ends = _BESIDE if made.name in COLUMNS else (".svg", ".json")
    reads = (
        "the sheet to fill in, and what `printctl calibrate widths` needs to read them or a picture"
        if made.name in COLUMNS
        else "and what `printctl observe frame --printed` needs"
    )
    print_lines(
        f"{job.path}: {lines} lines, {seconds:.0f} s, {x:.1f} x {y:.1f} mm; put the tip to {start} "
        f"and print it with --start {start}",
        f"{', '.join(str(job.path.with_suffix(end)) for end in ends)}: what is where, {reads}",
    )


def _across(said: float | None, dish: str | None, needle: str) -> float:
    """Diameter of the squares' circle, mm."""
    if said is not None:
        return said
    if dish is None:
        return _ACROSS_MM
    inside = load(Dish, dish)
    clear = load(Needle, needle).outer_mm + 2 * _CLEAR_MM
    return min(inside.inner_x_mm, inside.inner_y_mm) - clear
