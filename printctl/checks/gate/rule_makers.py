"""Build gate rules: functions that allow a G-code only with given parameters and ranges."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Final

from firmware_profiles.families import family_of
from printctl.checks.gate.inputs import PrinterSituation
from printctl.checks.gate.reasons import REASONS
from printctl.checks.gate.verdict import AllowedLine, NotAllowed
from sim.gcode.reading import GcodeLine

Judge = Callable[[GcodeLine, PrinterSituation], AllowedLine]
Planned = Callable[[PrinterSituation, str], tuple[float, str]]
"""Value of a letter by the profile, and the key that says it."""
LEAST_TIMEOUT_S: Final = 60.0
"""Three times the link's interval of signs of life in a pause (`machine.link.pauses`)."""
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
    own = family_of(printer).heads
    match = own.select.fullmatch(line.text.decode("ascii")) if own else None
    if own is None or match is None:
        example = own.example if own else "no head"
        raise NotAllowed(f"it names no head in a way that checks follow; write {example}")
    if int(match[1] or 0) >= printer.head_count:
        raise NotAllowed(f"{printer.name} has {printer.head_count} heads, counted from 0 (heads)")
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
