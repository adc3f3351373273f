"""Compare settings and limits reported by the firmware with those a job assumes."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Final

from firmware_profiles import Axes, Printer
from firmware_profiles.families import family_of

# A firmware that is slower than its profile stretches every move: the dry run's times are wrong,
# and a valve that is open for a time writes a thicker line. One that is faster accelerates harder
# than was planned. Marlin tells M201 and M203 by axis, M204 P for moves that write, R for those of
# the plunger alone and T for travel. M205 tells the corners (J), the least time of a segment (B),
# and the speeds below which no move is made (S, T): what is planned as slower is then made faster,
# and no check counts on that.
Settings = Mapping[str, Mapping[str, str]]
_SAME: Final = 0.01
"""Share by which told and profile's value may differ: M503 rounds to two decimals."""
_ROUNDED: Final = 0.005 + 1e-9
"""What two decimals hide of a junction deviation, mm (0.013 is told as 0.01)."""


def speeds_apart(settings: Settings, printer: Printer) -> Iterator[tuple[str, bool]]:
    """Yield each difference in words, and whether a line that ink is pressed into by time is wrong.

    Parameters
    ----------
    settings : mapping
        Code to words, as the firmware writes them.
    printer : Printer
    """
    for name, key, unit, reported, wanted in _pairs(settings, printer):
        if abs(reported - wanted) > _SAME * wanted:
            slower = reported < wanted
            way = "slower" if slower else "faster"
            text = f"{name} is {reported:g} {unit}, {way} than the profile's {wanted:g} ({key})"
            yield text, slower
    yield from _advanced_apart(settings.get("M205", {}), printer)


def _advanced_apart(words: Mapping[str, str], printer: Printer) -> Iterator[tuple[str, bool]]:
    """Yield the same for what M205 tells."""
    wanted = printer.junction_deviation_mm
    corner = float(words.get("J", wanted))
    if abs(corner - wanted) > _ROUNDED:
        way = "slower" if corner < wanted else "faster"
        text = f"junction deviation (M205 J) is {corner:g} mm, {way} than the profile's {wanted:g}"
        yield f"{text} (junction_deviation_mm)", corner < wanted
    wanted_us = printer.min_segment_time_s * 1e6
    segment = float(words.get("B", wanted_us))
    if abs(segment - wanted_us) > _SAME * wanted_us:
        way = "slower" if segment > wanted_us else "faster"
        text = f"least time of a segment (M205 B) is {segment:g} µs, {way} than the profile's"
        yield f"{text} {wanted_us:g} (min_segment_time_s)", segment > wanted_us
    for word, moves in (("S", "moves that write"), ("T", "travels")):
        least = float(words.get(word, 0))
        if least > 0:
            text = f"least speed of {moves} (M205 {word}) is {least:g} mm/s, faster than the"
            yield f"{text} profile's 0; M205 {word}0 takes it back", word == "S"


def _pairs(settings: Settings, printer: Printer) -> Iterator[tuple[str, str, str, float, float]]:
    by_axis: tuple[tuple[str, str, str, str, Axes], ...] = (
        ("M203", "top speed", "max_speed_mm_s", "mm/s", printer.max_speed_mm_s),
        ("M201", "top acceleration", "max_acceleration_mm_s2", "mm/s²",
         printer.max_acceleration_mm_s2),
    )  # fmt: skip
    for code, what, key, unit, wanted in by_axis:
        for axis, reported in settings.get(code, {}).items():
            if axis in ("X", "Y", "Z") or (axis == "E" and not printer.pneumatic):
                letter = axis.lower()
                name = f"{what} of {axis} ({code})"
                yield name, f"{key}.{letter}", unit, float(reported), getattr(wanted, letter)
    for word in "PT" if printer.pneumatic else "PRT":
        told_text = settings.get("M204", {}).get(word)
        if told_text is not None:
            name = f"acceleration (M204 {word})"
            yield name, "acceleration_mm_s2", "mm/s²", float(told_text), printer.acceleration_mm_s2


