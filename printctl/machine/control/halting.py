"""Choose a firmware family's fastest safe halt commands; give how long its motors run on.

Marlin's ``kill`` (M112, thermal runaway) leaves its step interrupts on for 0.6 s, so that its
words get out: what the planner holds goes on being made. The wait is counted in the processor's
own time, of which each step event takes 47.5 µs. Measured on bugfix-2.1.x (ATmega2560): 0.64 s at
566 steps/s, 0.72 at 2825, 0.84 at 5634, 1.27 at 10,680. With the emergency parser M410 stops the
motors within a millisecond; moves are then dropped for 1 s, in which M112 isn't looked at. A line
that was waiting for the planner is let in after that second, and its first step comes 0.1 s later:
a second M410, sent meanwhile, drops it before. So M410, M410 and M112 at the end: no step after the
first. Heaters go off with M112. Of two lines in flight the second is let in a second after the
first and wants an M410 more, or it is made: a line across the part (seen on a real board).

Without emergency parser a line is looked at where the command queue has room, M410 as well as
M112, but its second would hold M112 up, with heaters on and moves let in: M112 alone.

A board that stood still meanwhile finds all of these at once, and looks at M112 first
(`Temperature::task`, bugfix-2.1.x): only one that said something in between has obeyed M410.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from firmware_profiles import Printer
from printctl.machine.families import link_facts
from printctl.machine.job.moves import MotorRunOn, unknown_run_on


@dataclass(frozen=True)
class Halting:
    """What is written, and what the motors do.

    Attributes
    ----------
    first : tuple of (bytes, float)
        Written before, and how long is waited behind each, s.
    last : bytes
        Written again and again until the printer has halted.
    stops_at_once : bool
        Whether the motors stand when the first has arrived.
    runs_on_s : float, s
        For how long they may go on where the firmware halts itself, or they don't stand, at the
        machine's greatest speed.
    """

    first: tuple[tuple[bytes, float], ...]
    last: bytes
    stops_at_once: bool = False
    runs_on_s: float = 0.0

    def told(self, run_on: MotorRunOn | None, stopped: bool) -> str:
        """Say what the motors did, or may have done.

        Parameters
        ----------
        run_on : MotorRunOn or None
            How far they may have run on; None where nobody knows what moved.
        stopped : bool
            Whether the printer lived between ``first`` and ``last``.
        """
        if self.stops_at_once and stopped:
            return "its motors were stopped before that, by M410"
        if not self.runs_on_s:
            return "what its motors did meanwhile isn't known"
        seconds = self.runs_on_s if run_on is None else run_on.seconds
        far = "" if run_on is None else f" ({run_on.path_mm:.1f} mm)"
        return (
            f"its motors may have run on for up to {math.ceil(seconds * 100) / 100:.2f} s after "
            f"that{far}: look where the needle is"
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
        return Halting((), kill, runs_on_s=unknown_run_on(printer))
    at_once = b"\n%b\n" % link.quickstop
    between = ((at_once, 1.0),) * (printer.lines_in_flight - 1)
    first = ((at_once, 0.5), *between, (at_once, 1.3))
    return Halting(first, kill, True, unknown_run_on(printer))
