"""Check a job's commands against the list of what may be sent to a printer."""

from __future__ import annotations

from firmware_profiles import Printer
from printctl.gate import refused_lines
from printctl.set_up.check import Check
from sim.dryrun import DryRun
from sim.firmware_codes import is_known_line
from sim.gcode_modal import MOVE


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


def gate_checks(run: DryRun, printer: Printer) -> list[Check]:
    """Rows for the codes that may not be sent; one that passed where all may be.

    What the firmware doesn't know at all has a row of its own (unknown commands).
    """
    if not printer.streamed:
        return []
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
