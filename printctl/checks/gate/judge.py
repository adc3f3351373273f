"""Judge G-code lines, one or a job's: allowed or refused, with the reason."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from functools import cache
from typing import Final

from firmware_profiles import Printer
from gcode.errors import GcodeError
from gcode.reading import BLANK, GcodeLine, read_line
from gcode.reading.line import UNKNOWN_REMEDY, is_known_line
from printctl.checks.gate.inputs import (
    NOT_BY_HAND,
    AllowedLine,
    Bounds,
    LineOrigin,
    NotAllowed,
    Phase,
    PrinterSituation,
    Refusal,
    Verdict,
)
from printctl.checks.gate.rule_makers import REASONS, reason
from printctl.checks.gate.rules import of_the_moment, rule, rules

LONGEST: Final = 200
"""Characters of a line that a person types."""


def judge(typed: str, origin: LineOrigin, known: PrinterSituation) -> Verdict:
    """Judge one line.

    Parameters
    ----------
    typed : str
        One command; comments, a line number and its checksum may be in it.
    origin : LineOrigin
        Where it comes from.
    known : PrinterSituation
        The moment.
    """
    shown = typed.strip()[:60].encode("ascii", "backslashreplace").decode()
    try:
        line = _read(typed, known.printer)
    except NotAllowed as exc:
        return Refusal(f"{shown!r} isn't sent: {exc}")
    except GcodeError as exc:
        return Refusal(str(exc))
    return judge_line(line, origin, known)


def judge_stored_line(typed: str, printer: Printer) -> Verdict:
    """Judge a line that a person keeps for later: refused is what would be at any moment.

    Moves, homing and heat are judged by what is known when they are sent.
    """
    known = PrinterSituation(Bounds(printer))
    verdict = judge(typed, LineOrigin.CONSOLE, known)
    if isinstance(verdict, AllowedLine):
        return verdict
    try:
        line = _read(typed, printer)
    except (NotAllowed, GcodeError):
        return verdict
    later = of_the_moment(rule(line, printer.firmware, LineOrigin.CONSOLE))
    return AllowedLine(line.text.decode("ascii")) if later else verdict


def judge_line(line: GcodeLine, origin: LineOrigin, known: PrinterSituation) -> Verdict:
    """Judge one line that was read."""
    printer, shown = known.printer, line.text.decode("ascii")
    console = origin is LineOrigin.CONSOLE
    by_profile = _of_profile(line, printer)
    if by_profile is not None:
        if console and by_profile == "print":
            return Refusal(f"{shown} {NOT_BY_HAND}: it switches what a print alone switches")
        return AllowedLine(shown)
    verdict = rule(line, printer.firmware, origin)
    prefix = f"{shown} {NOT_BY_HAND}" if console else shown
    if verdict is None:
        if not console and line.code in printer.extra_commands:
            return AllowedLine(shown)
        if not console and not is_known_line(printer, line):
            remedy = REASONS.get(line.code, UNKNOWN_REMEDY)
            return Refusal(f"{prefix}: unknown to {printer.firmware}; {remedy}")
        listed = rules(printer.firmware, origin)
        in_print = console and known.phase is not Phase.STANDING
        return Refusal(f"{prefix}: {reason(line.code, listed, console, in_print)}")
    if console and not is_known_line(printer, line):
        return Refusal(f"{prefix}: {line.code} is unknown to {printer.firmware}")
    try:
        return verdict(line, known)
    except NotAllowed as exc:
        return Refusal(f"{prefix}: {exc}")


def _read(typed: str, printer: Printer) -> GcodeLine:
    text = typed.strip(" ")
    if not text.isascii() or not text.isprintable():
        raise NotAllowed("one line of printable ASCII can be sent; no tabs, line ends or others")
    if len(text) > LONGEST:
        raise NotAllowed(f"{len(text)} characters exceed {LONGEST}; one command is sent at a time")
    line = read_line(text.encode("ascii"), printer)
    if not line:
        raise NotAllowed("there is no command in it")
    if len(line.text) + 13 > printer.max_line_bytes:
        raise NotAllowed(
            f"{len(line.text) + 13} bytes with number and checksum exceed "
            f"{printer.max_line_bytes} (profile: max_line_bytes), the firmware would cut it"
        )
    return line


def _of_profile(line: GcodeLine, printer: Printer) -> str | None:
    """What the profile names the line for: ``print`` (valve, heads), ``any``; None for nothing."""
    code = line.code
    of_print, of_any = _named_by(printer)
    if any(_about(line, one, other) for one, other in of_print if one.code == code):
        return "print"
    return "any" if line.text in of_any else None


def _about(line: GcodeLine, one: GcodeLine, other: GcodeLine) -> bool:
    """Whether a line has the words that two settings of one thing (a fan, a pin) have in common."""
    return _words(one) & _words(other) <= _words(line)


def _words(line: GcodeLine) -> set[tuple[str, object]]:
    return {*line.words.items(), *line.parameters.items()}


@cache
def _named_by(
    printer: Printer,
) -> tuple[tuple[tuple[GcodeLine, GcodeLine], ...], frozenset[bytes]]:
    """What switches valves, pressures and heads, as pairs; what else the profile has sent."""
    pairs = [(head.opens, head.closes) for head in printer.airs]
    pairs += printer.pressure_pairs.values()
    pairs += [(h.raises, h.lowers) for h in printer.heads if h.raises and h.lowers]
    every = [*printer.safe_state_off, *(watched.query for watched in printer.watch)]
    both = [(_of_text(one, printer), _of_text(other, printer)) for one, other in pairs]
    others = (_of_text(text, printer) for text in every)
    read = tuple((one, other) for one, other in both if one and other)
    return read, frozenset(line.text for line in others if line)


def _of_text(text: str, printer: Printer) -> GcodeLine:
    """Read a command of the profile; blank for one that can't be read, which preflight reports."""
    try:
        return read_line(text.encode("ascii"), printer)
    except GcodeError:
        return BLANK


def refused_lines(
    lines: Iterable[tuple[int, GcodeLine]], printer: Printer
) -> list[tuple[int, str, str]]:
    """Lines of a job that may not leave: the line, its code, and why.

    Parameters
    ----------
    lines : iterable of (int, GcodeLine)
        Line of the file, and what stands there.
    printer : Printer
    """
    refused, known, kept = [], PrinterSituation.of_job(printer), dict[bytes, Verdict]()
    for number, line in lines:
        if line.text not in kept:
            kept[line.text] = judge_line(line, LineOrigin.JOB, known)
        verdict = kept[line.text]
        if isinstance(verdict, Refusal):
            refused.append((number, line.code, verdict.message))
    return refused


def changed_settings(lines: Sequence[GcodeLine], printer: Printer) -> tuple[str, ...]:
    """Settings of the firmware (codes) that a job changes, in its order; undone at its end."""
    known, settings = PrinterSituation.of_job(printer), dict[str, None]()
    for line in lines:
        verdict = judge_line(line, LineOrigin.JOB, known)
        if not isinstance(verdict, Refusal):
            settings.update(dict.fromkeys(verdict.undo))
    return tuple(settings)
