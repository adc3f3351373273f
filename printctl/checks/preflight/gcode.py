"""Run the checks that need only G-code and printer: travel, speed, plunger, firmware limits."""

from __future__ import annotations

import numpy as np

from firmware_profiles import Printer
from firmware_profiles.families import family_of
from printctl.checks.preflight.firmware import firmware_checks
from printctl.checks.preflight.gate_checks import gate_checks, motor_checks
from printctl.checks.preflight.heads import ABOUT_HEADS, check_each_head
from printctl.checks.preflight.place_checks import place_checks
from printctl.checks.preflight.pneumatic_checks import valve_checks
from printctl.checks.preflight.profile_checks import profile_checks
from printctl.checks.preflight.wait_checks import wait_checks
from printctl.checks.set_up.check import Check
from sim.gcode.dry_run.run import DryRun
from sim.gcode.program.gcode import code
from sim.gcode.reading.line import SORTS, Finding

_COUNTED = {
    "unknown_command": "commands unknown to the firmware",
    "no_command": "lines that are no command",
    "cold_extrusion": "plunger moves that the firmware would drop",
    "homing": "homing with the needle mounted",
    "bad_arc": "arcs without a centre",
}
"""Findings of which none is allowed, and their names."""

_TINY_MM = 1e-6
_PROBES = ("G29", "G30", "G32", "G34")
_NAMED_PROBES = ("BED_MESH_CALIBRATE", "PROBE_ACCURACY", "PROBE_CALIBRATE", "Z_TILT_ADJUST")
_COUNTED_REMEDY = {
    "homing": "take G28 out and touch the needle off instead: homing would drive it into the dish",
}


def gcode_checks(run: DryRun, printer: Printer) -> list[Check]:
    """Every check of a dry run, passed or not."""
    findings = {finding.code: finding for finding in run.findings}
    checks = [
        *_travel(run, printer),
        *_speed(run, findings),
        *_plunger(run, printer, findings),
        *_pulled_back(run),
        _line_length(run, printer, findings),
        _merged(run, printer),
        _starved(run, printer),
        *(_counted(code, name, run.findings) for code, name in _counted_for(printer).items()),
        _probing(run),
        *gate_checks(run, printer),
        *motor_checks(run, printer),
        *wait_checks(run, printer),
        *place_checks(run, printer),
        *firmware_checks(run, printer),
        *valve_checks(run, printer),
        *profile_checks(printer),
    ]
    listed = {*_counted_for(printer), "plunger_travel", "long_line"}
    others = [
        finding
        for code, finding in findings.items()
        if code not in listed and not code.startswith(("outside_", "speed_"))
    ]
    return checks + [_other(finding) for finding in others]


def _counted_for(printer: Printer) -> dict[str, str]:
    return {**_COUNTED, **ABOUT_HEADS} if printer.heads else _COUNTED


def _line(finding: Finding | None) -> str:
    return f"line {finding.line}" if finding and finding.line else ""


def _travel(run: DryRun, printer: Printer) -> list[Check]:
    """Both ends of each axis; a file may leave the work area at either."""
    beyond = {
        (finding.code, finding.limit): finding
        for finding in run.findings
        if finding.code.startswith("outside_")
    }
    checks = []
    spans = (printer.x_mm, printer.y_mm, printer.z_mm)
    for axis, (name, span) in enumerate(zip("xyz", spans, strict=True)):
        remedy = (
            f"the part doesn't fit into {printer.name} ({name}_mm {span.low:g} to {span.high:g}); "
            "move it (place_mm), or take a smaller part or a larger printer"
        )
        for end, value, limit, line in (
            ("lowest", run.low_mm[axis], span.low, run.low_line[axis]),
            ("highest", run.high_mm[axis], span.high, run.high_line[axis]),
        ):
            wrong = beyond.get((f"outside_{name}", limit))
            place = _line(wrong) if wrong else f"line {line}"
            checks.append(
                Check(f"{name}, {end}", float(value), limit, "mm", wrong is None, place, remedy)
            )
    return checks


def _speed(run: DryRun, findings: dict[str, Finding]) -> list[Check]:
    fastest = run.speed_mm_s.max(axis=0, initial=0.0)
    return [
        Check(
            f"speed of {name}",
            float(fastest[axis]),
            float(run.limit_mm_s[axis]),
            "mm/s",
            f"speed_{name}" not in findings,
            _line(findings.get(f"speed_{name}")),
            "lower the speed in the recipe: the firmware would slow the whole move",
        )
        for axis, name in enumerate("xyze")
    ]


