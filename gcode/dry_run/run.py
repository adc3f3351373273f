"""Simulate a G-code file without a printer: duration, tip path, limits exceeded.

The planner is that of the simulated printer, fed as the link feeds a real one
(`gcode.dry_run.feed`): wire both ways, the board's time for a line, the host's turnaround,
lines in flight. Where moves are shorter than their lines take to come, the planner runs low and
slows down here as it would there, and the time lost is reported (`DryRun.starved`). Waits for heat
count as nothing; a wait for the user likewise.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, replace
from typing import Any, Final, Literal

import numpy as np
from numpy.typing import NDArray

from firmware_profiles import Printer
from firmware_profiles.families import family_of, meanings
from firmware_profiles.families.grammar import Meaning
from gcode.dry_run.checks import check
from gcode.dry_run.completeness import completeness_findings
from gcode.dry_run.feed import StarvedMotion, line_times, run_program, starvation
from gcode.heads import Heads, read_heads
from gcode.motion.executed import ExecutedMotion, executed_motion
from gcode.program.gcode import Program, code
from gcode.program.modal import MOVE
from gcode.program.read_program import read_written
from gcode.program.valve import Valve, read_valves
from gcode.reading.file import named_lines
from gcode.reading.line import Finding, GcodeLine, Lines
from kernels.arrays import FloatArray

# Beside M104, M109 (tool) and M140, M190 (bed) there are ways round them: M303, which heats while
# it tunes; RepRapFirmware's G10 and M568 for a tool, and M141, M191 for a chamber, which warms ink
# and bath alike; commands with names (`Meaning.HEATS`), and those that wait for a temperature
# (`Meaning.AWAITS`): for ever, where what is mounted doesn't bear it.
Part = Literal["ink", "bath", "both"]
Bound = Literal["is", "least", "most"]
_KEYS: Final[dict[Meaning, dict[str, Bound]]] = {
    Meaning.HEATS: {"TARGET": "is"},
    Meaning.AWAITS: {"MINIMUM": "least", "MAXIMUM": "most"},
}
_TOOL, _BED, _CHAMBER = ("M104", "M109", "G10", "M568"), ("M140", "M190"), ("M141", "M191")
_CODES: Final = frozenset({*_TOOL, *_BED, *_CHAMBER, "M303"})


@dataclass(frozen=True)
class Heating:
    """Temperature set by one line.

    Attributes
    ----------
    line : int
        Of the file, from 1.
    part : "ink", "bath" or "both"
        What it warms or cools; a Klipper heater of one's own naming counts as both.
    celsius : float, °C
        0 switches off.
    bound : "is", "least" or "most"
        Whether it is set, or waited for from below or from above.
    """

    line: int
    part: Part
    celsius: float
    bound: Bound = "is"


def heatings(others: Lines) -> tuple[Heating, ...]:
    """All settings of a file, in its order."""
    return tuple(
        Heating(number, *fields)
        for number, line in others
        for fields in (_named(line) if line.is_named else _settings_in(line))
    )


def _settings_in(line: GcodeLine) -> list[tuple[Part, float, Bound]]:
    """What a line sets, if it does: a G10 without S or R, say, is an offset."""
    values = line.values
    if line.code not in _CODES or (line.code == "G10" and "L" in values):
        return []
    part: Part = "ink" if line.code in _TOOL else "bath" if line.code in _BED else "both"
    if line.code == "M303":
        part = "bath" if values.get("E", 0.0) < 0 else "ink"
    return [(part, values[word], "is") for word in "SR" if word in values]


def _named(line: GcodeLine) -> list[tuple[Part, float, Bound]]:
    words = line.parameters
    heater = words.get("HEATER") or words.get("SENSOR", "")
    part: Part = "both"
    if heater.startswith("extruder"):
        part = "ink"
    elif heater == "heater_bed":
        part = "bath"
    keys = _KEYS.get(meanings().get(line.code, Meaning.OTHER), {})
    if "TARGET" in keys:
        targets = [(words.get("TARGET", "0"), keys["TARGET"])]
    else:
        targets = [(words[key], bound) for key, bound in keys.items() if key in words]
    return [(part, number, bound) for text, bound in targets for number in _read(text)]


def _read(text: str) -> list[float]:
    """The number, or none where it isn't one: the gate refuses the line."""
    try:
        return [float(text)]
    except ValueError:
        return []


