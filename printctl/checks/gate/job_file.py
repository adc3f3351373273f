"""List the lines of a G-code job that the gate refuses, and the firmware settings it changes."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from firmware_profiles import Printer
from printctl.checks.gate.inputs import LineOrigin, PrinterSituation
from printctl.checks.gate.judge import judge_line
from printctl.checks.gate.verdict import Refusal, Verdict
from sim.gcode.reading import GcodeLine


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