def _plunger(run: DryRun, printer: Printer, findings: dict[str, Finding]) -> list[Check]:
    """Each head's; none for a pneumatic one."""
    if printer.heads:
        return check_each_head(run, printer, lambda _, view, one: [_travelled(view, one, findings)])
    return [] if printer.plunger_travel_mm is None else [_travelled(run, printer, findings)]


def _travelled(run: DryRun, printer: Printer, findings: dict[str, Finding]) -> Check:
    limit = printer.plunger_travel_mm or np.inf
    return Check(
        "plunger travel",
        run.plunger_max_mm,
        limit,
        "mm",
        run.plunger_max_mm <= limit + _TINY_MM,
        _line(findings.get("plunger_travel")),
        "use a wider syringe or a smaller part",
    )


def _pulled_back(run: DryRun) -> list[Check]:
    """Whether the plunger goes back behind where it begins: a full syringe has no room there."""
    back = -run.plunger_min_mm
    if back <= _TINY_MM:
        return []
    row = int(run.program.plunger.argmin())
    return [
        Check(
            "plunger behind where it begins",
            back,
            0,
            "mm",
            False,
            f"line {int(run.program.line[row])}",
            "a full syringe would be opened; leave that much room behind its plunger",
            "warns",
        )
    ]


def _line_length(run: DryRun, printer: Printer, findings: dict[str, Finding]) -> Check:
    size, line = run.longest_line
    return Check(
        "longest line as sent",
        size,
        printer.max_line_bytes,
        "bytes",
        "long_line" not in findings,
        f"line {line}",
        "shorten it: the firmware would cut it",
    )


def _merged(run: DryRun, printer: Printer) -> Check:
    """Moves that the planner would drop and add to the next: corners cut where it likes."""
    least = printer.min_steps_per_segment
    line = run.first_short_line
    return Check(
        f"moves below the planner's least of {least} steps",
        run.merged_moves,
        0,
        "",
        run.merged_moves == 0,
        f"line {line}" if line else "",
        f"the firmware adds each to the move after it (min_steps_per_segment {least}): corners a "
        "little cut, no ink lost",
        "warns",
    )


def _starved(run: DryRun, printer: Printer) -> Check:
    """Moves shorter than their lines take to come: the motion slows down and stutters."""
    starved = run.starved
    pairs = family_of(printer).link
    more = ", lines_in_flight: 2" if pairs and pairs.pairs and printer.lines_in_flight == 1 else ""
    return Check(
        "segments starved by the wire",
        starved.segments,
        0,
        "",
        starved.segments == 0,
        f"line {starved.line}" if starved.line else "",
        f"their lines take longer to come than they are to make, so the head slows down and "
        f"stutters there, {starved.seconds:.1f} s in all: write longer segments, or use a higher "
        f"baud rate (now {printer.baud}){more} or an adapter that answers faster "
        f"(host_turnaround_s {printer.host_turnaround_s:g})",
        "warns",
    )


def _probing(run: DryRun) -> Check:
    """Bed probing drives the tool down until something gives, as homing does."""
    rows = np.flatnonzero(np.isin(run.program.code, [code(name) for name in _PROBES]))
    named = [at for at in run.named if at.name in _NAMED_PROBES]
    lines = sorted([*(int(run.program.line[row]) for row in rows), *(at.line for at in named)])
    return Check(
        "probing with the needle mounted",
        len(lines),
        0,
        "",
        not lines,
        f"line {lines[0]}" if lines else "",
        "take it out: it would drive the needle into the dish; probe before the needle and the "
        "dish are mounted, and touch the needle off",
    )


def _counted(code: str, name: str, findings: list[Finding]) -> Check:
    """All findings of one sort, the first one's line and each one's message."""
    those = [finding for finding in findings if finding.code == code]
    remedy = _COUNTED_REMEDY.get(code, "; ".join(finding.message for finding in those))
    first = those[0] if those else None
    count = sum(finding.count for finding in those)
    return Check(name, count, 0, "", not those, _line(first), remedy)


def _other(finding: Finding) -> Check:
    name = {**SORTS, "empty_file": "files without a command"}.get(finding.code, finding.code)
    return Check(name, finding.count, 0, "", False, _line(finding), finding.message)