@dataclass(frozen=True)
class DryRun:
    """Result of simulating a G-code file.

    Attributes
    ----------
    program : Program
        The commands, a row each (arcs a row per segment).
    executed : ExecutedMotion
        Blocks as the stepper would run them; `line` counts commands from 0.
    duration_s : float
        From the first step pulse (or dwell) to the last.
    speed_mm_s : (n, 4) float64, mm/s
        What each row of the program demands of x, y, z and the plunger; 0 where nothing moves.
    limit_mm_s : (4,) float64, mm/s
        What each axis can do; the firmware slows a move down to it.
    low_mm, high_mm : (3,) float64, mm
        Bounds of the tip, start included.
    low_line, high_line : (3,) int64
        Line of the file where each bound is first reached; 0 for the start.
    plunger_max_mm, plunger_min_mm : float, mm
        Farthest plunger positions, from the start's.
    merged_moves : int
        Moves below the firmware's least steps, taken over by their successors.
    starved : StarvedMotion
        What the wire is too slow for.
    valves : tuple of Valve
        Of each pneumatic head, as the file switches it; none for plungers.
    heads : Heads
        Where each needle is, raised or not.
    heats : tuple of Heating
        Every temperature that the file sets.
    first_short_line : int
        Line of the first move below the firmware's least steps; 0 for none.
    unknown : tuple of (int, str)
        Line and name of each command that the firmware doesn't know.
    longest_line : (int, int)
        Bytes as sent (with line number and checksum), and the line.
    others : tuple of (int, GcodeLine)
        Lines that aren't plain moves.
    findings : list of Finding
        What is wrong, each sort once with its first line; the caller decides what it refuses.
    opening : bytes
        Comment lines before the first command.
    """

    program: Program
    executed: ExecutedMotion
    duration_s: float
    speed_mm_s: FloatArray
    limit_mm_s: FloatArray
    low_mm: FloatArray
    high_mm: FloatArray
    low_line: NDArray[np.int64]
    high_line: NDArray[np.int64]
    plunger_max_mm: float
    plunger_min_mm: float
    merged_moves: int
    starved: StarvedMotion
    valves: tuple[Valve, ...]
    heads: Heads
    heats: tuple[Heating, ...]
    first_short_line: int
    unknown: tuple[tuple[int, str], ...]
    longest_line: tuple[int, int]
    others: Lines
    findings: list[Finding]
    opening: bytes

    @property
    def valve(self) -> Valve | None:
        """The valve of one pneumatic head (`of_head`); None for a plunger, or several heads."""
        return self.valves[0] if len(self.valves) == 1 else None

    @property
    def named(self) -> Lines:
        """Commands with names, which the program holds as M105, T or G92."""
        return named_lines(self.others)

    @property
    def doses(self) -> NDArray[np.bool_]:
        """Rows in which ink is pushed, (n,): the plunger goes in, or a valve stands open."""
        if self.valves:
            return Valve.joined(self.valves).is_open
        pushed: NDArray[np.bool_] = self.program.pushed > 0
        return pushed

    def of_head(self, number: int) -> DryRun:
        """The run as one head alone sees it: its rows, its plunger, its own tip's places.

        Time, findings and what was executed are the whole run's.
        """
        rows = self.program.tool == number
        tips = self.heads.tips(self.program, number)[rows]
        program = self.program.of_head(number)
        target = program.target.copy()
        target[:, :3] = tips[:, 1]
        start = self.program.start.copy()
        start[:3] += self.heads.offset_mm[number]
        program = replace(program, target=target, start=start)
        moving = np.where(program.kind[:, None, None] == MOVE, tips, np.nan)
        plunger = np.concatenate([[0.0], program.plunger])
        return replace(
            self,
            program=program,
            speed_mm_s=self.speed_mm_s[rows],
            valves=tuple(self.valves[k].of_rows(rows) for k in (number,) if self.valves),
            plunger_max_mm=float(plunger.max()),
            plunger_min_mm=float(plunger.min()),
            **_bounds(moving, program.line),
        )