Answers = Mapping[str, Sequence[str]]
LISTED: Final = "M503 S0"
"""Question for all settings, bare."""
_FACTORS: Final = {"M220": "the speed factor", "M221": "the flow factor"}
_AT_PANEL: Final = (*_FACTORS, "M290")
_PERCENT: Final = re.compile(r"(\d+(?:\.\d+)?) ?%")
_FLAGS: Final = re.compile(r"DEBUG:(.*)", re.I)
_SETTING: Final = re.compile(r"^(?:echo:)?\s*(M\d+)((?: [A-Z]-?\d*(?:\.\d+)?)+)")
_WORD: Final = re.compile(r"([A-Z])(-?\d+(?:\.\d+)?)")
_LISTS: Final = (
    ("Steps/mm:", "M92", 1.0),
    ("Accelerations (mm/sec^2):", "M201", 1.0),
    ("Max speeds (mm/min):", "M203", 1 / 60),
    ("Max speeds (mm/sec):", "M203", 1.0),
)
_LISTED: Final = re.compile(r"(\b[XYZE]|min\. speed):? ?(\d+(?:\.\d+)?)")
_OFFSETS: Final = re.compile(r"[XYZ]:? ?(-?\d+\.\d+)")
_COLD: Final = re.compile(r"Cold extrudes are (en|dis)abled(?: \(min temp (\d+))?")
_PLACE: Final = re.compile(r"(gcode|gcode base): X:(\S+) Y:(\S+) Z:(\S+)")
_TIMEOUT: Final = re.compile(r"(?:Inactivity timeout|Timeout set to) (\d+(?:\.\d+)?) s")


@dataclass(frozen=True)
class Difference:
    """Something that the firmware has otherwise than checks count on.

    Attributes
    ----------
    what : str
        With its value.
    reset : str
        Command that takes it back; empty where a person must.
    remedy : str
        For a person.
    tolerated : bool
        Whether a print starts all the same, with an alarm.
    """

    what: str
    reset: str = ""
    remedy: str = ""
    tolerated: bool = False


def questions(printer: Printer) -> tuple[str, ...]:
    """What a firmware is asked before a start; none of it sets anything."""
    asked = family_of(printer).start_questions
    return tuple(one for one in asked if not (printer.pneumatic and one in ("M221", "M302")))


def panel_questions(printer: Printer) -> tuple[str, ...]:
    """What a firmware is asked during a print: what its own panel can change."""
    return tuple(one for one in questions(printer) if one in _AT_PANEL)


def blind_resets(printer: Printer) -> tuple[str, ...]:
    """What is reset unasked, because the firmware doesn't tell it."""
    resets = family_of(printer).start_resets
    return tuple(one for one in resets if not (printer.pneumatic and one.startswith("M221")))


def differences(answers: Answers, printer: Printer) -> list[Difference]:
    """Name what the firmware has otherwise than a job and its checks count on.

    Parameters
    ----------
    answers : mapping
        Question to the lines that were said to it.
    printer : Printer
    """
    all_differences = [*_factors(answers), *_limits(answers), *_flags(answers), *_shifts(answers)]
    told = (text for code in (LISTED, "M201", "M203") for text in answers.get(code, ()))
    settings = _settings([*told])
    for code, check in _CHECKS.items():
        all_differences += check(settings.get(code), printer)
    return [*all_differences, *_speeds(settings, printer)]


def levelling_is_on(lines: Sequence[str], printer: Printer) -> bool:
    """Whether the settings that M503 lists have bed levelling on."""
    return bool(_levelling(_settings(lines).get("M420"), printer))


