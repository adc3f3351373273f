"""Static checks of a G-code program: bounds, speeds, plunger, unknown commands."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from firmware_profiles import Printer, Span
from firmware_profiles.families import family_of, meanings
from firmware_profiles.families.grammar import Meaning
from gcode.errors import LineError
from gcode.heads import first_finding, head_findings
from gcode.program.gcode import NO_COMMAND, Program, code_name
from gcode.program.modal import BAD, HOME, MOVE
from gcode.reading.file import GcodeFile, kinds_of, named_lines
from gcode.reading.line import UNKNOWN_REMEDY, Finding, Lines, is_known, is_known_name
from kernels.arrays import FloatArray

_TINY_MM: Final = 1e-6
_MOST_NAMES: Final = 20
"""Unknown codes that get a finding of their own."""
_AXES: Final = ("x", "y", "z")


def check(
    program: Program,
    printer: Printer,
    extrudes: NDArray[np.bool_],
    file: GcodeFile,
    others: Sequence[Finding],
) -> dict[str, Any]:
    """All fields of `DryRun` that need no planner; findings include ``others``."""
    named, refused = named_lines(file.others), file.refused
    moves = program.kind == MOVE
    speed = demanded_speed(program)
    axes = printer.max_speed_mm_s
    limit = np.array([axes.x, axes.y, axes.z, axes.e])
    plungers = np.array([printer.of_head(k).max_speed_mm_s.e for k in range(printer.head_count)])
    limit[3] = plungers.max()
    tip = np.vstack([program.start[None, :3], program.target[:, :3]])
    lines = np.concatenate([[0], program.line])
    low_at, high_at = tip.argmin(axis=0), tip.argmax(axis=0)
    plunger = np.concatenate([[0.0], program.plunger])
    size = sent_length(program)
    longest = int(size.argmax()) if len(program) else -1
    unknown = _unknown(program, printer, named)
    findings = [
        *_empty(program, refused),
        *_unreadable(refused),
        *_outside(program, printer, moves),
        *_too_fast(program, speed, limit, plungers, printer.name),
        *_too_slow(program, printer),
        *_plunger(program, printer),
        *_cold(program, moves & ~extrudes, family_of(printer).cold_remedy),
        *_strange(program, unknown, printer),
        *_offset(named),
        *head_findings(program, file.others, printer),
        *_too_long(program, size, printer),
        *others,
    ]
    return {
        "speed_mm_s": speed,
        "limit_mm_s": limit,
        "low_mm": tip.min(axis=0),
        "high_mm": tip.max(axis=0),
        "low_line": lines[low_at],
        "high_line": lines[high_at],
        "plunger_max_mm": float(plunger.max()),
        "plunger_min_mm": float(plunger.min()),
        "unknown": unknown,
        "first_short_line": _first_short(program, printer),
        "longest_line": (int(size[longest]), int(program.line[longest])) if len(size) else (0, 0),
        "findings": sorted(findings, key=lambda finding: finding.line),
    }


def _empty(program: Program, refused: tuple[tuple[int, LineError], ...]) -> list[Finding]:
    if len(program) or refused:
        return []
    text = "the file contains no commands: export it again"
    return [Finding(0, "empty_file", text)]


def _unreadable(refused: tuple[tuple[int, LineError], ...]) -> list[Finding]:
    findings = []
    for line, error, count in kinds_of(refused):
        more = f" ({count} such lines)" if count > 1 else ""
        findings.append(Finding(line, error.sort, f"line {line}: {error}{more}", count=count))
    return findings


def sent_length(program: Program) -> NDArray[np.int64]:
    """Bytes of each row as sent: ``N12 `` before it, ``*123`` and the line end after; (n,)."""
    digits = np.floor(np.log10(program.command + 1)).astype(np.int64) + 1
    return np.where(program.length > 0, program.length + digits + 7, 0)


def _deltas(program: Program) -> tuple[FloatArray, FloatArray, NDArray[np.bool_]]:
    """Way of each row on each axis; its length, in space or else of the plunger; if it moves."""
    before = program.before
    delta = np.abs(program.target - before)
    path = np.sqrt(np.square(delta[:, :3]).sum(axis=1))
    length = np.where(path > 0, path, delta[:, 3])
    return delta, length, (program.kind == MOVE) & (length > 0)


def demanded_speed(program: Program) -> FloatArray:
    """Speed that each row asks of x, y, z and e, (n, 4), mm/s; 0 where it isn't a move.

    The feed is that of the path in space, or of the plunger where only it moves.
    """
    delta, length, moving = _deltas(program)
    per_mm = np.zeros(len(program))
    np.divide(program.feed, length, out=per_mm, where=moving)
    return delta * per_mm[:, None]


def _first_short(program: Program, printer: Printer) -> int:
    """Line of the first move of fewer steps than the planner's least; 0 for none."""
    steps = _steps(program, printer)
    before = program.before
    way = np.abs(np.rint(program.target * steps) - np.rint(before * steps)).max(axis=1, initial=0.0)
    short = (program.kind == MOVE) & (way > 0) & (way < printer.min_steps_per_segment)
    return int(program.line[int(short.argmax())]) if short.any() else 0


