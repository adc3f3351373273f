"""Checks that need only G-code and printer: travel, speed, limits, waits, origin."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import Final

import numpy as np

from firmware_profiles import Printer
from firmware_profiles.families import family_of, meanings
from firmware_profiles.families.grammar import Meaning
from gcode.dry_run.run import DryRun
from gcode.program.gcode import code
from gcode.program.modal import MOVE
from gcode.reading import GcodeLine
from gcode.reading.line import OUTPUTS, SORTS, Finding, is_known_line, output_of
from printctl.checks.gate import refused_lines
from printctl.checks.kinds import Kind
from printctl.checks.preflight.firmware import firmware_checks
from printctl.checks.preflight.heads import ABOUT_HEADS, check_each_head
from printctl.checks.preflight.mounted import profile_checks
from printctl.checks.preflight.pneumatic_checks import pressure_checks, valve_checks
from printctl.checks.set_up import RECIPE_KEYS, Check, none_of

# A later place with other numbers renames all places: the firmware's own limits, and what a person
# reads from its display, are then off by as much. E is free: it counts a plunger.
_SAME_MM: Final = 1e-3
_AXES: Final = "XYZ"


def place_checks(run: DryRun, printer: Printer) -> list[Check]:
    """A row for the first place that the job tells anew with other numbers."""
    for number, axis, stated, stands in _told_anew(run):
        return [
            Check(
                Kind.PLACE_REDEFINED,
                f"{axis} redefined after the first move",
                stated,
                stands,
                "mm",
                False,
                f"line {number}",
                f"{axis} is at {stands:g} mm there, counted from the start on {printer.name}; set "
                "X, Y and Z once, before the first move, and remove this line (resetting E is "
                "fine)",
            )
        ]
    return []


def _told_anew(run: DryRun) -> Iterator[tuple[int, str, float, float]]:
    """Yield line, axis, what is told, and where it stands by the job's own count."""
    program = run.program
    moves = program.line[program.kind == MOVE]
    first = int(moves.min()) if moves.size else 0
    shift, by_g92 = dict[str, float](), set[str]()
    for number, line in run.others:
        stated = _places(line)
        row = int(np.searchsorted(program.line, number)) if stated else 0
        for axis, value in stated.items():
            at = _stood(run, row)[_AXES.index(axis)]
            by_name = line.code != "G92"
            stands = at + shift.setdefault(axis, value - at if number < first or not first else 0.0)
            if by_name and axis in by_g92 and abs(shift[axis]) > _SAME_MM:
                stands = at  # G92's shift comes on top of what the command tells
            by_g92 |= set() if by_name else {axis}
            if abs(value - stands) > _SAME_MM:
                yield number, axis, value, stands


def _stood(run: DryRun, row: int) -> list[float]:
    """Where the tip stands before a row, mm, by the count of the start."""
    before = run.program.target[row - 1] if row > 0 else run.program.start
    return [float(mm) for mm in before[:3]]


def _places(line: GcodeLine) -> dict[str, float]:
    """Axes that a line says the tip stands at, mm."""
    if line.code == "G92":
        return {axis: mm for axis in _AXES if (mm := line.number(axis)) is not None}
    if meanings().get(line.code) is not Meaning.PLACES:
        return {}
    return {axis: float(line.parameters[axis]) for axis in _AXES if axis in line.parameters}


_OUTPUTS: Final = "outputs set other than the dispenser valve"


def motor_checks(run: DryRun, printer: Printer) -> list[Check]:
    """A row where motors lose their power before the last move: their place is lost with it.

    Klipper refuses the next move, and the needle stays where it is; others go on from wherever
    the axes came to rest.
    """
    if not printer.streamed:
        return []
    lines = run.program.line[run.program.kind == MOVE]
    off = (number for number, line in run.others if line.code in ("M18", "M84"))
    first = min(off, default=0)
    if not first or not lines.size or first > lines.max():
        return []
    return [
        none_of(
            Kind.MOTORS_OFF,
            "motors without power before the last move",
            1,
            f"line {first}",
            "move M84 or M18 to the end of the file: an axis without power loses its position",
        )
    ]


def _output_checks(run: DryRun, printer: Printer) -> list[Check]:
    """A row for the first output that is set and isn't the profile's valve.

    What hangs on another output of a controller (a lamp, a heater, a brake, another valve) no
    profile tells.
    """
    own = [output_of(text) for head in printer.airs for text in (head.opens, head.closes)]
    others = [
        (number, line)
        for number, line in run.named
        if line.code in OUTPUTS and (line.code, line.parameters) not in own
    ]
    if not others:
        return [Check(Kind.OUTPUTS, _OUTPUTS, 0, 0, "", True)]
    dispenser = ", ".join(f"{head.opens}, {head.closes}" for head in printer.airs) or "none"
    return [
        none_of(
            Kind.OUTPUTS,
            _OUTPUTS,
            len(others),
            f"line {others[0][0]}",
            f"{_setting(others[0][1].parameters)}, but only the profile's valve may be switched "
            f"(dispenser: {dispenser}); remove the line, or specify the valve in a copy of the "
            "profile",
        )
    ]