def reported_settings(answers: Answers, printer: Printer) -> dict[str, str]:
    """Settings that a job may change, as the commands that set them back, by code.

    The junction deviation is left out: no job sets it, and its last digits aren't told.
    """
    commands: dict[str, str] = {}
    for code, words in _settings(answers.get(LISTED, ())).items():
        if code in ("M201", "M203", "M204", "M205"):
            words_set = [
                f"{key}{value}" for key, value in words.items() if (code, key) != ("M205", "J")
            ]
            commands[code] = " ".join([code, *words_set])
    for text in answers.get("M302", ()):
        cold = _COLD.search(text)
        if cold:
            least = "" if cold[2] is None else f"S{cold[2]} "  # S sets P, too: it stands first
            commands["M302"] = f"M302 {least}P{int(cold[1] == 'en')}"
    return commands | _told_timeout(answers, printer)


def _told_timeout(answers: Answers, printer: Printer) -> dict[str, str]:
    """The firmware's own switch-off as the command that sets it back, by its code."""
    family = family_of(printer)
    code = family.timeout_code
    matches = [_TIMEOUT.search(text) for text in answers.get(code, ())] if code else []
    return dict([(code, family.timeout_command(match[1])) for match in matches if match][:1])


def _settings(lines: Sequence[str]) -> dict[str, dict[str, str]]:
    """Words of each setting that M503 lists, as it writes them."""
    settings: dict[str, dict[str, str]] = {}
    for text in lines:
        match = _SETTING.match(text)
        if match:
            words = dict(_WORD.findall(match[2])) or dict.fromkeys(match[2].split(), "")
            settings.setdefault(match[1], words)
        for code, values in listed_axes(text).items():
            settings.setdefault(code, {axis: f"{value}" for axis, value in values.items()})
    return settings


def listed_axes(text: str) -> dict[str, dict[str, float]]:
    """Code and values by axis, mm/s for speeds, of a list in words; I is the slowest move."""
    return {
        code: {axis[:1].upper().replace("M", "I"): float(n) * factor
               for axis, n in _LISTED.findall(text)}
        for begin, code, factor in _LISTS
        if text.startswith(begin)
    }  # fmt: skip


def _factors(answers: Answers) -> list[Difference]:
    off = []
    for code, name in _FACTORS.items():
        matches = [_PERCENT.search(text) for text in answers.get(code, ())]
        for percent in (float(one[1]) for one in matches if one):
            if percent != 100:
                off.append(Difference(f"{name} is {percent:g} % ({code})", f"{code} S100"))
    return off


def _limits(answers: Answers) -> list[Difference]:
    texts = answers.get("M211", ())
    off = []
    if any("M211 S0" in text or "endstops: Off" in text for text in texts):
        off.append(Difference("the soft endstops are off (M211 S0)", "M211 S1"))
    for text in answers.get("M564", ()):
        if "outside the bed is permitted" in text:
            off.append(Difference("moves outside the bed are permitted (M564 S0)", "M564 S1"))
    for text in answers.get("M290", ()):
        if any(float(mm) for mm in _OFFSETS.findall(text)):
            off.append(
                Difference(
                    f"places are shifted by baby steps ({text})",
                    remedy="take them back at the panel (M290 R0 S0 moves the tip), touch off "
                    "again",
                )
            )
    return off


def _flags(answers: Answers) -> list[Difference]:
    matches = [_FLAGS.search(text) for text in answers.get("M111", ())]
    on = [one[1].strip() for one in matches if one]
    return [
        Difference(f"debug flags are set: {flags} (M111)", "M111 S0")
        for flags in on
        if flags.lower() not in ("off", "")
    ]


def _shifts(answers: Answers) -> list[Difference]:
    """What G92 has left where the firmware keeps it beside the head's own place."""
    matches = [_PLACE.search(text) for text in answers.get("GET_POSITION", ())]
    offsets = {one[1]: [float(mm) for mm in one.groups()[1:]] for one in matches if one}
    shift, place = offsets.get("gcode base"), offsets.get("gcode")
    if place is None or shift is None or not any(shift):
        return []
    x, y, z = shift
    what = f"places are shifted by X{x:g} Y{y:g} Z{z:g} mm (G92 of an earlier job or program)"
    return [Difference(what, "G92 X{:.6f} Y{:.6f} Z{:.6f}".format(*place))]


