"""Build gate rules (allowed parameters and ranges), and the reasons for refusals."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from typing import Final

from firmware_profiles.families import family_of
from gcode.reading import GcodeLine
from printctl.checks.gate.inputs import AllowedLine, NotAllowed, PrinterSituation

_COUNT: Final = "it would break the link's count or position"
_FIRMWARE: Final = (
    "it changes the firmware's settings, which the profile describes; close the station, set it "
    "with the maker's own program, then `printctl profiles probe` corrects the profile"
)
_LIMITS: Final = "it moves without the soft limits; use jog, move_to or home"
_FILES: Final = "it runs or writes files on the board that no check has seen; print from the host"
_CHANGE: Final = (
    "it changes filament: the firmware parks the head past the soft limits, drives E and waits for "
    "a button; take it out, and change the syringe by `printctl reload`"
)
_WAITS: Final = "it waits for a button on the printer for ever; take it out and pause from the host"


def _each(why: str, names: str) -> dict[str, str]:
    return dict.fromkeys(names.split(), why)


REASONS: Final[dict[str, str]] = {
    **_each(_FIRMWARE, "M92 M201 M202 M203 M204 M205 M206 M207 M208 M209 M218 M301 M304 M305"),
    **_each(_FIRMWARE, "M307 M309 M350 M428 M500 M501 M502 M504 M569 M574 M584 M665 M666"),
    **_each(_FIRMWARE, "M851 M906 M907 M913 M915 M950 M558 M557 M561 M563 M572 M593 M671"),
    **_each(
        "it switches the firmware's own limits; they stay as they are built", "M211 M564 M120 M121"
    ),
    **_each(_LIMITS, "G2 G3 G5 G10 G11 G12 G26 G27 G29 G30 G32 G33 G34 G35 G38 G42 G60 G61 G76"),
    **_each(_LIMITS, "G80 G81 G425 M48 M290 M423 M922"),
    **_each(_CHANGE, "M125 M600 M603 M701 M702"),
    **_each(_FILES, "M20 M21 M22 M23 M24 M25 M26 M27 M28 M29 M30 M32 M33 M36 M37 M38 M98 M928"),
    **_each(_FILES, "M997 M505 M470 M471"),
    "G20": "inches: the link's own moves are in mm; write millimetres",
    "G53": "another frame of places; the link knows one alone",
    "G91": "relative moves: a line sent again would move twice; write G90 and absolute X Y Z",
    "M83": "relative extrusion: a line sent again would dose twice; write M82 and absolute E",
    "G92": f"{_COUNT}; say where the tip is by `printctl station where`",
    "SET_KINEMATIC_POSITION": f"{_COUNT}; say where the tip is by `printctl station where`",
    "M0": _WAITS,
    "M1": _WAITS,
    "M17": f"{_COUNT}: motors are held by the station",
    "M18": f"{_COUNT}: motors without power lose their place",
    "M84": f"{_COUNT}: motors without power lose their place",
    "M85": "the link sets the firmware's own switch-off; see idle_timeout_s of the profile",
    "SET_IDLE_TIMEOUT": "the link sets the firmware's own switch-off; see idle_timeout_s",
    "M108": f"it breaks the printer's waits; {_COUNT}",
    "M110": f"it renumbers the lines, which the link does itself; {_COUNT}",
    "M111": "it may make the firmware run dry or silent; M111 alone asks for its flags",
    "M112": f"{_COUNT}; to halt the printer use `printctl station emergency-stop`",
    "M113": "the link sets how often the firmware says that it is busy",
    "M118": "its text would be taken for the printer's own answer; use M117",
    "M149": "temperatures are in °C",
    "M154": "the station asks for positions itself",
    "M155": "the station asks for temperatures itself",
    "M410": f"it throws moves away; {_COUNT}: `printctl station stop` ends a move",
    "M876": "it answers a prompt of the firmware; see to the printer",
    "M999": "it clears an error state that a person must see; reconnect instead",
    "M200": "E is the plunger's travel in mm, no volume",
    "M220": "speeds are the job's, within the profile's limits; a factor would pass them by",
    "M221": "doses are the job's; a factor would change them: correct `flow_factor` or the ink",
    "M302": "the link allows cold extrusion itself where the plunger moves",
    "M900": "pressure advance is the profile's advance_s; correct it there",
    "SET_PRESSURE_ADVANCE": "pressure advance is the profile's advance_s; correct it there",
    "SET_VELOCITY_LIMIT": "speed and acceleration are the profile's and printer.cfg's",
    "SET_GCODE_OFFSET": f"it shifts every place that is named later; {_COUNT}",
    "RESTORE_GCODE_STATE": "it brings back modes, and a place, that no check follows",
    "SAVE_GCODE_STATE": "what it saves no check follows",
    "SAVE_CONFIG": f"it restarts the firmware; {_COUNT}",
    "FIRMWARE_RESTART": f"it restarts the firmware; {_COUNT}: use reconnect",
    "RESTART": f"it restarts the firmware; {_COUNT}: use reconnect",
    **_each("it waits for a temperature, and nothing else is heard meanwhile; use heat",
            "M109 M190 M191 M116 TEMPERATURE_WAIT"),
    **_each("it heats without a limit; use heat", "M303 M568 M144 M143"),
    "M106": "a fan",
    "G4": "it keeps the printer from answering; nothing waits for it here",
    "G28": "homing drives the needle into what is below",
    "M400": "it stops the needle in the gel until the planner is empty; pause instead",
}  # fmt: skip
"""By code, without its number of a head."""
_IN_PRINT: Final[dict[str, str]] = {
    "M112": f"{_COUNT}; to halt the printer use `printctl emergency-stop`",
    "M410": f"it throws moves away; {_COUNT}: `printctl cancel` ends the print",
    "G92": f"{_COUNT}, which a print takes from its start",
    "SET_KINEMATIC_POSITION": f"{_COUNT}, which a print takes from its start",
}
"""While a print goes on or is paused, where the station's commands don't reach."""
_NAMED: Final = (
    "macros and commands with names may move, heat or set anything, and no check here knows what "
    "they do"
)
_UNLISTED: Final = "it isn't on the list of what may be sent, so nobody judged what it does"


def reason(code: str, listed: Iterable[str], console: bool, in_print: bool = False) -> str:
    """Return why a code is refused; ``listed`` are the origins that may send it."""
    if in_print and code in _IN_PRINT:
        return _IN_PRINT[code]
    if code in REASONS:
        return REASONS[code]
    if code.startswith("T"):
        return (
            "another head than the job's would be taken; its syringe is changed by `printctl "
            "reload RUN --head`, which takes it and gives it back"
        )
    why = _NAMED if "_" in code or not code[1:].isdigit() else _UNLISTED
    return f"{why}. What may be sent from here: {', '.join(listed)}" if console else why


Judge = Callable[[GcodeLine, PrinterSituation], AllowedLine]
Planned = Callable[[PrinterSituation, str], tuple[float, str]]
"""Value of a letter by the profile, and the key that says it."""
LEAST_TIMEOUT_S: Final = 60.0
"""Three times the link's interval of signs of life in a pause (`machine.control.pausing`)."""
LONGEST_TIMEOUT_S: Final = 3600.0
HOTTEST_LEAST_C: Final = 300.0
"""Highest temperature below which a job may forbid the plunger to move (M302 S)."""
_SAME: Final = 1e-4
"""Share by which a value may differ from the profile's: some programs write few digits."""


