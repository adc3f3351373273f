"""Marlin's serial protocol (1.1 to 2.1): numbered lines, resends, finding the last line taken.

Every line, manual commands too, is ``N<number> <command>*<xor>``. The printer takes line N only
after line N-1, so lines can be neither doubled nor swapped by sending one again; what remains is
to know which line was taken last. An ``ok`` to the line in flight says so. Anything else (a
``Resend``, an unknown-command echo, a garbled reply, silence) is only a reason to ask:

1. **drain**: wait until nothing has come for ``quiet_s``, so that no reply is under way;
2. **ask**: send a line whose number is far too high. It can't be executed. Marlin answers at
   once, even while its planner is full, with ``Last Line: L`` and ``Resend: L+1``; both must be
   there and agree, else ask again;
3. **settle**: again ``quiet_s`` of silence, which takes the trailing ok and any fragment's ok;
4. go on from L: send the line in flight again if L is the one before it; count it as taken if L
   is its own number. Any other L must be confirmed by a second answer;
5. **token** (`tokens.py`): an ok of before may come at any later time. So behind
   the line in question a text is sent that must come back, and only the ok behind its echo is
   believed again. It decides when a line is *answered*; no time limit does.

Two plain moves may be in flight (`pairing.py` says when, and why that is safe). In
doubt L then is the line before them, the first or the second; what wasn't taken is sent again,
alone.

``M110`` without N would answer ``Line: L`` as well (`conf_avr.txt`), but travels without checksum,
and one flipped bit makes it M112, a halt.

Nothing is ever sent while an error reply may be under way: Marlin empties its receive buffer when
it reports one, and would run the rest of a half-received line unverified.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from functools import reduce
from operator import xor
from typing import Final

from firmware_profiles.families.link_protocol import Event
from firmware_profiles.families.marlin.doubt_resolver import DoubtResolver
from firmware_profiles.families.marlin.replies import Tokens, classify
from firmware_profiles.families.marlin.reply_handler import ReplyHandler
from firmware_profiles.families.marlin.sender import Sender, guard_command
from firmware_profiles.families.marlin.state import RENUMBER, LineState, Phase, QueryGoal, Questions
from firmware_profiles.families.pairing import Pairing
from firmware_profiles.families.timing import HOST_LATE_S, LineErrors, Timing

_REST_LIMIT: Final = 4096
_ARC: Final = re.compile(rb"G0*[23](?!\d)")


class MarlinProtocol:
    """State machine for one printer; see the module, and `link_protocol.py` for the seam.

    Parameters
    ----------
    timing : Timing
    pairing : Pairing, optional
        Lets two plain moves leave together; without, one line is in flight.
    """

    kill_bytes: bytes = b"\nM112\n"

    def __init__(self, timing: Timing | None = None, pairing: Pairing | None = None) -> None:
        timing = timing or Timing()
        errors = LineErrors(timing.noise_window, timing.noise_limit)
        questions = Questions(timing.doubt_limit_s)
        self.state = LineState(timing, pairing, errors, Tokens(), questions)
        self._sender = Sender(self.state)
        self._doubting = DoubtResolver(self.state, self._sender)
        self._hearing = ReplyHandler(self.state, self._sender, self._doubting)
        self._on_time = {
            Phase.READY: self._sender.prove,
            Phase.FLIGHT: self._doubting.silence,
            Phase.DRAIN: self._doubting.ask_now,
            Phase.ASK: self._doubting.unanswered,
            Phase.SETTLE: self._doubting.settled,
        }

    # --- what the streamer reads and sets ----------------------------------------------------

    @property
    def timing(self) -> Timing:
        """Its time limits."""
        return self.state.timing

    @property
    def deadline(self) -> float:
        """When `tick` is due, s."""
        return self.state.deadline

    @property
    def lines_done(self) -> int:
        """Job lines known to be taken."""
        return self.state.lines_done

    @property
    def number(self) -> int:
        """Line number known to be taken last."""
        return self.state.number

    @property
    def report(self) -> bytes:
        """Temperatures as they were told last."""
        return self.state.report

    @property
    def held(self) -> bool:
        """Whether no further job line is sent."""
        return self.state.held

    @held.setter
    def held(self, held: bool) -> None:
        self.state.held = held
        self.state.faulty &= held

    @property
    def limit(self) -> int:
        """Job lines that may be sent."""
        return self.state.limit

    @limit.setter
    def limit(self, limit: int) -> None:
        self.state.limit = limit

    @property
    def keepalive(self) -> bool:
        """Whether the firmware says that it is busy."""
        return self.state.keepalive

    @keepalive.setter
    def keepalive(self, keepalive: bool) -> None:
        self.state.keepalive = keepalive

    @property
    def idle(self) -> bool:
        """Nothing is in flight and nothing is being asked."""
        return self.state.phase is Phase.READY and self.state.second is None

    @property
    def line_errors(self) -> int:
        """Lines sent again so far."""
        return self.state.errors.total

    # --- what the streamer calls -------------------------------------------------------------

    def load(self, lines: Sequence[bytes], first: int, number: int) -> None:
        """Take a job; go on at line ``first``, the printer's last line being ``number``."""
        state = self.state
        self.grow(lines)
        state.lines_done, state.number = first, number
        state.numbered = True
        state.alone_until = 0
        state.control_numbers.clear()

    def grow(self, lines: Sequence[bytes]) -> None:
        """Take a job that has got lines behind those that were taken; nothing may be in flight."""
        state = self.state
        state.lines = [guard_command(line) if line[:1] == b"M" else line for line in lines]
        state.limit = len(lines)

    def renumber(self, now: float) -> None:
        """Set the printer's last line to 0; `Synchronised` follows, or an error event."""
        self.state.out.append(RENUMBER)
        self.state.begin_doubt(QueryGoal.RENUMBER, now)

    def ask(self, now: float) -> None:
        """Ask which line was taken last; `Synchronised` follows, or an error event."""
        self.state.begin_doubt(QueryGoal.GO_ON if self.state.numbered else QueryGoal.NUMBER, now)

    def confirm(self, now: float) -> None:
        """Have a token come back from behind all that was sent; `Synchronised` follows."""
        self.state.confirming, self.state.deadline = True, now

    def cut_in(self, commands: Sequence[bytes], again: bool, now: float) -> bool:
        """Write commands past the line in flight; no ok is believed until a token came back.

        In a doubt they may be lost: an error empties the receive buffer of a firmware without
        emergency parser. Whoever wrote them writes them again. Not while an arc is in flight:
        Marlin makes its pieces in a loop that M410 doesn't end, so that a second later the needle
        would cut across to a further point of it (seen on the real one).
        """
        state = self.state
        if not commands:
            if state.phase is Phase.FLIGHT:
                state.deadline = now
            return False
        if state.phase in (Phase.READY, Phase.OVER):
            return False
        if any(line and _ARC.match(line) for line in (state.flight, state.second)):
            state.held, state.fast = True, False
            return False
        self._sender.let_second_go()
        state.out.append(b"\n%b\n" % b"\n".join(commands))
        state.tokens.expect(len(commands))
        state.behind_moves = b"\n%b\n" % commands[-1] if again else b""
        state.fast = False
        if state.phase is Phase.FLIGHT:
            state.deadline = now + state.timing.silence_s
        return True

    def submit(self, command: bytes, now: float) -> None:
        """Send a control command ahead of further job lines; `Replied` follows."""
        self.state.behind_moves = b""
        self.state.controls.append(guard_command(command))
        self.go(now)

    def go(self, now: float) -> None:
        """Send the next line if nothing is in flight."""
        if self.state.phase is Phase.READY:
            self._sender.send_next(now)

    def take_output(self) -> bytes:
        """Give what must be written now, and forget it."""
        out = self.state.out
        if not out:
            return b""
        data = out[0] if len(out) == 1 else b"".join(out)
        out.clear()
        return data

    def feed(self, data: bytes, now: float) -> Sequence[Event]:
        """Take what the printer said."""
        state = self.state
        if state.fast and data == b"ok\n":  # nearly every line of a print goes this way
            self._take_ok(now)
            return ()
        events: list[Event] = []
        *texts, state.rest = (state.rest + data).split(b"\n")
        if len(state.rest) > _REST_LIMIT:
            texts, state.rest = [*texts, state.rest], b""
        state.fast = False
        if state.rest and state.phase in (Phase.DRAIN, Phase.SETTLE):
            state.deadline = now + state.timing.quiet_s
        replies = [classify(text.strip(b"\r")) for text in texts if text.strip()]
        self._hearing.hear_all(replies, now, events)
        if state.rest.startswith(b"ok") and state.phase is Phase.FLIGHT:  # its line end is garbled
            state.deadline = min(state.deadline, now + state.timing.whole_s)
        return events

    def _take_ok(self, now: float) -> None:
        """Count the job line in flight as taken, and send the next."""
        state = self.state
        state.number = number = state.number + 1
        state.lines_done = done = state.lines_done + 1
        alone = state.pairing is None
        if alone and done < state.limit and not state.held and not state.controls:
            state.flight = command = state.lines[done]
            body = b"N%d %b" % (number + 1, command)
            state.flight_frame = line = b"%b*%d\n" % (body, reduce(xor, body))
            state.out.append(line)
            state.deadline = now + state.timing.silence_s
        else:
            self._sender.send_next(now)

    def tick(self, now: float) -> Sequence[Event]:
        """Take notice that it is ``now`` and nothing has come."""
        if now < self.state.deadline:
            return ()
        events: list[Event] = []
        self.state.fast = False
        self._hearing.take_half(now, events)
        if self.state.phase is not Phase.OVER:
            if now - self.state.deadline > HOST_LATE_S:
                self.state.doubt.since += now - self.state.deadline
            self._on_time[self.state.phase](now, events)
        return events