def _steps(program: Program, printer: Printer) -> FloatArray:
    """Motor steps per mm of x, y, z and the plunger that each row would move, (n, 4)."""
    axes = printer.steps_per_mm
    steps = np.tile([axes.x, axes.y, axes.z, axes.e], (len(program), 1))
    heads = [printer.of_head(k).steps_per_mm.e for k in range(printer.head_count)]
    steps[:, 3] = np.array(heads)[program.tool]
    return steps


def _outside(program: Program, printer: Printer, moves: NDArray[np.bool_]) -> list[Finding]:
    findings = []
    spans: tuple[Span, ...] = (printer.x_mm, printer.y_mm, printer.z_mm)
    for axis, (name, span) in enumerate(zip(_AXES, spans, strict=True)):
        at = program.target[:, axis]
        for beyond, limit, sign in ((span.low - at, span.low, -1), (at - span.high, span.high, 1)):
            where = moves & (beyond > _TINY_MM)
            worst = limit + sign * float(beyond[where].max(initial=0.0))
            findings += first_finding(
                program,
                where,
                f"outside_{name}",
                f": {name} reaches {worst:.3f} mm, outside {span.low:g} to {span.high:g} mm "
                f"({printer.name}: {name}_mm), in {where.sum()} moves; move the part (place_mm) or "
                "check the start position",
                worst,
                limit,
            )
    return findings


def _too_fast(
    program: Program, speed: FloatArray, limit: FloatArray, plungers: FloatArray, printer: str
) -> list[Finding]:
    """``plungers`` has the limit of each head's."""
    findings = []
    for axis, name in enumerate((*_AXES, "e")):
        most = plungers[program.tool] if name == "e" else limit[axis]
        where = speed[:, axis] > most * (1 + 1e-6)
        worst = float(speed[where, axis].max(initial=0.0))
        findings += first_finding(
            program,
            where,
            f"speed_{name}",
            f": {name} needs {worst:.3f} mm/s, above {limit[axis]:g} mm/s ({printer}: "
            f"max_speed_mm_s.{name}), in {where.sum()} moves; the firmware would slow the whole "
            "move down: lower the feed",
            worst,
            float(limit[axis]),
        )
    return findings


def _too_slow(program: Program, printer: Printer) -> list[Finding]:
    delta, length, moving = _deltas(program)
    events = (delta * _steps(program, printer)).max(axis=1, initial=0.0)
    moving &= events >= printer.min_steps_per_segment
    family = family_of(printer)
    if family.has_min_speed:
        rate, unit = np.where(moving, program.feed, np.inf), "mm/s"
        least = printer.min_speed_mm_s
        whose, remedy = (
            "minimum of its firmware",
            "set M203 I in its config.g, and min_speed_mm_s",
        )
    else:
        rate, unit = np.full(len(program), np.inf), "steps/s"
        np.divide(events * program.feed, length, out=rate, where=moving)
        least = family.least_steps_s if printer.max_step_rate_hz is None else 0.0
        whose, remedy = "minimum of an 8-bit board's timer", "use more steps per mm"
    where, worst = rate < least * (1 - 1e-6), float(rate.min(initial=np.inf))
    faster = "more pressure or a wider needle" if printer.pneumatic else "raise the feed"
    return first_finding(
        program,
        where,
        "too_slow",
        f": {worst:.3g} {unit} requested, below {least:g}, the {whose}, in {where.sum()} moves; "
        f"they run up to {least / max(worst, 1e-9):.1f} times faster than specified: {faster}, or "
        f"{remedy}",
        worst,
        least,
    )