def _bounds(tips: FloatArray, line: NDArray[np.int64]) -> dict[str, Any]:
    """Lowest and highest place of a tip while it moves, and the lines; NaN where it never does."""
    if np.isnan(tips).all():
        tips, line = np.full((1, 2, 3), np.nan), np.zeros(1, np.int64)
        low_at = high_at = np.zeros(3, np.int64)
        lows = highs = tips[:, 0]
    else:
        lows, highs = np.fmin(tips[:, 0], tips[:, 1]), np.fmax(tips[:, 0], tips[:, 1])
        low_at, high_at = np.nanargmin(lows, axis=0), np.nanargmax(highs, axis=0)
    axes = np.arange(3)
    return {
        "low_mm": lows[low_at, axes],
        "low_line": line[low_at],
        "high_mm": highs[high_at, axes],
        "high_line": line[high_at],
    }


def dry_run(
    gcode: bytes,
    printer: Printer,
    start_mm: tuple[float, float, float] = (0.0, 0.0, 0.0),
    *,
    cold_extrusion: bool = False,
) -> DryRun:
    """Run a file without a printer.

    Parameters
    ----------
    start_mm : tuple, mm
        Where the tip stands before the first line, in the printer's frame.
    cold_extrusion : bool
        Whether M302 was sent before the file; without it (in the file or before) the firmware
        drops all plunger motion while the hotend is cold.

    Raises
    ------
    GcodeError
        When the bytes aren't text.
    """
    whole = gcode
    program, gcode, file, axis_mm = read_written(whole, printer, start_mm)
    extrudes = extrusion_allowed(program, file.others, printer, cold_extrusion)
    times = line_times(program, gcode, printer)
    fed = run_program(program, printer, start_mm, extrudes, times)
    valves = read_valves(program, file.others, printer)
    doses = Valve.joined(valves).is_open if valves else program.pushed > 0
    incomplete = completeness_findings(
        program, doses, gcode, whole,
        pneumatic=bool(valves), lift_mm_s=printer.max_speed_mm_s.z,
    )  # fmt: skip
    checked = check(program, printer, extrudes, file, incomplete)
    return DryRun(
        program=program,
        executed=executed_motion(fed.log, printer),
        duration_s=fed.duration_s,
        merged_moves=fed.merged,
        starved=starvation(program, printer, start_mm, extrudes, times, fed),
        valves=valves,
        heads=read_heads(program, file.others, printer, axis_mm),
        heats=heatings(file.others),
        others=file.others,
        opening=_opening(whole, program),
        **checked,
    )


def _opening(gcode: bytes, program: Program) -> bytes:
    """Lines before the first command; none where there is no command."""
    count = int(program.line[0]) - 1 if len(program) else 0
    return b"\n".join(re.split(rb"\r\n|\n|\r", gcode, maxsplit=count)[:count])


_HOTEND_MELTS_C: Final = 170.0  # Marlin's EXTRUDE_MINTEMP


def extrusion_allowed(
    program: Program, others: Lines, printer: Printer, already: bool
) -> NDArray[np.bool_]:
    """Whether the firmware lets the plunger move at each row, (n,).

    Parameters
    ----------
    already : bool
        Whether a command has allowed it before the file.
    """
    change = np.zeros(len(program), dtype=np.int8)  # 1 allows, -1 forbids
    value = np.nan_to_num(program.value, nan=-1.0)
    heats = np.isin(program.code, [code("M104"), code("M109")]) & (value >= _HOTEND_MELTS_C)
    change[heats] = 1
    family = family_of(printer)
    for number, line in others:
        if line.code == "M302" and not line.is_named:
            change[program.line == number] = family.reads_m302(line.values)
    free = already or printer.cold_extrusion_configured or not family.cold_remedy
    before = np.append(1 if free else -1, change)
    latest = np.maximum.accumulate(np.where(before != 0, np.arange(len(before)), 0))
    return np.asarray(before[latest][1:] > 0)