def _setting(words: Mapping[str, str]) -> str:
    if "AXIS" in words and "NUMBER" not in words:
        return f"the brake of {words['AXIS']} is set to {words['VALUE']}"
    if "NUMBER" not in words:
        return f"{words.get('TEXT', '')!r} can't be read"
    return f"output {words['NUMBER']} of {words['AXIS']} is set to {words['VALUE']}"


def gate_checks(run: DryRun, printer: Printer) -> list[Check]:
    """Rows for the codes that may not be sent; one that passed where all may be.

    What the firmware doesn't know at all has a row of its own (unknown commands).
    """
    if not printer.streamed:
        return _output_checks(run, printer)
    known = [(number, line) for number, line in run.others if is_known_line(printer, line)]
    by_code: dict[str, list[tuple[int, str]]] = {}
    for number, refused, why in refused_lines(known, printer):
        by_code.setdefault(refused, []).append((number, why))
    if not by_code:
        return [Check(Kind.FORBIDDEN_COMMAND, "commands not allowed", 0, 0, "", True)]
    return [
        none_of(
            Kind.FORBIDDEN_COMMAND,
            f"{code} is not allowed in a job",
            len(those),
            f"line {those[0][0]}",
            those[0][1],
        )
        for code, those in by_code.items()
    ]


# No profile knows of a cooler. A room is taken to be between 15 and 30 °C: what must cool below 30
# °C may never get there, and what must warm up without a target may not either. M109 and M190 with
# S wait for warming alone, but on some families (`Family.awaits_cooling`).
COLDEST_ROOM_C: Final = 15.0
WARMEST_ROOM_C: Final = 30.0
_SETS: Final = {
    **dict.fromkeys(("M104", "M109"), "extruder"),
    **dict.fromkeys(("M140", "M190"), "heater_bed"),
    **dict.fromkeys(("M141", "M191"), "chamber"),
}
_WAITS: Final = ("M109", "M190", "M191")


def wait_checks(run: DryRun, printer: Printer) -> list[Check]:
    """A row for the first wait that may never end; none where all end."""
    if not printer.streamed:
        return []
    targets: dict[str, float] = {}
    for number, line in run.others:
        failed = next(_endless(line, targets, printer), None)
        if failed is not None:
            value, limit, why = failed
            name = "wait for a temperature that may never be reached"
            return [
                Check(Kind.ENDLESS_WAIT, name, value, limit, "°C", False, f"line {number}", why)
            ]
    return []


def _endless(
    line: GcodeLine, targets: dict[str, float], printer: Printer
) -> Iterator[tuple[float, float, str]]:
    """Temperature, limit and reason of a wait that may not end; ``targets`` follow the line."""
    meaning = meanings().get(line.code)
    if line.code in _SETS:
        yield from _by_code(line, targets, printer)
    elif meaning is Meaning.HEATS:
        target = _number(line, "TARGET")
        targets[line.parameters.get("HEATER", "")] = 0.0 if target is None else target
    elif meaning is Meaning.AWAITS:
        yield from _by_name(line, targets)


def _by_code(
    line: GcodeLine, targets: dict[str, float], printer: Printer
) -> Iterator[tuple[float, float, str]]:
    head = int(line.number("T") or 0)
    kept, given = line.number("R"), line.number("S")
    target = given if given is not None else kept
    if target is None:
        return
    targets[_SETS[line.code] + (f"{head}" if head else "")] = target
    if line.code not in _WAITS:
        return
    cools = line.code in family_of(printer).awaits_cooling and target > 0
    coldest = COLDEST_ROOM_C if line.code == "M191" else 0.0
    if target < (WARMEST_ROOM_C if kept is not None or cools else coldest):
        yield _too_cold(line, target)


def _by_name(line: GcodeLine, targets: dict[str, float]) -> Iterator[tuple[float, float, str]]:
    target = targets.get(line.parameters.get("SENSOR", ""), 0.0)
    least, most = _number(line, "MINIMUM"), _number(line, "MAXIMUM")
    if most is not None and most < max(WARMEST_ROOM_C, target):
        if most < WARMEST_ROOM_C:
            yield _too_cold(line, most)
        else:
            yield (
                most,
                target,
                (f"the target set by the job is {target:g} °C; wait for that, or lower it"),
            )
    if least is not None and least > target:
        yield (
            least,
            target,
            f"the job sets no target of at least {least:g} °C for this heater before the wait; set "
            "one (SET_HEATER_TEMPERATURE, M104, M140), or remove the wait",
        )


