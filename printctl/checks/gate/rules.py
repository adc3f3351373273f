"""Allow-list of the G-code gate: codes permitted by origin (console or job file) and firmware.

A code that isn't here is refused. Sources of what a code does: Marlin bugfix-2.1.x
``src/gcode``; RepRapFirmware 3.5 ``GCodes2.cpp``; Klipper ``gcode_move.py``, ``toolhead.py``,
``idle_timeout.py``; Prusa-Firmware ``Marlin_main.cpp``.
"""

from __future__ import annotations

from functools import cache
from typing import Final

from firmware_profiles.families import family as gate_facts
from firmware_profiles.families import family_of, find_family
from gcode.reading import GcodeLine
from printctl.checks.gate.heat import NamedTarget, set_target, wait_for
from printctl.checks.gate.inputs import AllowedLine, LineOrigin, NotAllowed, Phase, PrinterSituation
from printctl.checks.gate.motion import home, move
from printctl.checks.gate.rule_makers import (
    Judge,
    allow,
    allow_planned_setting,
    allow_query,
    allow_within,
    as_number,
    choose_head,
    cold_extrusion,
    keyed,
    only_with,
    timeout,
)

Rules = dict[str, Judge]
_FAN: Final = allow_within({"S": (0, 255), "P": (0, 20)}, needs="S")


def _still(line: GcodeLine, known: PrinterSituation) -> AllowedLine:
    """A wait for the motors, where none of them writes."""
    if known.phase is Phase.PRINTING:
        raise NotAllowed("it stops the needle in the gel until the planner is empty; pause instead")
    return allow("")(line, known)


def _speed(known: PrinterSituation, letter: str) -> tuple[float, str]:
    per_s = family_of(known.printer).m203_per_s
    return getattr(known.printer.max_speed_mm_s, letter.lower()) * per_s, "max_speed_mm_s"


def _axis_acceleration(known: PrinterSituation, letter: str) -> tuple[float, str]:
    axes = known.printer.max_acceleration_mm_s2
    return getattr(axes, letter.lower()), "max_acceleration_mm_s2"


def _acceleration(known: PrinterSituation, letter: str) -> tuple[float, str]:
    return known.printer.acceleration_mm_s2, "acceleration_mm_s2"


def _least_segment(known: PrinterSituation, letter: str) -> tuple[float, str]:
    return known.printer.min_segment_time_s * 1e6, "min_segment_time_s, in µs"


def _corners(line: GcodeLine, known: PrinterSituation) -> AllowedLine:
    """Only the least time of a segment: the rest can't be set back."""
    if "J" in line.words:
        raise NotAllowed(
            "the firmware tells J to two decimals, so that it couldn't be set back as it was; set "
            "the board and the profile (junction_deviation_mm) alike, and take J out"
        )
    return allow_planned_setting(_least_segment, "B")(line, known)


def _advance(key: str) -> Judge:
    """Let pressure advance pass as the profile has it."""

    def judge(line: GcodeLine, known: PrinterSituation) -> AllowedLine:
        own = known.printer.advance_s
        number = line.parameters.get(key)
        if number is None and not line.code[1:].isdigit():
            return AllowedLine(line.text.decode("ascii"))  # by its name alone it asks
        value = line.number(key) if number is None else as_number(number)
        if value is None or not abs(value - own) <= 1e-9 or set(line.words) - {key}:
            raise NotAllowed(
                f"pressure advance is {own:g} s (advance_s of {known.printer.name}), and checks "
                "count on it; correct the profile"
            )
        return AllowedLine(line.text.decode("ascii"))

    return judge


def _offset_taken_back(head: str) -> Judge:
    """Let a head's offset of 0 pass."""

    def judge(line: GcodeLine, known: PrinterSituation) -> AllowedLine:
        if head not in line.words or any(mm for key, mm in line.words.items() if key != head):
            raise NotAllowed(
                f"only an offset of a head that is taken back passes: {line.code} {head}1 X0 Y0 Z0"
            )
        return AllowedLine(line.text.decode("ascii"))

    return judge


def _power_off(line: GcodeLine, known: PrinterSituation) -> AllowedLine:
    """Motors that lose their power at once."""
    if "S" in line.words:
        raise NotAllowed(
            "S sets a time for all that comes later, which no firmware tells, so that it couldn't "
            f"be set back; take S out ({line.code} alone cuts the power at once)"
        )
    return allow("XYZE")(line, known)


