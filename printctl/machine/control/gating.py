"""Judge manual commands typed during a print against the safety rules, just before sending."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

from firmware_profiles import Printer
from firmware_profiles.families.position_reply import parse_position
from printctl.checks.gate import (
    AllowedLine,
    Bounds,
    LineOrigin,
    Phase,
    PrinterSituation,
    Refusal,
    Verdict,
    changed_settings,
    judge,
)
from printctl.machine.errors import Refused
from sim.errors import LineError
from sim.gcode.reading import BLANK, GcodeLine, read_line

Ask = Callable[[bytes], tuple[bytes, ...]]


@dataclass(frozen=True)
class Manual:
    """A command between two lines of the job.

    Attributes
    ----------
    text : str
    done : callable
        Told what the printer says to it.
    refused : callable or None
        Told why it wasn't sent; None for a command of the product's own, which isn't judged.
    """

    text: str
    done: Callable[[tuple[bytes, ...]], None]
    refused: Callable[[str], None] | None = None


def allowed_command(verdict: Verdict) -> AllowedLine:
    """Return what was allowed.

    Raises
    ------
    Refused
        With the gate's reason.
    """
    if isinstance(verdict, Refusal):
        raise Refused(verdict.message)
    return verdict


class PausedTip:
    """What the gate is told of the tip in one pause.

    Parameters
    ----------
    limits : PrinterSituation
        What the station knows, or the profile alone.
    ask : callable
        Sends a command and gives the printer's reply.
    """

    def __init__(self, limits: PrinterSituation, ask: Ask) -> None:
        self._limits, self._ask = limits, ask
        self._clear_mm: float | None = None

    def known(self) -> PrinterSituation:
        """The moment; the printer is asked where it stands."""
        at = parse_position(self._ask(b"M114"))
        if not {"X", "Y", "Z"} <= set(at):
            return replace(self._limits, phase=Phase.PAUSED, position=None)
        self._clear_mm = at["Z"] if self._clear_mm is None else self._clear_mm
        return replace(
            self._limits,
            bounds=self._bounds(self._limits.bounds, self._clear_mm),
            phase=Phase.PAUSED,
            position=(at["X"], at["Y"], at["Z"]),
            plunger_mm=at.get("E"),
        )

    @staticmethod
    def _bounds(bounds: Bounds, clear_mm: float) -> Bounds:
        """What stands there holds a print; what nobody named may be anything."""
        if bounds.trusted and bounds.needle_above_dish:
            return replace(bounds, part_in_dish=True)
        return Bounds(bounds.printer, trusted=True, needle=bounds.needle, clear_mm=clear_mm)


def judge_typed(text: str, known: PrinterSituation) -> Verdict:
    """Judge what a person typed into a print."""
    return judge(text, LineOrigin.CONSOLE, known)


def settings_changed_by(lines: Sequence[bytes], printer: Printer) -> tuple[str, ...]:
    """Settings of the firmware (codes) that lines of a job have changed."""
    others = {line for line in lines if not line.startswith((b"G0", b"G1"))}
    return changed_settings([_read(line, printer) for line in sorted(others)], printer)


def _read(line: bytes, printer: Printer) -> GcodeLine:
    try:
        return read_line(line, printer)
    except LineError:  # it was sent by a version that took it
        return BLANK
