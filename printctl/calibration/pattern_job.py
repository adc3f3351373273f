"""Make and write a calibration print: its pattern, G-code, drawing and sheet."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np

from design.files import write_text
from design.toolpath.gcode import GcodeOptions, save_gcode, write_gcode
from firmware_profiles import Dish, Ink, Needle, Printer, load
from gcode.dry_run.run import dry_run
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
from printctl.checks.made_for import header_lines, made_for
from printctl.checks.preflight import SetUp, file_checks, refuse_failed, warnings
from printctl.checks.set_up import ProfileNames, set_up
from printctl.errors import UsageError
from printctl.settings import numbers_of, opt, settings

BESIDE: Final = (".svg", ".csv", ".json")
"""Files beside the G-code; a sheet (.csv) where there are widths to type."""
_ACROSS_MM: Final = 50.0
_CLEAR_MM: Final = 1.5
"""Between needle and dish."""


@settings
class PatternOptions:
    """What single patterns take; lists are numbers with commas between."""

    speeds: str = opt("Speeds of the pattern `lines`, mm/s.", "2,5,8")
    flow_factors: str = opt("Extrusion multipliers of the pattern `lines`.", "0.8,1,1.2")
    length: float = opt("Length of a line, mm.", 24.0, min=1)
    repeats: int = opt("Number of repeats of each line.", 1, min=1)
    steps: int = opt("Lines written slow, fast, slow, for the lag.", 2, min=0)
    speed: float = opt("Speed of the other patterns, mm/s.", 5.0, min=0.01)
    turns: float = opt("Number of turns of the spiral.", 5.0, min=1, max=50)
    pitch: float | None = opt("Pitch of the spiral, mm; default: 5 bead widths.")
    gaps: str | None = opt("Gaps of the comb, mm; default: 0.2 to 2 bead widths.")
    overlaps: str = opt(
        "Overlaps of joints, radii beyond the trunk's surface.", "-1.5,-1,-0.5,0,0.5,1"
    )
    spans: str = opt("Spans of the bridges, mm.", "1,2,3,4,6")
    height: float = opt("Height of the bridges' pillars, mm.", 2.0, min=0.1)
    across: float | None = opt(
        "Diameter of the circle of squares, mm; default: --dish minus needle and 3 mm, or 50."
    )


def pattern_of(
    name: str, bead: Bead, own: PatternOptions, dish: str | None, needle: str
) -> Pattern:
    """Return the pattern of a name; squares keep clear of the dish."""
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
        return squares_pattern(bead, _across(own.across, dish, needle), own.speed)
    return comb_pattern(bead, _gaps(own.gaps, bead.width_mm), own.speed)


def _asked(own: PatternOptions) -> LineSeries:
    return LineSeries(
        numbers_of(own.speeds, "--speeds"),
        numbers_of(own.flow_factors, "--flow-factors"),
        own.length,
        own.repeats,
        own.steps,
    )


def _gaps(text: str | None, width: float) -> list[float]:
    if text is not None:
        return numbers_of(text, "--gaps")
    return [round(width * part, 3) for part in (0.2, 0.35, 0.5, 0.75, 1.0, 1.5, 2.0)]


def _across(stated: float | None, dish: str | None, needle: str) -> float:
    """Diameter of the squares' circle, mm."""
    if stated is not None:
        return stated
    if dish is None:
        return _ACROSS_MM
    inside = load(Dish, dish)
    clear = load(Needle, needle).outer_mm + 2 * _CLEAR_MM
    return min(inside.inner_x_mm, inside.inner_y_mm) - clear


@dataclass(frozen=True)
class PatternJob:
    """A pattern that is to be written with its G-code at ``path``, and what it is printed with."""

    path: Path
    written: WrittenPattern
    set_up: SetUp
    at_mm: tuple[float, float, float]

    @property
    def beside(self) -> list[Path]:
        """Files that are written beside the G-code, but for its map."""
        ends = BESIDE if self.written.pattern.name in COLUMNS else (".svg", ".json")
        return [self.path.with_suffix(end) for end in ends]


