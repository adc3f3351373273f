"""What Marlin's protocol sends: job lines and control commands, numbered, one or two in flight."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence

from firmware_profiles.families import link_protocol as said
from firmware_profiles.families.line_errors import LineErrors
from firmware_profiles.families.link_protocol import Event
from firmware_profiles.families.link_timing import Timing
from firmware_profiles.families.marlin.doubt import Phase
from firmware_profiles.families.marlin.pairing import Pairing
from firmware_profiles.families.marlin.replies import frame
from firmware_profiles.families.marlin.variant import Variant


class MarlinSender:
    """The sending half of `firmware_profiles.families.marlin.protocol.MarlinProtocol`.

    Parameters
    ----------
    timing : Timing
    pairing : Pairing, optional
        Lets two plain moves leave together; without, one line is in flight.
    variant : Variant
    """

    def __init__(self, timing: Timing | None, pairing: Pairing | None, variant: Variant) -> None:
        self.timing = timing or Timing()
        self.guard = variant.guard
        self.deadline = math.inf
        self.lines_done = self.number = 0
        self.held = self.keepalive = True
        self._pairing = pairing
        self._alone_until = 0
        self._lines: Sequence[bytes] = ()
        self.limit = 0
        self._phase = Phase.READY
        self._numbered = False
        self._controls: deque[bytes] = deque()
        self._control_numbers: dict[int, bytes] = {}
        self._flight: bytes | None = None
        self._flight_frame = b""
        self._flight_control = False
        self._second: bytes | None = None  # in flight behind it
        self._second_frame = b""
        self._fast = False
        self._rest = b""
        self._out: list[bytes] = []
        self._said: list[bytes] = []
        self._complaint = ""
        self.report = b""
        self._errors = LineErrors(self.timing.noise_window, self.timing.noise_limit)
        self._tokens = variant.make_tokens()
        self._awaiting: tuple[int, bytes] | None = None  # taken, its answer is still to come

    # --- what the streamer calls -----------------------------------------------------------

    @property
    def idle(self) -> bool:
        """Nothing is in flight and nothing is being asked."""
        return self._phase is Phase.READY

    @property
    def line_errors(self) -> int:
        """Lines sent again so far."""
        return self._errors.total

    def load(self, lines: Sequence[bytes], first: int, number: int) -> None:
        """Take a job; go on at line ``first``, the printer's last line being ``number``."""
        guard = self.guard
        self._lines = [guard(line) if line[:1] == b"M" else line for line in lines]
        self.limit = len(lines)
        self.lines_done, self.number = first, number
        self._numbered = True
        self._alone_until = 0
        self._control_numbers.clear()

    def submit(self, command: bytes, now: float) -> None:
        """Send a control command ahead of further job lines; `Replied` follows."""
        self._controls.append(self.guard(command))
        self.go(now)

    def go(self, now: float) -> None:
        """Send the next line if nothing is in flight."""
        if self._phase is Phase.READY:
            self._send_next(now)

    def take_output(self) -> bytes:
        """Give what must be written now, and forget it."""
        if not self._out:
            return b""
        data = self._out[0] if len(self._out) == 1 else b"".join(self._out)
        self._out.clear()
        return data

    # --- sending ---------------------------------------------------------------------------

    def _send_next(self, now: float) -> None:
        self._said, self._complaint = [], ""
        self._fast = False
        if self._second is not None:  # it is in flight already
            self._flight, self._flight_frame = self._second, self._second_frame
            self._second = None
            self._await_ok(now)
            self._fast = not self._rest
            return
        if self._controls:
            self._flight, self._flight_control = self._controls.popleft(), True
        elif not self.held and self.lines_done < self.limit:
            self._flight, self._flight_control = self._lines[self.lines_done], False
        else:
            self._flight, self._phase, self.deadline = None, Phase.READY, math.inf
            return
        self._flight_frame = frame(self.number + 1, self._flight)
        clear = not self._flight_control and not self._tokens.suspect
        if self._pairing is not None and clear:
            self._take_along(self._pairing, self._flight)
        self._fly(now)
        self._fast = clear and not self._rest

    def _take_along(self, pairing: Pairing, first: bytes) -> None:
        """Let the next job line leave together with ``first`` where that is allowed."""
        after = self.lines_done + 1
        if after < self.limit and self.number >= self._alone_until:
            second = self._lines[after]
            framed = frame(self.number + 2, second)
            if pairing.allows(first, second, len(self._flight_frame) + len(framed)):
                self._second, self._second_frame = second, framed

    def _fly(self, now: float) -> None:
        """Write what is in flight, in one piece."""
        self._out.append(self._flight_frame)
        if self._second is not None:
            self._out.append(self._second_frame)
        self._await_ok(now)

    def _await_ok(self, now: float) -> None:
        self._phase, self.deadline = Phase.FLIGHT, now + self.timing.silence_s

    def _count_taken(self, events: list[Event]) -> None:
        """Note that the line in flight was taken and answered."""
        self._count_flight()
        self._answer(events)

    def _count_flight(self) -> None:
        """Note that the line in flight was taken; a control command's answer is still to come."""
        self.number += 1
        if self._tokens.flying:
            self._tokens.numbers.add(self.number)
        elif self._flight_control:
            command = self._flight or b""
            self._control_numbers[self.number] = command
            self._awaiting = self.number, command
        else:
            self.lines_done += 1

    def _answer(self, events: list[Event]) -> None:
        """Hand over what was said to a control command: all of it was heard."""
        if self._awaiting is not None:
            number, command = self._awaiting
            events.append(said.Replied(command, number, tuple(self._said)))
            self._awaiting = None

    def _acknowledge(self, now: float, events: list[Event]) -> None:
        """Go on from an ok; in doubt it is only believed once a token has come back."""
        if self._tokens.suspect:
            self._tokens.heard += 1
            self._owe(now, events)
            return
        self._count_taken(events)
        self._send_next(now)

    def _owe(self, now: float, events: list[Event]) -> None:
        """Count the line in flight as taken, whose ok may have come or not; send a token."""
        self._count_flight()
        self._tokens.owed += 1
        if self._controls:  # sent again, under numbers that are written down already
            self._send_next(now)
        else:
            self._send_token(now, events)

    def _send_token(self, now: float, events: list[Event]) -> None:
        number = self.number + 1
        command = self._tokens.make(number, now)
        self._flight, self._flight_control = self.guard(command), True
        self._flight_frame = frame(number, self._flight)
        self._fast = False
        events.append(said.TokenSent(number, command))
        self._fly(now)
