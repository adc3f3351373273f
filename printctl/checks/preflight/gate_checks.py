"""Check a job for commands the gate refuses, unknown outputs switched, and motors off too early."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

from firmware_profiles import Printer
from printctl.checks.gate import refused_lines
from printctl.checks.set_up.check import Check
from sim.gcode.dry_run.run import DryRun
from sim.gcode.program.modal import MOVE
from sim.gcode.reading.line import is_known_line
from sim.gcode.reading.words import SETS_ARRAY, SETS_CALL, output_of

_OUTPUTS: Final = "outputs set other than the valve's"


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
        Check(
            "motors without power before the last move",
            1,
            0,
            "",
            False,
            f"line {first}",
            "move M84 or M18 to the end of the file: an axis without power loses its place",
        )
    ]


def _output_checks(run: DryRun, printer: Printer) -> list[Check]:
    """A row for the first output that is set and isn't the profile's valve.

    What hangs on another output of a controller (a lamp, a heater, a brake, another valve) no
    profile tells.
    """
    head = printer.pneumatic
    own = [] if head is None else [output_of(head.opens), output_of(head.closes)]
    others = [
        named
        for named in run.named
        if named.name in (SETS_ARRAY, SETS_CALL) and (named.name, named.words) not in own
    ]
    if not others:
        return [Check(_OUTPUTS, 0, 0, "", True)]
    dispenser = "none" if head is None else f"{head.opens}, {head.closes}"
    return [
        Check(
            _OUTPUTS,
            len(others),
            0,
            "",
            False,
            f"line {others[0].line}",
            f"{_setting(others[0].words)}, and the profile's valve alone may be switched "
            f"(dispenser: {dispenser}); take it out, or name the valve in a copy of the profile",
        )
    ]


def _setting(words: Mapping[str, str]) -> str:
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
    for number, code, why in refused_lines(known, printer):
        by_code.setdefault(code, []).append((number, why))
    if not by_code:
        return [Check("commands that may not be sent", 0, 0, "", True)]
    return [
        Check(
            f"{code}: may not be sent by a job",
            len(those),
            0,
            "",
            False,
            f"line {those[0][0]}",
            those[0][1],
        )
        for code, those in by_code.items()
    ]