def _plunger(program: Program, printer: Printer) -> list[Finding]:
    """The travel of each head's plunger; the first that goes too far."""
    heads = [printer.of_head(number) for number in range(printer.head_count)]
    limits = np.array([head.plunger_travel_mm or np.inf for head in heads])
    where = program.plunger - limits[program.tool] > _TINY_MM
    if printer.pneumatic or not where.any():
        return []
    head = int(program.tool[int(where.argmax())])
    worst, limit = float(program.plunger[program.tool == head].max()), float(limits[head])
    return first_finding(
        program,
        where,
        "plunger_travel",
        f": the plunger reaches {worst:.3f} mm, above {limit:g} mm ({heads[head].name}: "
        "plunger_travel_mm); use a larger syringe or split the print",
        worst,
        limit,
    )


def _cold(program: Program, moves: NDArray[np.bool_], remedy: str) -> list[Finding]:
    where = moves & (program.target[:, 3] != program.before[:, 3])
    return first_finding(
        program,
        where,
        "cold_extrusion",
        f": the plunger would move while cold extrusion isn't allowed, in {where.sum()} moves; the "
        f"firmware ignores or rejects such moves: {remedy}",
    )


def _unknown(program: Program, printer: Printer, named: Lines) -> tuple[tuple[int, str], ...]:
    strange = [
        number
        for number in np.unique(program.code).tolist()
        if number == NO_COMMAND or not is_known(printer, code_name(number))
    ]
    where = np.flatnonzero(np.isin(program.code, strange))
    coded = [(int(program.line[i]), code_name(int(program.code[i]))) for i in where]
    strangers = [(at, line.code) for at, line in named if not is_known_name(printer, line.code)]
    return tuple(sorted(coded + strangers))


def _strange(
    program: Program, unknown: tuple[tuple[int, str], ...], printer: Printer
) -> list[Finding]:
    findings: list[Finding] = []
    lines_of: dict[str, list[int]] = {}
    for line, name in unknown:
        lines_of.setdefault(name, []).append(line)
    for name, lines in sorted(lines_of.items())[:_MOST_NAMES]:
        sort, what, remedy = "no_command", "isn't a command", "remove it"
        if name != code_name(NO_COMMAND):
            sort, what = "unknown_command", f"{name} is unknown to {printer.firmware}"
            remedy = UNKNOWN_REMEDY
        findings.append(
            Finding(
                lines[0],
                sort,
                f"line {lines[0]}: {what} ({len(lines)} such lines); {remedy}",
                count=len(lines),
            )
        )
    return [
        *findings,
        *first_finding(
            program,
            program.kind == BAD,
            "bad_arc",
            ": the arc has no centre (I, J or R), ends more than 0.1 mm off its circle or at its "
            "start, or is longer than 10 m; firmwares handle that differently: use straight moves",
        ),
        *first_finding(
            program,
            program.kind == HOME,
            "homing",
            ": homing with needle and dish mounted drives the needle through them; remove G28 and "
            "touch off instead",
        ),
    ]


def _offset(named: Lines) -> list[Finding]:
    """Offsets by a command with a name: they shift what comes after, unknown to this dry run."""
    offsets = [(at, line) for at, line in named if meanings().get(line.code) is Meaning.SHIFTS]
    # Taking offsets back to 0 shifts nothing.
    lines = [at for at, line in offsets if set(line.parameters.values()) - {"0", "0.0"}]
    if not lines:
        return []
    text = (
        f"line {lines[0]}: {offsets[0][1].code} shifts all following coordinates, which the checks "
        "don't follow; use absolute coordinates"
    )
    return [Finding(lines[0], "offset", text, count=len(lines))]


def _too_long(program: Program, size: NDArray[np.int64], printer: Printer) -> list[Finding]:
    # The firmware keeps one byte for the terminator.
    limit, worst = printer.max_line_bytes - 1, int(size.max(initial=0)) - 1
    return first_finding(
        program,
        size - 1 > limit,
        "long_line",
        f": {worst} bytes with line number and checksum, above {limit} ({printer.name}: "
        "max_line_bytes); the firmware truncates it: split the line",
        worst,
        limit,
    )