@dataclass(frozen=True)
class LineShape:
    """A line's width and height, mm, and whether it is a filament; None for what follows.

    The width follows from the needle's bore, the height from the width; with a bath it is a
    filament, else a line on a plate.
    """

    width_mm: float | None = None
    layer_mm: float | None = None
    round_bead: bool | None = None

    def bead(self, needle: Needle, ink: Ink, in_bath: bool) -> Bead:
        """Raise `UsageError` for a line that can't be."""
        wide = needle.inner_mm if self.width_mm is None else self.width_mm
        high = wide / 2 if self.layer_mm is None else self.layer_mm
        if not 0.02 <= wide <= 5 or not 0.01 <= high <= 5:
            raise UsageError(
                f"a line {wide:g} mm wide in layers of {high:g} mm: give 0.02 to 5 mm (--width) "
                "and 0.01 to 5 mm (--layer)"
            )
        return Bead(wide, high, in_bath if self.round_bead is None else self.round_bead, ink.bead)


class PatternMachine(NamedTuple):
    """Names of the profiles that a pattern is printed with."""

    printer: str
    syringe: str
    ink: str
    needle: str


def pattern_job(
    path: Path,
    name: str,
    own: PatternOptions,
    shape: LineShape,
    machine: PatternMachine,
    placed: ProfileNames,
    at_mm: tuple[float, float, float],
) -> PatternJob:
    """Make the job of a pattern; nothing is written.

    Raises
    ------
    UsageError
        For a pneumatic head, a line that can't be, a name that a file beside the G-code gets.
    ProfileError
    """
    if path.suffix.lower() in BESIDE:
        raise UsageError(
            f"-o {path}: that is to be the G-code, and {', '.join(BESIDE)} are written beside "
            "it; end it in .gcode"
        )
    printer, ink = load(Printer, machine.printer), load(Ink, machine.ink)
    bead = shape.bead(load(Needle, machine.needle), ink, placed.bath is not None)
    if printer.pneumatic is not None:
        raise UsageError(
            f"{printer.name} has a pneumatic head, and these prints vary what a plunger pushes; "
            "weigh its flow instead: printctl calibrate weigh"
        )
    mounted = set_up(printer, machine.syringe, machine.ink, at_mm, placed)
    recorded = header_lines(made_for(printer, [mounted.load_of(0)]))
    used = PatternSetUp(*machine, ink.flow_factor, ink.swell_factor, recorded)
    made = pattern_of(name, bead, own, placed.dish, machine.needle)
    return PatternJob(path, WrittenPattern(made, used, at_mm), mounted, at_mm)


def write_pattern_job(job: PatternJob) -> tuple[int, float, tuple[str, ...]]:
    """Check the job as a print is and write its files; return lines, seconds, and notes.

    Raises
    ------
    SafetyError
        When a check refuses it.
    """
    setup, made, ink = job.set_up, job.written.pattern, job.set_up.ink
    middle = np.array([*made.size_mm, 0.0]) / 2
    options = GcodeOptions(
        start_mm=job.at_mm,
        relieve_ul=0.0,
        plunger_ul_s=ink.plunger_ul_s,
        flow_factor=ink.flow_factor,
        header=header_lines(made_for(setup.printer, [setup.load_of(0)], setup.bath)),
    )
    place = np.array(job.at_mm) - middle
    gcode = write_gcode(pattern_path(made, ink), setup.printer, setup.syringe, place, options)
    run = dry_run(gcode.data, setup.printer, job.at_mm)
    checks = file_checks(run, setup)
    refuse_failed(checks)
    base = job.path
    save_gcode(base, base.with_suffix(".map.npz"), [gcode])
    write_text(base.with_suffix(".json"), job.written.as_text())
    if made.name in COLUMNS:
        write_text(base.with_suffix(".csv"), sheet_text(job.written))
    write_text(base.with_suffix(".svg"), sheet_svg(job.written))
    return gcode.line_count, run.duration_s, tuple(warnings(checks))