def _too_cold(line: GcodeLine, celsius: float) -> tuple[float, float, str]:
    return (
        celsius,
        WARMEST_ROOM_C,
        f"{line.code} waits for cooling to {celsius:g} °C, but without a cooler nothing gets "
        f"colder than the room ({COLDEST_ROOM_C:g} to {WARMEST_ROOM_C:g} °C); cool before the "
        "start and remove the wait",
    )


def _number(line: GcodeLine, key: str) -> float | None:
    try:
        return float(line.parameters[key])
    except (KeyError, ValueError):
        return None


_COUNTED = {
    "unknown_command": "commands unknown to the firmware",
    "no_command": "lines that are not commands",
    "cold_extrusion": "plunger moves that the firmware would ignore",
    "homing": "homing with the needle mounted",
    "bad_arc": "invalid arcs",
}
"""Findings of which none is allowed, and their names."""
_TINY_MM = 1e-6
MAX_MERGED_SHARE: Final = 0.01
"""Of all moves: single merged ones cut a corner by less than a tenth of a millimetre."""
_PROBES = ("G29", "G30", "G32", "G34")
_NAMED_PROBES = ("BED_MESH_CALIBRATE", "PROBE_ACCURACY", "PROBE_CALIBRATE", "Z_TILT_ADJUST")
_COUNTED_REMEDY = {
    "homing": "remove G28 and touch off instead: homing would drive the needle into the dish",
}


def gcode_checks(run: DryRun, printer: Printer, place_key: str = RECIPE_KEYS.place) -> list[Check]:
    """Every check of a dry run, passed or not; ``place_key`` says what moves the part."""
    findings = {finding.code: finding for finding in run.findings}
    findings_told = _as_the_gate(run, printer)
    checks = [
        *_travel(run, printer, place_key),
        *_speed(run, findings),
        *_plunger(run, printer, findings),
        *_pulled_back(run),
        _line_length(run, printer, findings),
        _merged(run, printer),
        _starved(run, printer),
        *(_counted(code, name, findings_told) for code, name in _counted_for(printer).items()),
        _probing(run),
        *gate_checks(run, printer),
        *motor_checks(run, printer),
        *wait_checks(run, printer),
        *place_checks(run, printer),
        *firmware_checks(run, printer),
        *valve_checks(run, printer),
        *pressure_checks(run, printer),
        *profile_checks(printer),
    ]
    listed = {*_counted_for(printer), "plunger_travel", "long_line"}
    others = [
        finding
        for code, finding in findings.items()
        if code not in listed and not code.startswith(("outside_", "speed_"))
    ]
    return checks + [_other(finding) for finding in others]


def _as_the_gate(run: DryRun, printer: Printer) -> list[Finding]:
    """All findings; an unknown command's says what the gate says, which refuses it in a print."""
    if not printer.streamed:
        return run.findings
    strange = [(number, line) for number, line in run.others if not is_known_line(printer, line)]
    told = {number: f"line {number}: {why}" for number, _, why in refused_lines(strange, printer)}
    return [
        replace(f, message=told[f.line]) if f.code == "unknown_command" and f.line in told else f
        for f in run.findings
    ]


def _counted_for(printer: Printer) -> dict[str, str]:
    return {**_COUNTED, **ABOUT_HEADS} if printer.heads else _COUNTED


def _line(finding: Finding | None) -> str:
    return f"line {finding.line}" if finding and finding.line else ""


def _travel(run: DryRun, printer: Printer, place_key: str) -> list[Check]:
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
            f"move it ({place_key}), or use a smaller part or a larger printer"
        )
        for end, value, limit, line in (
            ("lowest", run.low_mm[axis], span.low, run.low_line[axis]),
            ("highest", run.high_mm[axis], span.high, run.high_line[axis]),
        ):
            wrong = beyond.get((f"outside_{name}", limit))
            place = _line(wrong) if wrong else f"line {line}"
            checks.append(
                Check(
                    Kind.TRAVEL,
                    f"{name}, {end}",
                    float(value),
                    limit,
                    "mm",
                    wrong is None,
                    place,
                    remedy,
                )
            )
    return checks


def _speed(run: DryRun, findings: dict[str, Finding]) -> list[Check]:
    fastest = run.speed_mm_s.max(axis=0, initial=0.0)
    return [
        Check(
            Kind.SPEED,
            f"{name.upper()} speed",
            float(fastest[axis]),
            float(run.limit_mm_s[axis]),
            "mm/s",
            f"speed_{name}" not in findings,
            _line(findings.get(f"speed_{name}")),
            "reduce the speed: the firmware would slow down the whole move",
        )
        for axis, name in enumerate("xyze")
    ]


