"""The quickest safe way to halt each firmware family, and what its motors do meanwhile.

Marlin's ``kill`` (M112, thermal runaway) leaves its step interrupts on for 0.6 s, so that its
words get out: what the planner holds goes on being made. Measured on bugfix-2.1.x: 0.47 to 0.67 s,
12.9 mm of X. With the emergency parser M410 stops the motors within a millisecond; moves are then
dropped for 1 s, in which M112 isn't looked at. A line that was waiting for the planner is let in
after that second, and its first step comes 0.1 s later: a second M410, sent meanwhile, drops it
before. So M410, M410 and M112 at the end: no step after the first. Heaters go off with M112.

Without emergency parser a line is looked at where the command queue has room, M410 as well as
M112, but its second would hold M112 up, with heaters on and moves let in: M112 alone.
"""

from __future__ import annotations

from dataclasses import dataclass

from firmware_profiles import Printer
from printctl.link.families import link_facts


@dataclass(frozen=True)
class Halting:
    """What is written, and what the motors do.

    Attributes
    ----------
    first : tuple of (bytes, float)
        Written before, and how long is waited behind each, s.
    last : bytes
        Written again and again until the printer has halted.
    words : str
        What it is, for a message.
    stops_at_once : bool
        Whether the motors stand when the first has arrived.
    runs_on_s : float, s
        For how long they may go on where the firmware halts itself, or they don't stand.
    """

    first: tuple[tuple[bytes, float], ...]
    last: bytes
    words: str = "M112"
    stops_at_once: bool = False
    runs_on_s: float = 0.0

    def told(self, speed_mm_s: float, by_itself: bool = False) -> str:
        """Say what the motors did, or may have done at such a speed of the needle."""
        if self.stops_at_once and not by_itself:
            return "its motors were stopped before that, by M410"
        if not self.runs_on_s:
            return "what its motors did meanwhile isn't known"
        return (
            f"its motors may have run on for up to {self.runs_on_s:.2g} s "
            f"({self.runs_on_s * speed_mm_s:.1f} mm at {speed_mm_s:g} mm/s): "
            "look where the needle is"
        )


def halting_of(printer: Printer, kill: bytes, emergency_parser: bool) -> Halting:
    """The way for a printer.

    Parameters
    ----------
    printer : Printer
    kill : bytes
        What halts its firmware.
    emergency_parser : bool
        Whether it looks at M410 and M112 at once: what it says of itself, else its profile.
    """
    link = link_facts(printer)
    if not link.quickstop or not emergency_parser:
        return Halting((), kill, runs_on_s=link.run_on_s)
    first = ((link.quickstop, 0.5), (link.quickstop, 1.3))
    return Halting(first, kill, "M410 and M112", stops_at_once=True, runs_on_s=link.run_on_s)