def _head(line: GcodeLine, known: PrinterSituation) -> AllowedLine:
    """A head that the printer has, chosen without the macros of a change of tools."""
    free = family_of(known.printer).head_macro_free
    if free and line.words.get(free[0]) != float(free[1:]):
        raise NotAllowed(f"macros of the board may move it; write {line.code} {free}")
    return AllowedLine(line.text.decode("ascii"))


_ASKED: Final[Rules] = {
    **{
        code: allow_query()
        for code in ["M92", "M201", "M203", "M204", "M205", "M206", "M218", "M301", "M302", "M304"]
    },
    **{
        code: allow_query()
        for code in ["M113", "M115", "M119", "M155", "M211", "M220", "M31", "M111", "M122"]
    },
    "M105": allow_query("T"),
    "M114": allow_query("DER"),
    "M221": allow_query("TD"),
    "M503": allow_query("S"),
}

_CONSOLE: Final[Rules] = {
    **_ASKED,
    "G0": move,
    "G1": move,
    "G21": allow(""),
    "G28": home,
    "G90": allow(""),
    "M82": allow(""),
    "M104": set_target,
    "M106": _FAN,
    "M107": allow("P"),
    "M117": allow(),
    "M140": set_target,
    "M141": set_target,
    "M400": _still,
}

_JOB: Final[Rules] = {
    **{
        code: allow()
        for code in [
            "G0",
            "G1",
            "G2",
            "G3",
            "G28",
            "G92",
            "M17",
            "M73",
            "M75",
            "M76",
            "M77",
            "M117",
        ]
    },
    **{code: allow("") for code in ["G17", "G21", "G90", "M82", "M400"]},
    **dict.fromkeys(["M104", "M109", "M140", "M190", "M141", "M191"], wait_for),
    **_ASKED,
    **dict.fromkeys(["M18", "M84"], _power_off),
    "G4": allow("PS"),
    "M85": timeout("S", zero_is_off=True),
    "M106": _FAN,
    "M107": allow("P"),
    "M200": only_with({"D": 0, "S": 0}, "T", "E is the plunger's travel in mm"),
    "M201": allow_planned_setting(_axis_acceleration, "XYZE"),
    "M203": allow_planned_setting(_speed, "XYZE"),
    "M204": allow_planned_setting(_acceleration, "PRST"),
    "M205": _corners,
    "M211": only_with({"S": 1}, "", "the firmware's own limits stay on"),
    "M218": only_with({"X": 0, "Y": 0, "Z": 0}, "T", "offset_mm of the profile's heads says it"),
    "M220": only_with({"S": 100}, "", "lower the job's speeds: a factor would pass all checks by"),
    "M221": only_with({"S": 100}, "TD", "doses are the job's: correct flow_factor or the ink"),
    "M302": cold_extrusion,
    "M900": _advance("K"),
}


def _judge(own: gate_facts.Rule) -> Judge:
    """Make the judge of a family's own rule."""
    match own:
        case gate_facts.AllowQuery():
            return allow_query(own.letters)
        case gate_facts.AllowValues():
            return only_with(own.values, "", own.remedy)
        case gate_facts.AllowOffsetReset():
            return _offset_taken_back(own.head)
        case gate_facts.Advance():
            return _advance(own.key)
        case gate_facts.Timeout():
            return timeout(own.key)
        case gate_facts.Keys():
            return keyed(own.spans, own.needs)
        case gate_facts.ChooseHead():
            return choose_head
        case gate_facts.CheckNamedHeater():
            return NamedTarget(own)


def of_the_moment(judge: Judge | None) -> bool:
    """Whether a rule depends on what is known when a line is sent."""
    return isinstance(judge, NamedTarget) or judge in (move, home, set_target)


@cache
def rules(family: str, origin: LineOrigin) -> Rules:
    """Rules for lines of an origin, by code.

    Parameters
    ----------
    family : str
        The profile's ``firmware``.
    origin : LineOrigin
    """
    facts, of_job = find_family(family), origin is LineOrigin.JOB
    common, own = (_JOB, facts.job_rules) if of_job else (_CONSOLE, facts.console_rules)
    return {**common, **{code: _judge(one) for code, one in own.items()}}


def rule(line: GcodeLine, family: str, origin: LineOrigin) -> Judge | None:
    """Rule of a line; None where its code is refused."""
    if line.code[:1] == "T" and line.code[1:].isdigit():
        return _head if origin is LineOrigin.JOB else None
    return rules(family, origin).get(line.code)
