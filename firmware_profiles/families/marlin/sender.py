"""Sending part of Marlin's link protocol: numbered lines, one or two in flight."""

from __future__ import annotations

import math
import re
from typing import Final

from firmware_profiles.families import link_protocol as said
from firmware_profiles.families.link_protocol import Event
from firmware_profiles.families.marlin.replies import TRIES, frame
from firmware_profiles.families.marlin.state import LineState, Phase, QueryGoal
from firmware_profiles.families.pairing import Pairing


class Sender:
    """The sending part of `firmware_profiles.families.marlin.protocol.MarlinProtocol`.

    Parameters
    ----------
    state : LineState
    """

    def __init__(self, state: LineState) -> None:
        self._state = state

    def send_next(self, now: float) -> None:
        """Send a control command, or the next line where the job isn't held."""
        state = self._state
        state.said, state.complaint = [], ""
        state.fast = False
        if state.second is not None:  # it is in flight already
            self._go_on_with_second(now)
            return
        if state.controls and not state.waits:
            state.flight, state.flight_control = state.controls.popleft(), True
        elif not state.held and not state.waits and state.lines_done < state.limit:
            state.flight, state.flight_control = state.lines[state.lines_done], False
        else:
            self._rest(now)
            return
        state.behind_job = not state.flight_control
        state.flight_frame = frame(state.number + 1, state.flight)
        clear = not state.flight_control and not state.tokens.suspect
        if state.pairing is not None and clear:
            self._take_along(state.pairing, state.flight)
        self.fly(now)
        state.fast = clear and not state.rest

    def _rest(self, now: float) -> None:
        """Send nothing for now."""
        state = self._state
        state.flight, state.phase = None, Phase.READY
        # whatever comes behind a token ends the line that a read has cut
        state.deadline = now + state.timing.whole_s if self._is_kept else math.inf

    def _go_on_with_second(self, now: float) -> None:
        """Let the second line be the one in flight, and another follow where that is allowed."""
        state = self._state
        if state.refusing:
            state.flight = None
            state.begin_doubt(QueryGoal.GO_ON, now)
            return
        if state.withheld and state.waits:
            self._rest(now)
            return
        state.flight, state.flight_frame = state.second, state.second_frame
        state.second = None
        if state.withheld:
            state.out.append(state.withheld)
            state.withheld, state.flight_control, state.behind_job = b"", False, True
            may = not (state.controls or state.held or state.tokens.suspect)
            if state.pairing is not None and state.flight is not None and may:
                self._take_along(state.pairing, state.flight)
                self._write_second()
        self._await_ok(now)
        state.fast = not (state.rest or state.tokens.suspect)

    def let_second_go(self) -> None:
        """Write the rest of the second line, unless it is to be refused."""
        state = self._state
        if state.refusing:
            state.refuse_second()
        elif state.withheld:
            state.out.append(state.withheld)
            state.withheld = b""

    @property
    def _is_kept(self) -> bool:
        """Whether something would leave, were a line from the printer not cut by a read."""
        state = self._state
        more = state.second is not None or bool(state.controls)
        more = more or (not state.held and state.lines_done < state.limit)
        return more and bool(state.rest)

    def _take_along(self, pairing: Pairing, first: bytes) -> None:
        """Let the next job line leave together with ``first`` where that is allowed."""
        state = self._state
        after = state.lines_done + 1
        if after < state.limit and state.number >= state.alone_until:
            second = state.lines[after]
            framed = frame(state.number + 2, second)
            if pairing.allows(first, second, len(state.flight_frame) + len(framed)):
                state.second, state.second_frame = second, framed
                count = pairing.withheld(framed)
                state.withheld = framed[-count:] if count else b""

    def fly(self, now: float) -> None:
        """Write what is in flight, in one piece."""
        state = self._state
        state.out.append(state.flight_frame)
        self._write_second()
        self._await_ok(now)

    def _write_second(self) -> None:
        state = self._state
        if state.second is not None:
            state.out.append(state.second_frame.removesuffix(state.withheld))

    def _await_ok(self, now: float) -> None:
        state = self._state
        state.phase, state.deadline = Phase.FLIGHT, now + state.timing.silence_s

    def _count_taken(self, events: list[Event]) -> None:
        """Note that the line in flight was taken and answered."""
        self.count_flight()
        self.answer(events)

    def count_flight(self) -> None:
        """Note that the line in flight was taken; a control command's answer is still to come."""
        state = self._state
        state.number += 1
        if state.tokens.flying:
            state.tokens.numbers.add(state.number)
        elif state.flight_control:
            command = state.flight or b""
            state.control_numbers[state.number] = command
            state.awaiting = state.number, command
        else:
            state.lines_done += 1

    def answer(self, events: list[Event]) -> None:
        """Hand over what was said to a control command: all of it was heard."""
        state = self._state
        if state.awaiting is not None:
            number, command = state.awaiting
            events.append(said.CommandReplied(command, number, tuple(state.said)))
            state.awaiting = None

    def acknowledge(self, now: float, events: list[Event]) -> None:
        """Go on from an ok; in doubt it is only believed once a token has come back."""
        state = self._state
        if state.tokens.suspect:
            state.tokens.heard += 1
            self.owe(now, events)
            return
        self._count_taken(events)
        self.send_next(now)

    def owe(self, now: float, events: list[Event]) -> None:
        """Count the line in flight as taken, whose ok may have come or not; send a token."""
        state = self._state
        if state.behind_moves and (state.flight or b"")[:1] == b"G":
            state.out.append(state.behind_moves)
            state.tokens.expect(1)
        self.count_flight()
        state.tokens.owed += 1
        # controls: sent again, under numbers that are written down already; not behind a token
        # whose echo was garbled, which another one has to follow first
        if not state.tokens.flying and (state.controls or state.second is not None):
            self.send_next(now)
        else:
            self.send_token(now, events)

    def prove(self, now: float, events: list[Event]) -> None:
        """Send a token with nothing in flight; a line without its end goes again later."""
        self._state.refuse_second()
        self.send_token(now, events)

    def send_token(self, now: float, events: list[Event]) -> None:
        """Send a token, unless so many were lost that the firmware can't know them."""
        state = self._state
        if state.tokens.tries >= TRIES:
            state.end(said.NoReply(now - state.doubt.since), events)
            return
        number = state.number + 1
        command = state.tokens.make(number, now)
        state.flight, state.flight_control = guard_command(command), True
        state.behind_job = False
        state.flight_frame = frame(number, state.flight)
        state.fast = False
        events.append(said.TokenSent(number, command))
        self.fly(now)


# Marlin's emergency parser reads the raw bytes, before any checksum: ``M113`` with one bit flipped
# is ``M112``, a halt, and ``M400`` is ``M410``, which throws away what the planner holds. And a
# line in which ``M110`` stands may have any number: an ``M114`` that becomes one, with a second
# flip that its checksum doesn't show, renumbers. A zero before the digits (``M0113``) leaves the
# command what it is and puts each of these two flips further away.
_FEARED: Final = (b"110", b"112", b"410")
_LONGEST: Final = 40
"""Bytes; a longer line (a text for a display) is left alone, it might outgrow the firmware's."""
_CODE: Final = re.compile(rb"M(\d{3})(?!\d)")


def guard_command(command: bytes) -> bytes:
    """The command, its number with a zero before where one flipped bit would make it a stop."""
    match = _CODE.match(command)
    if match is None or len(command) > _LONGEST or match[1] in _FEARED:
        return command
    near = any(_flips(match[1], feared) == 1 for feared in _FEARED)
    return b"M0" + command[1:] if near else command


def _flips(one: bytes, other: bytes) -> int:
    return sum((a ^ b).bit_count() for a, b in zip(one, other, strict=True))
