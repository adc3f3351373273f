"""Klipper link protocol: one plain line until its ok, no resends; untested on hardware.

Facts (Klipper `klippy/gcode.py`, version of 2025): a line number is skipped and a checksum taken
off unchecked; each line gets an ``ok``, after ``!! <why>`` where the command failed and after
``// Unknown command`` where there is no such command; M112 is looked for in what waits as well;
``// Klipper state: Shutdown`` says that it has stopped for good, ``Ready`` that it has started.
Why it has stopped it says when it is asked (``STATUS``): lines with ``//``, the first again after
``!!``. One that has stopped already answers each command by its reason and ``// Printer is
shutdown`` (klippy of 2026-08, tried on a real one).

The terminal is on the machine that runs Klipper: no noise. Klipper says nothing while it is busy;
a bridge to the terminal may lose bytes. A long wire in between (a bridge over UART) isn't safe, as
nothing would find a flipped bit. After a crash of the host there is no asking which line was
taken last.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Final

from firmware_profiles.families import link_protocol as said
from firmware_profiles.families.ack_protocol import AckProtocol, Sort, nowhere
from firmware_profiles.families.known_messages import load_messages
from firmware_profiles.families.link_protocol import Event, Places
from firmware_profiles.families.timing import Timing

_REASON_S: Final = 3.0
"""For so long the reason of a shutdown is waited for: it came 1.5 s late."""
_STATUS: Final = b"STATUS"
_NO_REASON: Final = re.compile(rb"// (Klipper state|Printer is (shutdown|halted))")


class KlipperProtocol(AckProtocol):
    """See the module."""

    messages = load_messages("klipper")
    error_starts = (b"!!", b"//")

    def __init__(self, places: Places = nowhere, timing: Timing | None = None) -> None:
        super().__init__(places, timing)
        self._halted = self._reason = ""

    def frame(self, number: int, command: bytes) -> bytes:
        """The command and a line end: a number or checksum would be ignored."""
        return command + b"\n"

    def sort(self, text: bytes) -> Sort:
        """Tell what a line from the printer is."""
        if text.startswith(b"// Klipper state: Ready"):
            return Sort.RESTART
        return self.sort_known(text)

    def tick(self, now: float) -> Sequence[Event]:
        """Take notice that it is ``now`` and nothing has come."""
        if not self._halted or now < self.deadline:
            return super().tick(now)
        events: list[Event] = []
        self._tell_reason(self._reason, events)
        return events

    def _tell_reason(self, reason: str, events: list[Event]) -> None:
        """End with why it has stopped; empty where it doesn't say."""
        self.end(
            said.FirmwareHalted(f"{self._halted}: {reason}" if reason else self._halted), events
        )

    def hear(self, text: bytes, now: float, events: list[Event]) -> None:
        """Hear a line; after a shutdown its reason alone is waited for, nothing else leaves."""
        words = text.decode("ascii", "backslashreplace")
        if self._halted:
            if text.startswith(b"!!"):
                self._tell_reason(words[2:].strip(), events)
            elif text.startswith(b"//") and not _NO_REASON.match(text):
                self._reason = self._reason or words[2:].strip()
        elif self.sort(text) is Sort.HALT:
            self._halted, self.held = words, True
            self.flight, self.in_job = _STATUS, False
            self.out.clear()  # a line of the job that hasn't left yet stays here
            self.out.append(self.frame(self.number + 1, _STATUS))
            self.deadline = now + _REASON_S
            events.append(said.Halting(words))
        else:
            super().hear(text, now, events)