def _plunger(run: DryRun, printer: Printer, findings: dict[str, Finding]) -> list[Check]:
    """Each head's; none for a pneumatic one."""
    if printer.heads:
        return check_each_head(run, printer, lambda _, view, one: _travelled(view, one, findings))
    return _travelled(run, printer, findings)


def _travelled(run: DryRun, printer: Printer, findings: dict[str, Finding]) -> list[Check]:
    limit = printer.plunger_travel_mm
    if limit is None:
        return []
    fits = run.plunger_max_mm <= limit + _TINY_MM
    place = _line(findings.get("plunger_travel"))
    remedy = "use a wider syringe or a smaller part"
    return [
        Check(
            Kind.PLUNGER_TRAVEL,
            "plunger travel",
            run.plunger_max_mm,
            limit,
            "mm",
            fits,
            place,
            remedy,
        )
    ]


def _pulled_back(run: DryRun) -> list[Check]:
    """Whether the plunger goes back behind where it begins: a full syringe has no room there."""
    back = -run.plunger_min_mm
    if back <= _TINY_MM:
        return []
    row = int(run.program.plunger.argmin())
    return [
        Check(
            Kind.PLUNGER_BEHIND,
            "plunger retracted behind its start",
            back,
            0,
            "mm",
            False,
            f"line {int(run.program.line[row])}",
            "the plunger of a full syringe would come out; leave that much travel behind it",
            "warns",
        )
    ]


def _line_length(run: DryRun, printer: Printer, findings: dict[str, Finding]) -> Check:
    size, line = run.longest_line
    return Check(
        Kind.LINE_LENGTH,
        "longest line sent",
        size,
        printer.max_line_bytes,
        "bytes",
        "long_line" not in findings,
        f"line {line}",
        "shorten it: the firmware would truncate it",
    )


def _merged(run: DryRun, printer: Printer) -> Check:
    """Moves that the planner would drop and add to the next: corners cut where it likes."""
    least, line = printer.min_steps_per_segment, run.first_short_line
    moves = int((run.program.kind == MOVE).sum())
    most = int(MAX_MERGED_SHARE * moves)
    return Check(
        Kind.MERGED_MOVES,
        f"moves shorter than {least} motor steps",
        run.merged_moves,
        most,
        "",
        run.merged_moves <= most,
        f"line {line}" if line else "",
        f"the firmware merges {run.merged_moves} of {moves} moves with the next one "
        f"(min_steps_per_segment {least}), which cuts corners but loses no ink; use longer "
        "segments",
        "warns",
    )


def _starved(run: DryRun, printer: Printer) -> Check:
    """Moves shorter than their lines take to come: the motion slows down and stutters."""
    starved = run.starved
    may_pair = family_of(printer).pairs and printer.lines_in_flight == 1
    more = ", lines_in_flight: 2" if may_pair else ""
    return none_of(
        Kind.STARVED,
        "segments limited by the serial link",
        starved.segments,
        f"line {starved.line}" if starved.line else "",
        "lines arrive more slowly than they are executed, so the head slows down and stutters "
        f"there ({starved.seconds:.1f} s in total): use longer segments, a higher baud rate (now "
        f"{printer.baud}){more} or an adapter with less latency (host_turnaround_s "
        f"{printer.host_turnaround_s:g})",
        "warns",
    )


def _probing(run: DryRun) -> Check:
    """Bed probing drives the tool down until something gives, as homing does."""
    rows = np.flatnonzero(np.isin(run.program.code, [code(name) for name in _PROBES]))
    named = [number for number, line in run.named if line.code in _NAMED_PROBES]
    lines = sorted([*(int(run.program.line[row]) for row in rows), *named])
    return none_of(
        Kind.PROBING,
        "probing with the needle mounted",
        len(lines),
        f"line {lines[0]}" if lines else "",
        "remove it: probing would drive the needle into the dish; probe before needle and dish are "
        "mounted, and touch off the needle",
    )


def _counted(code: str, name: str, findings: list[Finding]) -> Check:
    """All findings of one sort, the first one's line and each one's message."""
    those = [finding for finding in findings if finding.code == code]
    remedy = _COUNTED_REMEDY.get(code, "; ".join(finding.message for finding in those))
    first = those[0] if those else None
    count = sum(finding.count for finding in those)
    return Check(_kind_of(code), name, count, 0, "", not those, _line(first), remedy)


def _other(finding: Finding) -> Check:
    names = {**SORTS, **ABOUT_HEADS, "empty_file": "files without a command"}
    name, line = names.get(finding.code, finding.code), _line(finding)
    return Check(_kind_of(finding.code), name, finding.count, 0, "", False, line, finding.message)


def _kind_of(code: str) -> Kind:
    """Kind of a finding of the dry run; those of the reading of lines are of one kind."""
    return Kind(code) if code in set(Kind) else Kind.BAD_LINE
