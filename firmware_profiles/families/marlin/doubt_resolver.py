"""Find the last line that Marlin accepted after a doubtful reply: wait, query, go on or resend."""

from __future__ import annotations

import math
from typing import Final

from firmware_profiles.families import link_protocol as said
from firmware_profiles.families.link_protocol import Event
from firmware_profiles.families.marlin.replies import Kind, Reply, frame
from firmware_profiles.families.marlin.sender import Sender
from firmware_profiles.families.marlin.state import (
    MAX_SET_BACKS,
    QUESTION,
    RENUMBER,
    LineState,
    Phase,
    QueryGoal,
)

_MEMORY: Final = 8


class DoubtResolver:
    """Doubt-resolving part of `firmware_profiles.families.marlin.protocol.MarlinProtocol`.

    Parameters
    ----------
    state : LineState
    sender : Sender
    """

    def __init__(self, state: LineState, sender: Sender) -> None:
        self._state, self._sender = state, sender

    def hear(self, reply: Reply, now: float) -> None:
        """Take one line from the printer while in doubt."""
        state = self._state
        oks = state.doubt.oks
        late = state.questions.answered_late(reply, now, state.doubt.began_s)
        if not (late or state.hear_token(reply.text)):
            state.doubt.hear(reply)
        if reply.kind in (Kind.REPORT, Kind.TEXT) or (
            reply.kind is Kind.OK and reply.text != b"ok" and reply.number < 0
        ):
            state.said.append(reply.text)
        if reply.kind is Kind.BUSY:
            state.doubt.since = now
            state.tokens.busy(now)
        elif reply.kind in (Kind.JUNK, Kind.UNKNOWN_COMMAND) or state.doubt.oks > oks:
            state.tokens.move_on()
        if reply.kind in (Kind.REPORT, Kind.BUSY):
            return  # they come at any time and are no sign that a reply is under way
        if state.doubt.asked and state.doubt.answered:
            state.phase = Phase.SETTLE
        if state.phase is not Phase.ASK:
            state.deadline = now + state.timing.quiet_s
        else:  # something other than the whole answer: what follows comes soon or not at all
            state.deadline = min(state.deadline, now + 4 * state.timing.quiet_s)

    def ask_now(self, now: float, events: list[Event]) -> None:
        """Ask which line was taken last."""
        state = self._state
        doubt, timing = state.doubt, state.timing
        silent, early = now - doubt.since, not state.lines
        limit = timing.doubt_limit_s if early else timing.silent_limit_s
        if silent > limit:
            state.end(said.NoReply(silent), events)
            return
        if silent > timing.doubt_limit_s and not doubt.alarmed:
            doubt.alarmed = True
            events.append(said.Waiting(silent, limit))
        doubt.ask_again()
        state.questions.ask(now)
        state.out.append(QUESTION)
        state.phase, state.deadline = Phase.ASK, now + timing.answer_s

    def unanswered(self, now: float, events: list[Event]) -> None:
        """Wait for quiet, and ask again; what was answered before counts no longer."""
        state = self._state
        state.doubt.last = state.doubt.resend = -1
        if state.goal is QueryGoal.RENUMBER:
            state.out.append(RENUMBER)
        elif state.goal is QueryGoal.SET_BACK:
            state.out.append(b"\n" + frame(state.number, b"M110 N%d" % state.number))
        state.phase, state.deadline = Phase.DRAIN, now + state.timing.quiet_s

    def settled(self, now: float, events: list[Event]) -> None:
        """Go on from the answer, where its halves agree."""
        state = self._state
        last = state.doubt.last
        wanted = {QueryGoal.RENUMBER: 0, QueryGoal.SET_BACK: state.number}.get(state.goal, last)
        failed = last != wanted
        if failed or not state.doubt.agreed:
            self.unanswered(now, events)
        elif state.goal is QueryGoal.GO_ON:
            self._go_on_from(last, now, events)
        elif state.goal is QueryGoal.SET_BACK:
            self._go_on_set_back(now, events)
        else:
            state.numbered = state.goal is QueryGoal.RENUMBER
            state.number = last
            state.tokens.forget_oks()
            self.arrive(events)

    def arrive(self, events: list[Event]) -> None:
        """Tell that the printer is in step."""
        state = self._state
        events.append(said.Synchronised(state.number))
        state.flight = None
        state.phase, state.deadline = Phase.READY, math.inf

    def _go_on_from(self, last: int, now: float, events: list[Event]) -> None:
        state = self._state
        taken = last - state.number
        flying = (state.flight is not None) + (state.second is not None)
        if taken == 0 and not flying:
            self.arrive(events)
            if state.controls or not state.held:
                self._sender.send_next(now)
        elif taken == 0:
            self._send_again(now, events)
        elif 0 < taken <= flying:
            self._were_taken(taken == 2, now, events)
        elif last != state.doubt.confirmed:
            state.doubt.confirmed = last
            self.unanswered(now, events)
        elif max(state.number - _MEMORY, 1) <= last < state.number:
            self._go_back(last, now, events)
        elif state.set_backs == MAX_SET_BACKS:
            state.end(said.LostSynchronisation(last, state.number), events)
        else:
            self._set_back(last, now, events)

    def _set_back(self, last: int, now: float, events: list[Event]) -> None:
        """Set the printer's count to the host's: another program has numbered lines anew."""
        state = self._state
        events.append(said.Renumbered(last, state.number))
        state.set_backs += 1
        state.second, state.held = None, True
        state.begin_doubt(QueryGoal.SET_BACK, now)
        state.tokens.forget_oks()
        self.unanswered(now, events)

    def _go_on_set_back(self, now: float, events: list[Event]) -> None:
        """Go on once both count alike; what was in flight goes again once the place is verified."""
        state = self._state
        if state.flight is None:
            self.arrive(events)
        elif state.flight_control and not state.tokens.flying:
            self._sender.fly(now)
            return
        state.tokens.drop()
        state.flight = None
        events.append(said.StrayOk(state.number + 1))
        if state.confirming or state.awaiting is not None:  # somebody waits for its answer
            self._sender.send_token(now, events)
        else:
            self._sender.send_next(now)

    def _send_again(self, now: float, events: list[Event]) -> None:
        state = self._state
        state.second = None
        if not state.awaiting:
            state.said = []
        if not state.resend(state.flight or b"", not state.flight_control, events):
            return
        tokens, doubt = state.tokens, state.doubt
        tokens.heard += doubt.oks
        if tokens.flying:
            tokens.drop()
            self._sender.send_token(now, events)
        elif not (state.flight_control or state.faulty) and tokens.heard > tokens.owed:
            events.append(said.StrayOk(state.number + 1, line=state.cut))
            state.held = True
            tokens.forget_oks()
            self._sender.send_next(now)
        elif state.flight_control or not state.held:
            self._sender.fly(now)
        else:  # the line goes again once the job goes on
            self._sender.send_next(now)

    def _were_taken(self, both: bool, now: float, events: list[Event]) -> None:
        """Count what was in flight as taken; whether its ok has come a token tells."""
        state = self._state
        doubt, tokens = state.doubt, state.tokens
        tokens.heard, heard = tokens.heard + doubt.oks, tokens.heard + doubt.oks
        if doubt.quoted and doubt.quoted == state.flight and not tokens.flying:
            tokens.heard += 1
        if tokens.flying and not self._wants_another(now):
            self._wait_on(now, events)
            return
        if not heard and not tokens.flying:
            events.append(said.Notice(f"no ok to line {state.number + 1} was heard; it was taken"))
        if both:
            self._sender.count_flight()
            tokens.owed += 1
            state.flight = state.second
        state.second = None
        self._sender.owe(now, events)

    def _wants_another(self, now: float) -> bool:
        """Whether the token in flight, which was taken, is to be followed by another."""
        tokens = self._state.tokens
        return tokens.echoed or tokens.may_send(now, self._state.keepalive)

    def _wait_on(self, now: float, events: list[Event]) -> None:
        """Wait for the echo; ask again after each silence.

        One that doesn't say when it is busy may have lost the echo: it has a limit.
        """
        state = self._state
        waited = state.tokens.waited(now)
        if not state.keepalive and waited > state.timing.busy_limit_s:
            state.end(said.NoReply(waited), events)
            return
        state.phase, state.deadline = Phase.FLIGHT, now + state.timing.silence_s

    def _go_back(self, last: int, now: float, events: list[Event]) -> None:
        """Send lines again that an ok which wasn't theirs had acknowledged."""
        state = self._state
        newest, asked, tokens = state.number, state.flight is None, state.tokens
        state.held, state.second, state.awaiting = True, None, None
        if state.flight is not None and state.flight_control and not tokens.flying:
            state.controls.appendleft(state.flight)
        tokens.drop()
        tokens.forget_oks()
        while state.number > last:
            if state.number in tokens.numbers:
                tokens.numbers.discard(state.number)
            elif state.number in state.control_numbers:
                state.controls.appendleft(state.control_numbers.pop(state.number))
            else:
                state.lines_done -= 1
            state.number -= 1
            state.errors.total += state.number > last  # the first is counted below
        events.append(said.LinesResent(last + 1, newest, tuple(state.controls)))
        in_job = not state.controls and state.lines_done < len(state.lines)
        command = state.lines[state.lines_done] if in_job else next(iter(state.controls), b"")
        if not state.resend(command, in_job, events):
            return
        if asked:
            events.append(said.Synchronised(last))
        self._sender.send_next(now)

    def silence(self, now: float, events: list[Event]) -> None:
        """Doubt the line in flight, and ask at once."""
        self._state.refusal = ""
        self._state.begin_doubt(QueryGoal.GO_ON, now)
        self.ask_now(now, events)