def allow(words: str | None = None) -> Judge:
    """Let a code pass with these letters alone; with any where None is given."""

    def judge(line: GcodeLine, known: PrinterSituation) -> AllowedLine:
        if words is not None:
            _only(line, words)
        return AllowedLine(line.text.decode("ascii"))

    return judge


def allow_query(words: str = "") -> Judge:
    """Let a question pass: a code that sets something as soon as it has other words."""

    def judge(line: GcodeLine, known: PrinterSituation) -> AllowedLine:
        beyond = sorted({*line.words, *line.parameters} - set(words))
        if beyond:
            why = REASONS.get(line.code, "that isn't done from here")
            raise NotAllowed(
                f"with {' '.join(beyond)} it sets something ({line.code} alone asks): {why}"
            )
        return AllowedLine(line.text.decode("ascii"))

    return judge


def only_with(values: Mapping[str, float], also: str = "", remedy: str = "") -> Judge:
    """Let a setting pass that takes another back: these words with these values alone.

    Parameters
    ----------
    values : mapping
        Letter (or Klipper's key) to the one value it may have; one at least must be there.
    also : str
        Letters of any value (a head's number).
    remedy : str
        What to do instead of another value.
    """

    def judge(line: GcodeLine, known: PrinterSituation) -> AllowedLine:
        given = {**line.words, **{key: as_number(text) for key, text in line.parameters.items()}}
        wrong = [key for key, value in given.items() if key not in also and (
            key not in values or value != values[key])]  # fmt: skip
        if wrong or not given.keys() & values.keys():
            words = " ".join(f"{key}{value:g}" for key, value in values.items())
            raise NotAllowed(f"only {line.code} {words} passes; {remedy}")
        return AllowedLine(line.text.decode("ascii"))

    return judge


def allow_planned_setting(planned: Planned, words: str) -> Judge:
    """Let a setting of a job pass that says what the profile says; it is undone at the job's end.

    The dry run plans with the profile's values: another would make all its times wrong.
    """

    def judge(line: GcodeLine, known: PrinterSituation) -> AllowedLine:
        _only(line, words)
        for letter, value in line.words.items():
            wanted, key = planned(known, letter)
            if value is None or not abs(value - wanted) <= _SAME * wanted:
                word = letter if value is None else f"{letter}{value:g}"
                raise NotAllowed(
                    f"{word} isn't {letter}{wanted:g} ({key} of {known.printer.name}), with which "
                    "the dry run plans; take it out, or correct the profile"
                )
        return AllowedLine(line.text.decode("ascii"), undo=(line.code,))

    return judge


