"""RepRapFirmware link protocol: CRC-16 lines, position asked after silence; untested on hardware.

Facts (RepRapFirmware `StringParser.cpp`, 3.x): with ``N`` in front a line is checked, by an XOR of
one to three digits or a CRC-16 of five; one that fails is dropped without a word, neither ok nor
resend; the order of numbers isn't looked at, so that a line sent twice is done twice. The line
number that M409 tells is stored before the check, so it is no evidence of what was done.

What is evidence: the position. After silence M400 and M114 are sent behind the line in flight.
Lines are worked on in turn, so the answer, whenever it comes, is of a time when that line's fate
was sealed. Where its end is, it was taken; where the line before it ended, it was not and is sent
again; elsewhere, ask again, and end the print where the answer stays the same. Where the line
changes no position, it is sent again if doing it twice is doing it once (temperatures, modes, a
move to where the needle is), else the print ends: nobody knows. Silence alone is never followed by
a repeat.

The five digits of the CRC-16 find what the XOR lets through. A line cut in two by noise is done
half by half, unless the board is told to want a checksum (M575 P0 S1); USB has a CRC of its own.
"""

from __future__ import annotations

import re
from typing import Final

from firmware_profiles.families import link_protocol as said
from firmware_profiles.families.ack_protocol import AckProtocol, Sort
from firmware_profiles.families.known_messages import load_messages
from firmware_profiles.families.link_protocol import Event, Places
from firmware_profiles.families.link_timing import Timing
from firmware_profiles.families.position_reply import parse_position
from firmware_profiles.families.reprapfirmware.crc16 import crc16

QUESTION: Final = (b"M400", b"M114")
_SURE: Final = 3
WITHIN_MM: Final = 0.0016
"""M114 has three decimals, of a 32-bit float."""
_HARMLESS: Final = frozenset(
    b"G0 G1 G4 G21 G90 G92 M42 M82 M84 M85 M92 M104 M105 M106 M107 M109 M114 M115 M116 M140 M190"
    b" M191 M200 M201 M203 M204 M220 M221 M302 M400".split()
)
"""Done twice is done once, where no position changes (a dwell is only longer)."""
_WORD: Final = re.compile(rb"([GM])0*(\d+)(?![.\d])")


def _harmless(command: bytes) -> bool:
    match = _WORD.match(command)
    return match is not None and match[1] + match[2] in _HARMLESS


class RrfProtocol(AckProtocol):
    """See the module.

    Parameters
    ----------
    places : callable
        Where the job's text says needle and plunger are after so many lines.
    timing : Timing
    """

    messages = load_messages("reprapfirmware")
    error_starts = (b"Error:", b"Warning:", b"Emergency Stop", b"Printer halted")

    def __init__(self, places: Places, timing: Timing | None = None) -> None:
        super().__init__(timing)
        self._places = places
        self._asking = False
        self._position: dict[str, float] = {}
        self._elsewhere: dict[str, float] = {}
        self._told = 0

    def frame(self, number: int, command: bytes) -> bytes:
        """``N<number> <command>*<CRC-16 in five digits>`` and line end."""
        body = b"N%d %b" % (number, command)
        return b"%b*%05d\n" % (body, crc16(body))

    def sort(self, text: bytes) -> Sort:
        """Tell what a line from the printer is."""
        return self.sort_known(text)

    def fly(self, now: float) -> None:
        """Write the line in flight for the first time."""
        self._asking, self._told = False, 0
        super().fly(now)

    # --- doubt -----------------------------------------------------------------------------

    def on_silence(self, now: float, events: list[Event]) -> None:
        """Ask where the printer is, or settle by its answer."""
        if self.probing:
            self._send_again(now, events)
            return
        if self._asking and self._position:
            self._settle(now, events)
            return
        self._asking = True
        self.out += [self.frame(self.number + 2 + k, text) for k, text in enumerate(QUESTION)]
        self.deadline = now + 4 * self.timing.answer_s

    def hear(self, text: bytes, now: float, events: list[Event]) -> None:
        """Take one line from the printer; while it is asked, its position counts."""
        sort = self.sort(text)
        if not self._asking or sort not in (Sort.OK, Sort.TEXT):
            super().hear(text, now, events)
            return
        if sort is Sort.OK:
            self.heard.extend(() if text == b"ok" else (text,))
        elif position := parse_position((text,)):
            self._position = position
        else:
            super().hear(text, now, events)
        if self._position:
            self.deadline = now + self.timing.quiet_s

    def _settle(self, now: float, events: list[Event]) -> None:
        """Decide whether the line in flight was taken: the printer has answered and is quiet."""
        position, self._position = self._position, {}
        self._asking = False
        after, before = (self._there(position, self.lines_done + k) for k in (1, 0))
        if self.in_job and after and not before:
            events.append(said.Notice(f"the ok to line {self.number + 1} was lost"))
            self.acknowledge(now, events)
        elif self.in_job and not after and not before:
            self._is_elsewhere(position, now, events)
        elif (self.in_job and not after) or _harmless(self.flight or b""):
            self._send_again(now, events)
        else:
            self.end(said.NoReply(now - self.sent_at), events)

    def _is_elsewhere(self, position: dict[str, float], now: float, events: list[Event]) -> None:
        """Ask again; a place told `_SURE` times running is where it is, and not the job's.

        A board that was reset says nothing of it, but stands at 0 in X, Y and Z.
        """
        self._told = self._told + 1 if position == self._elsewhere else 1
        self._elsewhere = position
        if self._told < _SURE:
            self.on_silence(now, events)
        elif any(position.get(axis, 0.0) for axis in "XYZ"):
            self.end(said.NoReply(now - self.sent_at), events)
        else:
            self.end(said.FirmwareReset(), events)

    def _there(self, position: dict[str, float], done: int) -> bool:
        return all(
            axis not in position or abs(position[axis] - value) <= WITHIN_MM
            for axis, value in self._places(self.lines, done).items()
        )

    def _send_again(self, now: float, events: list[Event]) -> None:
        noisy = self.errors.count(self.number)
        if noisy:
            events.append(noisy)
        self.repeat(now)
