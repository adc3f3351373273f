"""Judge manual commands typed during a print against the safety rules, just before sending."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

from firmware_profiles import Printer
from gcode.errors import LineError
from gcode.reading import BLANK, GcodeLine, read_line
from printctl.checks.gate import (
    AllowedLine,
    Bounds,
    Phase,
    PrinterSituation,
    Refusal,
    Verdict,
    changed_settings,
)
from printctl.machine.errors import Refused


def allowed_command(verdict: Verdict) -> AllowedLine:
    """Return what was allowed; raise `Refused` with the gate's reason else."""
    if isinstance(verdict, Refusal):
        raise Refused(verdict.message)
    return verdict


def paused_situation(
    limits: PrinterSituation, at: Mapping[str, float], clear_mm: float | None
) -> PrinterSituation:
    """Return what the gate judges by in a pause.

    ``at``: where the printer says that it stands; ``clear_mm``: the height above which nothing is.
    """
    if not {"X", "Y", "Z"} <= set(at):
        return replace(limits, phase=Phase.PAUSED, position=None)
    bounds = limits.bounds
    if bounds.trusted and bounds.needle_above_dish:
        bounds = replace(bounds, part_in_dish=True)  # what stands there holds a print
    else:  # what is unnamed may be anything
        bounds = Bounds(bounds.printer, trusted=True, needle=bounds.needle, clear_mm=clear_mm)
    place = at["X"], at["Y"], at["Z"]
    return replace(
        limits, bounds=bounds, phase=Phase.PAUSED, position=place, plunger_mm=at.get("E")
    )


def settings_changed_by(lines: Sequence[bytes], printer: Printer) -> tuple[str, ...]:
    """Return the settings of the firmware (codes) that lines of a job have changed."""
    others = {line for line in lines if not line.startswith((b"G0", b"G1"))}
    return changed_settings([_read(line, printer) for line in sorted(others)], printer)


def _read(line: bytes, printer: Printer) -> GcodeLine:
    try:
        return read_line(line, printer)
    except LineError:  # it was sent by a version that took it
        return BLANK