def cold_extrusion(line: GcodeLine, known: PrinterSituation) -> AllowedLine:
    """Let M302 pass with P0 or P1, and S up to `HOTTEST_LEAST_C`; the job's end undoes it.

    Of other values each firmware makes its own: P-1 allows on Marlin and forbids on RepRapFirmware.
    """
    _only(line, "PS")
    if "P" in line.words and line.words["P"] not in (0.0, 1.0):
        raise NotAllowed("P is 1 (cold extrusion allowed) or 0 (not allowed)")
    least = line.words.get("S", 0.0)
    if least is None or not 0.0 <= least <= HOTTEST_LEAST_C:
        raise NotAllowed(
            f"S is the least temperature at which the plunger moves, 0 to {HOTTEST_LEAST_C:g} °C"
        )
    return AllowedLine(line.text.decode("ascii"), undo=(line.code,))


def timeout(key: str, *, zero_is_off: bool = False) -> Judge:
    """Let the firmware's own switch-off pass that strikes in no pause; the job's end undoes it.

    From `LEAST_TIMEOUT_S` to `LONGEST_TIMEOUT_S`, or the profile's if longer.

    Parameters
    ----------
    key : str
        Word or key of its seconds; without any word it asks.
    zero_is_off : bool
        Whether 0 is none at all, which preflight judges.
    """

    def judge(line: GcodeLine, known: PrinterSituation) -> AllowedLine:
        given = {**line.words, **{name: as_number(text) for name, text in line.parameters.items()}}
        most = max(LONGEST_TIMEOUT_S, known.printer.idle_timeout_s)
        for name, seconds in given.items():
            off = zero_is_off and seconds == 0
            if name != key or seconds is None or not (off or LEAST_TIMEOUT_S <= seconds <= most):
                raise NotAllowed(
                    f"only {line.code} with {key} from {LEAST_TIMEOUT_S:g} to {most:g} s passes "
                    "(profile: idle_timeout_s): it switches the heaters off when the host is dead, "
                    "and a shorter one ends the print in a pause, a change of syringe or a wait, "
                    "in which the link gives a sign of life every 20 s"
                )
        return AllowedLine(line.text.decode("ascii"), undo=(line.code,) if given else ())

    return judge


def keyed(spans: Mapping[str, tuple[float, float] | None], needs: tuple[str, ...]) -> Judge:
    """Let a command with a name pass: these keys, with numbers in these spans (None: a text)."""

    def judge(line: GcodeLine, known: PrinterSituation) -> AllowedLine:
        given = line.parameters
        beyond = sorted(set(given) - set(spans))
        missing = [key for key in needs if key not in given]
        if beyond or missing or not given:
            problem = ", ".join(beyond) or "too little"
            raise NotAllowed(f"it says {problem}; only {', '.join(spans)} are looked at here")
        for key, text in given.items():
            span, value = spans[key], as_number(text)
            if span is not None and (value is None or not span[0] <= value <= span[1]):
                raise NotAllowed(f"{key}={text} is outside {span[0]:g} to {span[1]:g}")
        return AllowedLine(line.text.decode("ascii"))

    return judge


def choose_head(line: GcodeLine, known: PrinterSituation) -> AllowedLine:
    """Let a head pass that the printer has.

    Raises
    ------
    NotAllowed
    """
    printer = known.printer
    family = family_of(printer)
    number = family.head_number(line.text.decode("ascii"))
    if number is None:
        example = family.head_example or "no head"
        raise NotAllowed(f"it names no head in a way that checks follow; write {example}")
    if number >= printer.tool_count:
        raise NotAllowed(
            f"{printer.name} has {printer.tool_count} to choose, counted from 0 (heads: select)"
        )
    return AllowedLine(line.text.decode("ascii"))


def allow_within(words: Mapping[str, tuple[float, float]], *, needs: str = "") -> Judge:
    """Let a code pass whose numbers are in these spans."""

    def judge(line: GcodeLine, known: PrinterSituation) -> AllowedLine:
        _only(line, "".join(words))
        if any(letter not in line.words for letter in needs):
            raise NotAllowed(f"{needs} isn't given, and what it then does differs; write it")
        for letter, value in line.words.items():
            low, high = words[letter]
            if value is not None and not low <= value <= high:
                raise NotAllowed(f"{letter}{value:g} is outside {low:g} to {high:g}")
        return AllowedLine(line.text.decode("ascii"))

    return judge


def _only(line: GcodeLine, letters: str) -> None:
    beyond = sorted(set(line.words) - set(letters))
    if beyond:
        raise NotAllowed(f"{' '.join(beyond)} isn't looked at by any check; take it out")


def as_number(text: str) -> float | None:
    """Return a key's number; None where it isn't one."""
    try:
        return float(text)
    except ValueError:
        return None