def _speeds(settings: dict[str, dict[str, str]], printer: Printer) -> list[Difference]:
    """An alarm; a refusal where ink flows by time and lines would be other than was checked."""
    remedy = "say so in a copy of the profile and check the job again, or set the firmware right"
    return [
        Difference(what, remedy=remedy, tolerated=not (wrong and printer.pneumatic))
        for what, wrong in speeds_apart(settings, printer)
    ]


def _units(words: dict[str, str] | None, printer: Printer) -> list[Difference]:
    if words is None or "C" in words:
        return []
    return [Difference(f"temperatures aren't told in °C (M149 {' '.join(words)})", "M149 C")]


def _volumes(words: dict[str, str] | None, printer: Printer) -> list[Difference]:
    if words is None or float(words.get("S", 0)) == 0:
        return []
    return [Difference("E is a volume and no travel (M200 S1)", "M200 S0")]


def _home_offset(words: dict[str, str] | None, printer: Printer) -> list[Difference]:
    shifted = {axis: mm for axis, mm in (words or {}).items() if float(mm)}
    if not shifted:
        return []
    offsets = " ".join(f"{axis}{mm}" for axis, mm in shifted.items())
    return [
        Difference(
            f"homing is shifted by M206 {offsets} mm",
            remedy="set it back with the maker's own program (M206 X0 Y0 Z0, M500), or have the "
            "firmware built with these places, and home again",
        )
    ]


def _levelling(words: dict[str, str] | None, printer: Printer) -> list[Difference]:
    if words is None or float(words.get("S", 0)) == 0:
        return []
    return [
        Difference(
            "bed levelling is on (M420 S1), which moves Z along with X and Y",
            remedy="switch it off with the maker's own program (M420 S0, M500): a tip in a bath "
            "must go where the job says",
        )
    ]


def _skew(words: dict[str, str] | None, printer: Printer) -> list[Difference]:
    factors = " ".join(f"{key}{value}" for key, value in (words or {}).items() if float(value))
    if not factors:
        return []
    return [
        Difference(
            f"skew correction is on (M852 {factors}), which moves X and Y along with Y and Z",
            remedy="switch it off with the maker's own program (M852 I0 J0 K0, M500): Marlin "
            "leaves it out near the axes' ends, so a line there jumps sideways",
        )
    ]


def _slowest(words: dict[str, str] | None, printer: Printer) -> list[Difference]:
    """Moves that are done faster than written, a plunger's push above all."""
    least = float((words or {}).get("I", 0.0))
    if least <= printer.min_speed_mm_s * (1 + _SAME):
        return []
    return [
        Difference(
            f"the slowest move (M203 I) is {least:g} mm/s, faster than the profile's "
            f"{printer.min_speed_mm_s:g} (min_speed_mm_s)",
            remedy=f"set M203 I{printer.min_speed_mm_s * 60:g} in config.g (mm/min), or say it in "
            "a copy of the profile and check the job again",
        )
    ]


def _advance(words: dict[str, str] | None, printer: Printer) -> list[Difference]:
    advance_s = float((words or {}).get("K", printer.advance_s))
    if abs(advance_s - printer.advance_s) <= 0.005:
        return []
    what = (
        f"pressure advance is {advance_s:g} s, {printer.advance_s:g} s in the profile (advance_s)"
    )
    return [Difference(what, f"M900 K{printer.advance_s:g}")]


_CHECKS: Final = {
    "M149": _units,
    "M200": _volumes,
    "M203": _slowest,
    "M206": _home_offset,
    "M420": _levelling,
    "M852": _skew,
    "M900": _advance,
}
