"""Marlin 1.1 to 2.1: a numbered line in flight, or two, and one way out of every doubt.

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

import math
from collections.abc import Callable, Sequence
from functools import reduce
from operator import xor
from typing import Final

from firmware_profiles.families import link_protocol as said
from firmware_profiles.families.link_protocol import Event
from firmware_profiles.families.link_timing import Timing
from firmware_profiles.families.marlin.doubt import QUESTION, RENUMBER, Doubt, Goal, Phase
from firmware_profiles.families.marlin.pairing import Pairing
from firmware_profiles.families.marlin.replies import Kind, Reply
from firmware_profiles.families.marlin.sender import MarlinSender
from firmware_profiles.families.marlin.tokens import MOST_DOUBLINGS, PATIENCE_S, TRIES
from firmware_profiles.families.marlin.variant import Variant

_MEMORY: Final = 8
_QUICK: Final = 10
"""Questions after which they are asked less often."""
_SLOWLY: Final = 5
_REST_LIMIT: Final = 4096

__all__ = ["QUESTION", "RENUMBER", "MarlinProtocol", "Timing"]


class MarlinProtocol(MarlinSender):
    """State machine for one printer; see the module, and `link_protocol.py` for the seam.

    Parameters
    ----------
    timing : Timing
    pairing : Pairing, optional
        Lets two plain moves leave together; without, one line is in flight.
    variant : Variant, optional
        Of a firmware that isn't Marlin itself.
    """

    def __init__(
        self,
        timing: Timing | None = None,
        pairing: Pairing | None = None,
        variant: Variant | None = None,
    ) -> None:
        variant = variant or Variant()
        super().__init__(timing, pairing, variant)
        self._variant = variant
        self.kill_bytes = variant.kill_bytes
        self._goal = Goal.GO_ON
        self._doubt = Doubt(0.0)
        self._confirming = False

    # --- what the streamer calls -----------------------------------------------------------

    def renumber(self, now: float) -> None:
        """Set the printer's last line to 0; `InStep` follows, or an error event."""
        self._out.append(RENUMBER)
        self._begin(Goal.RENUMBER, now)

    def ask(self, now: float) -> None:
        """Ask which line was taken last; `InStep` follows, or an error event."""
        self._begin(Goal.GO_ON if self._numbered else Goal.NUMBER, now)

    def confirm(self, now: float) -> None:
        """Have a token come back from behind all that was sent; `InStep` follows."""
        self._confirming, self.deadline = True, now

    def feed(self, data: bytes, now: float) -> Sequence[Event]:
        """Take what the printer said."""
        if self._fast and data == b"ok\n":  # nearly every line of a print goes this way
            self.number = number = self.number + 1
            self.lines_done = done = self.lines_done + 1
            alone = self._pairing is None
            if alone and done < self.limit and not self.held and not self._controls:
                self._flight = command = self._lines[done]
                body = b"N%d %b" % (number + 1, command)
                self._flight_frame = line = b"%b*%d\n" % (body, reduce(xor, body))
                self._out.append(line)
                self.deadline = now + self.timing.silence_s
            else:
                self._send_next(now)
            return ()
        events: list[Event] = []
        *texts, self._rest = (self._rest + data).split(b"\n")
        if len(self._rest) > _REST_LIMIT:
            texts, self._rest = [*texts, self._rest], b""
        self._fast = False
        if self._rest and self._phase in (Phase.DRAIN, Phase.SETTLE):
            self.deadline = now + self.timing.quiet_s
        for text in texts:
            if text.strip():
                self._hear(self._variant.classify(text.rstrip(b"\r")), now, events)
        return events

    def tick(self, now: float) -> Sequence[Event]:
        """Take notice that it is ``now`` and nothing has come."""
        if now < self.deadline:
            return ()
        events: list[Event] = []
        self._fast = False
        _ON_TIME[self._phase](self, now, events)
        return events

    # --- hearing ---------------------------------------------------------------------------

    def _hear(self, reply: Reply, now: float, events: list[Event]) -> None:
        if self._phase is Phase.OVER and reply.kind is not Kind.HALT:
            return
        if reply.kind is Kind.ERROR and reply.number < 0:
            self._complaint = reply.words  # why it halts, if it does
        if reply.kind is Kind.REPORT and not reply.text.startswith(b"X:"):
            self.report = reply.text
        if reply.kind is Kind.HALT or reply.text == b"//action:poweroff":
            self._end(said.Halted(self._complaint or reply.words), events)
        elif reply.kind is Kind.START:
            if self._numbered:
                self._end(said.WasReset(), events)
            else:
                events.append(said.Booted())
        elif reply.kind is Kind.ACTION:
            events.append(said.Action(reply.words.removeprefix("//action:")))
        elif reply.kind is Kind.FAULT:
            events.append(self._fault(reply.words))
        elif self._phase is Phase.FLIGHT:
            self._hear_in_flight(reply, now, events)
        elif self._phase is Phase.READY:
            if reply.kind is Kind.ERROR:
                events.append(self._fault(reply.words))
            elif reply.kind not in (Kind.REPORT, Kind.TEXT, Kind.BUSY, Kind.WAIT):
                events.append(said.Notice(f"stray {reply.words!r} with nothing in flight"))
        else:
            self._hear_in_doubt(reply, now)

    def _fault(self, text: str) -> said.Fault:
        self.held = True  # nothing more of the job leaves until somebody has looked at it
        in_job = self._flight is not None and not self._flight_control
        return said.Fault(text, self.lines_done + in_job)

    def _hear_in_flight(self, reply: Reply, now: float, events: list[Event]) -> None:
        kind = reply.kind
        if self._tokens.suspect and self._hear_token(reply, now, events):
            return
        if kind is Kind.OK and reply.number in (-1, self.number + 1):
            if reply.text != b"ok":
                self._said.append(reply.text)
            self._acknowledge(now, events)
        elif kind is Kind.BUSY:
            self._tokens.busy(now)
            self.deadline = now + self.timing.silence_s
        elif kind is Kind.REPORT or (reply.text.startswith(b"echo:") and kind is Kind.TEXT):
            self._said.append(reply.text)
            if b" W:" in reply.text or self._flight_control:
                self.deadline = now + self.timing.silence_s
        elif kind is Kind.TEXT and (self._awaiting or self._answers_text):
            self._said.append(reply.text)
            self.deadline = now + self.timing.silence_s
        else:
            self._doubt_flight(reply, now, events)

    @property
    def _answers_text(self) -> bool:
        """Whether the line in flight is a control command, which may be answered by any text."""
        return self._flight_control and not self._tokens.flying

    def _hear_token(self, reply: Reply, now: float, events: list[Event]) -> bool:
        """Take an echo, or an ok while a token is in flight; False for anything else."""
        tokens = self._tokens
        if tokens.hear(reply.text):
            self.deadline = now + self.timing.answer_s
            return True
        if reply.kind is not Kind.OK or not tokens.flying:
            return False
        if tokens.echoed or reply.number == self.number + 1:
            self._answered(now, events)
            return True
        tokens.heard += 1
        tokens.move_on()
        if reply.text != b"ok":
            self._said.append(reply.text)
        self.deadline = now + self.timing.silence_s
        return True

    def _answered(self, now: float, events: list[Event]) -> None:
        """The token's own ok has come: all before it is done, and what comes now is the next's."""
        self._count_flight()
        self._answer(events)
        if self._tokens.settle():
            events.append(said.Stray(self.number))
            self.held = True
        self._flight = None
        if self._confirming:
            self._confirming = False
            self._arrive(events)
        else:
            self._send_next(now)

    def _doubt_flight(self, reply: Reply, now: float, events: list[Event]) -> None:
        if reply.kind not in (Kind.RESEND, Kind.ERROR):
            events.append(said.Notice(f"doubtful reply {reply.words!r} to line {self.number + 1}"))
        self._begin(Goal.GO_ON, now)
        if reply.kind is Kind.ERROR and reply.number < 0:
            self._doubt.error = reply.words
        self._hear_in_doubt(reply, now)

    # --- doubt: drain, ask, settle ---------------------------------------------------------

    def _begin(self, goal: Goal, now: float) -> None:
        self._fast = False
        self._tokens.doubt()
        self._alone_until = self.number + self.timing.calm_lines
        self._goal, self._phase = goal, Phase.DRAIN
        flights = (self._flight,) if self._second is None else (self._flight, self._second)
        self._doubt = Doubt(now, self.number + 1, flights, self._variant.two_resends)
        self.deadline = now + self.timing.quiet_s

    def _hear_in_doubt(self, reply: Reply, now: float) -> None:
        oks = self._doubt.oks
        if not self._tokens.hear(reply.text):
            self._doubt.hear(reply)
        if reply.kind in (Kind.REPORT, Kind.TEXT) or (
            reply.kind is Kind.OK and reply.text != b"ok" and reply.number < 0
        ):
            self._said.append(reply.text)
        if reply.kind is Kind.BUSY:
            self._doubt.since = now
            self._tokens.busy(now)
        elif reply.kind in (Kind.JUNK, Kind.UNKNOWN_COMMAND) or self._doubt.oks > oks:
            self._tokens.move_on()
        if reply.kind in (Kind.REPORT, Kind.BUSY):
            return  # they come at any time and are no sign that a reply is under way
        if self._phase is Phase.ASK and self._doubt.answered:
            self._phase = Phase.SETTLE
        if self._phase is not Phase.ASK:
            self.deadline = now + self.timing.quiet_s
        else:  # something other than the whole answer: what follows comes soon or not at all
            self.deadline = min(self.deadline, now + 4 * self.timing.quiet_s)

    def _ask_now(self, now: float, events: list[Event]) -> None:
        doubt, timing = self._doubt, self.timing
        silent, early = now - doubt.since, not self._lines
        limit = timing.doubt_limit_s if early else timing.silent_limit_s
        if silent > limit:
            self._end(said.Silent(silent), events)
            return
        if silent > timing.doubt_limit_s and not doubt.alarmed:
            doubt.alarmed = True
            events.append(said.Waiting(silent, limit))
        doubt.ask_again()
        self._out.append(self._variant.question)
        wait = timing.answer_s * (1 if doubt.asked < _QUICK else _SLOWLY)
        self._phase, self.deadline = Phase.ASK, now + wait

    def _unanswered(self, now: float, events: list[Event]) -> None:
        if self._goal is Goal.RENUMBER:
            self._out.append(RENUMBER)
        self._phase, self.deadline = Phase.DRAIN, now + self.timing.quiet_s

    def _settled(self, now: float, events: list[Event]) -> None:
        last = self._doubt.last
        failed = self._goal is Goal.RENUMBER and last != 0
        if failed or not self._doubt.agreed:
            self._unanswered(now, events)
        elif self._goal is Goal.GO_ON:
            self._go_on_from(last, now, events)
        else:
            self._numbered = self._goal is Goal.RENUMBER
            self.number = last
            self._tokens.forget_oks()
            self._arrive(events)

    def _arrive(self, events: list[Event]) -> None:
        events.append(said.InStep(self.number))
        self._flight = None
        self._phase, self.deadline = Phase.READY, math.inf

    def _go_on_from(self, last: int, now: float, events: list[Event]) -> None:
        taken = last - self.number
        flying = (self._flight is not None) + (self._second is not None)
        if last == 0 and self.number > 0:
            self._end(said.WasReset(), events)
        elif taken == 0 and not flying:
            self._arrive(events)
        elif taken == 0:
            self._send_again(now, events)
        elif 0 < taken <= flying:
            self._were_taken(taken == 2, now, events)
        elif last != self._doubt.confirmed:
            self._doubt.confirmed = last
            self._unanswered(now, events)
        elif self.number - _MEMORY <= last < self.number:
            self._go_back(last, now, events)
        else:
            self._end(said.OutOfStep(last, self.number), events)

    def _send_again(self, now: float, events: list[Event]) -> None:
        self._second = None
        if not self._awaiting:
            self._said = []
        noisy = self._errors.count(self.number)
        if noisy:
            events.append(noisy)
        tokens, doubt = self._tokens, self._doubt
        tokens.heard += doubt.oks
        if tokens.flying:
            tokens.drop()
            self._send_token(now, events)
        elif self._flight_control or tokens.heard <= tokens.owed:
            self._fly(now)
        else:
            events.append(said.Stray(self.number + 1))
            self.held = True
            tokens.forget_oks()
            self._send_next(now)

    def _were_taken(self, both: bool, now: float, events: list[Event]) -> None:
        """Count what was in flight as taken; whether its ok has come a token tells."""
        doubt, tokens = self._doubt, self._tokens
        tokens.heard, heard = tokens.heard + doubt.oks, tokens.heard + doubt.oks
        if self._second is not None and not both:  # it was refused; the complaint was of it
            doubt.error = ""
        if doubt.error:
            events.append(self._fault(doubt.error))
        if doubt.quoted and doubt.quoted == self._flight and not tokens.flying:
            text = f'unknown command "{doubt.quoted.decode("ascii", "replace")}"'
            events.append(self._fault(text))
            tokens.heard += 1
        if tokens.flying and not self._wants_another(now):
            self._wait_on(now, events)
            return
        if not heard and not tokens.flying:
            events.append(said.Notice(f"no ok to line {self.number + 1} was heard; it was taken"))
        if both:
            self._count_flight()
            tokens.owed += 1
            self._flight = self._second
        self._second = None
        self._owe(now, events)

    def _wants_another(self, now: float) -> bool:
        """Whether the token in flight, which was taken, is to be followed by another."""
        tokens = self._tokens
        tokens.rounds += 1
        patient = self._doubt.by_silence and tokens.rounds < 2
        return tokens.echoed or (not patient and tokens.may_send(now, self.keepalive))

    def _wait_on(self, now: float, events: list[Event]) -> None:
        """Wait for the echo, and ask ever less often whether the printer is still there.

        One that doesn't say when it is busy may have lost the echo: it has a limit.
        """
        waited = self._tokens.waited(now)
        if not self.keepalive and waited > self.timing.busy_limit_s:
            self._end(said.Silent(waited), events)
            return
        doublings = min(self._tokens.rounds, MOST_DOUBLINGS)
        wait = min(self.timing.silence_s * 2.0**doublings, PATIENCE_S)
        self._phase, self.deadline = Phase.FLIGHT, now + wait

    def _go_back(self, last: int, now: float, events: list[Event]) -> None:
        """Send lines again that an ok which wasn't theirs had acknowledged."""
        newest, asked, tokens = self.number, self._flight is None, self._tokens
        self.held, self._second, self._awaiting = True, None, None
        if self._flight is not None and self._flight_control and not tokens.flying:
            self._controls.appendleft(self._flight)
        tokens.drop()
        tokens.forget_oks()
        while self.number > last:
            if self.number in tokens.numbers:
                tokens.numbers.discard(self.number)
            elif self.number in self._control_numbers:
                self._controls.appendleft(self._control_numbers.pop(self.number))
            else:
                self.lines_done -= 1
            self.number -= 1
            self._errors.total += 1
        events.append(said.WentBack(last + 1, newest, tuple(self._controls)))
        if asked:
            events.append(said.InStep(last))
        self._send_next(now)

    # --- time ------------------------------------------------------------------------------

    def _silence(self, now: float, events: list[Event]) -> None:
        self._begin(Goal.GO_ON, now)
        self._doubt.by_silence = True
        self._ask_now(now, events)

    def _send_token(self, now: float, events: list[Event]) -> None:
        if self._tokens.tries >= TRIES:
            self._end(said.Silent(now - self._doubt.since), events)
        else:
            super()._send_token(now, events)

    def _send_first_token(self, now: float, events: list[Event]) -> None:
        self._send_token(now, events)

    def _end(self, event: Event, events: list[Event]) -> None:
        self._phase, self._fast, self.deadline = Phase.OVER, False, math.inf
        events.append(event)


_ON_TIME: Final[dict[Phase, Callable[[MarlinProtocol, float, list[Event]], None]]] = {
    Phase.READY: MarlinProtocol._send_first_token,
    Phase.FLIGHT: MarlinProtocol._silence,
    Phase.DRAIN: MarlinProtocol._ask_now,
    Phase.ASK: MarlinProtocol._unanswered,
    Phase.SETTLE: MarlinProtocol._settled,
}
