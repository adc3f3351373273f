"""Judge manual commands typed during a print against the safety rules, just before sending."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

from firmware_profiles import Printer
from firmware_profiles.families.position_reply import parse_position
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
from sim.errors import LineError
from sim.gcode.reading import BLANK, GcodeLine, read_line

Ask = Callable[[bytes], tuple[bytes, ...]]


def allowed_command(verdict: Verdict) -> AllowedLine:
    """Return what was allowed; raise `Refused` with the gate's reason else."""
    if isinstance(verdict, Refusal):
        raise Refused(verdict.message)
    return verdict


@dataclass
class PausedTip:
    """The tip in one pause, for the gate."""

    limits: PrinterSituation  # what the station knows, or the profile alone
    ask: Ask  # sends a command and returns the reply
    clear_mm: float | None = None  # the first height read, above which nothing stands

    def known(self) -> PrinterSituation:
        """Return the situation now; the printer is asked where it stands."""
        at = parse_position(self.ask(b"M114"))
        if not {"X", "Y", "Z"} <= set(at):
            return replace(self.limits, phase=Phase.PAUSED, position=None)
        self.clear_mm = at["Z"] if self.clear_mm is None else self.clear_mm
        bounds = self.limits.bounds
        if bounds.trusted and bounds.needle_above_dish:
            bounds = replace(bounds, part_in_dish=True)  # what stands there holds a print
        else:  # what is unnamed may be anything
            bounds = Bounds(
                bounds.printer, trusted=True, needle=bounds.needle, clear_mm=self.clear_mm
            )
        return replace(
            self.limits,
            bounds=bounds,
            phase=Phase.PAUSED,
            position=(at["X"], at["Y"], at["Z"]),
            plunger_mm=at.get("E"),
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
