"""Interpret Marlin's replies (ok, resend, busy, error) for the command in flight."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import replace
from typing import Final

from firmware_profiles.families import link_protocol as said
from firmware_profiles.families.link_protocol import Event
from firmware_profiles.families.marlin.replies import (
    ACTION,
    Kind,
    Reply,
    classify,
    frame,
    may_be_line_error,
)
from firmware_profiles.families.marlin.sender import Sender
from firmware_profiles.families.marlin.state import (
    MAX_SET_BACKS,
    QUESTION,
    RENUMBER,
    LineState,
    Phase,
    QueryGoal,
)

_NOTED: Final = frozenset({Kind.FAULT, Kind.REFUSAL, Kind.ACTION})
"""Replies that were reported already; the line's own answer is still to come."""
_WORD: Final = re.compile(rb"[A-Za-z]{4}")
_STUCK: Final = 3
"""Lines running that were answered by an ok with one number: it isn't the line's."""
PERSON: Final = re.compile(rb"paused for (user|input)")
"""In a busy message while a person is waited for at the printer's own button."""


class ReplyHandler:
    """Reply handling of `firmware_profiles.families.marlin.protocol.MarlinProtocol`.

    Parameters
    ----------
    state : LineState
    sender : Sender
    doubting : DoubtResolver
    """

    def __init__(self, state: LineState, sender: Sender, doubting: DoubtResolver) -> None:
        self._state, self._sender, self._doubting = state, sender, doubting

    def hear_all(self, replies: Sequence[Reply], now: float, events: list[Event]) -> None:
        """Take what came in one read; with an error or half a line in it, nothing leaves before."""
        state = self._state
        forbidden = len(replies) > 1 and any(reply.forbids for reply in replies)
        waited, state.waits = state.waits, forbidden or bool(state.rest)
        for reply in replies:
            self.hear(reply, now, events)
        if (waited or forbidden) and not state.rest:
            state.waits = False
            kept = state.second is not None or state.controls or not state.held
            if state.phase is Phase.READY and kept:
                self._sender.send_next(now)

    def take_half(self, now: float, events: list[Event]) -> None:
        """Take a complaint whose line end hasn't come."""
        state = self._state
        half = classify(state.rest.strip(b"\r"))
        if (half.complains or half.halts) and not may_be_line_error(state.rest):
            state.rest, state.waits = b"", False
            self.hear(half, now, events)

    def hear(self, reply: Reply, now: float, events: list[Event]) -> None:
        """Take one line from the printer."""
        state = self._state
        if state.phase is Phase.OVER and reply.kind is not Kind.HALT:
            return
        if reply.kind is Kind.OK:
            reply = self._look_at_fields(reply, events)
        if reply.kind is Kind.REPORT and not reply.text.startswith(b"X:"):
            state.report = reply.text
        if reply.kind is Kind.BUSY and PERSON.search(reply.text):
            if not PERSON.search(state.report):
                state.report = reply.text
                events.append(said.WaitingForPerson())
        elif reply.kind is Kind.OK and PERSON.search(state.report):
            state.report = b""
        if reply.halts:
            state.end(said.FirmwareHalted(state.complaint or reply.words), events)
            return
        if reply.kind is Kind.START:
            if state.numbered:
                state.end(said.FirmwareReset(), events)
            else:
                events.append(said.FirmwareStarted())
            return
        self._note_remarks(reply, events)
        if state.phase is Phase.FLIGHT:
            self._in_flight(reply, now, events)
        elif state.phase is Phase.READY:
            self._at_rest(reply, now, events)
        else:
            self._doubting.hear(reply, now)

    def _note_remarks(self, reply: Reply, events: list[Event]) -> None:
        """Report complaints and remarks, whatever the link is doing."""
        state, kind = self._state, reply.kind
        if kind is Kind.FAULT:
            state.complaint = reply.words  # why it halts, if it does
            events.append(state.fault(reply.words))
        elif kind is Kind.REFUSAL:
            events.append(state.fault(reply.words, about_command=True))
        elif kind is Kind.UNKNOWN_COMMAND and not state.tokens.quoted_by(reply.text):
            self._note_unknown_command(reply, events)
        elif kind is Kind.ACTION and (match := ACTION.match(reply.text)):
            events.append(said.Action(match[1].decode("ascii", "backslashreplace")))
        elif kind is Kind.NOTICE:
            events.append(said.Remark(reply.words, known=True))

    def _note_unknown_command(self, reply: Reply, events: list[Event]) -> None:
        """Report a command that the firmware doesn't know, where the host has sent it.

        What noise has made of a line is quoted as well, and is sent again.
        """
        state, command = self._state, reply.command
        flight = b"" if state.tokens.flying else state.flight or b""
        words = command.split(b" ")
        flying = flight.split(b" ")[0] == words[0] and flight.startswith(command)
        line = state.recall(command)
        if not command or not (flying or command == state.second or line >= 0):
            return
        text = f'unknown command "{command.decode("ascii", "replace")}"'
        event = state.fault(text, about_command=True)
        if command == state.second:
            event = replace(event, line=event.line + 1)
        elif not flying:
            event = replace(event, line=line or event.line, refused=line > 0)
        events.append(event)

    def _look_at_fields(self, reply: Reply, events: list[Event]) -> Reply:
        """Return an ok as it may be believed; tell once where ADVANCED_OK's fields can't be."""
        state = self._state
        expected = state.number + 1
        if reply.number < 0 or reply.number == expected:
            state.times_misnamed = 0
        elif reply.number != state.misnamed:
            state.misnamed, state.misnamed_line, state.times_misnamed = reply.number, expected, 1
        elif expected != state.misnamed_line:
            state.misnamed_line, state.times_misnamed = expected, state.times_misnamed + 1
        state.plain |= state.times_misnamed == _STUCK
        if (state.plain or reply.senseless) and not state.told_odd:
            state.told_odd = True
            events.append(said.Notice(f"ADVANCED_OK makes no sense ({reply.words!r}): plain oks"))
        return replace(reply, number=-1, text=b"ok") if state.plain else reply

    def _at_rest(self, reply: Reply, now: float, events: list[Event]) -> None:
        """Take a line with nothing in flight, but for a line whose end hasn't left yet."""
        state, kind = self._state, reply.kind
        if state.questions.answered_late(reply, now, math.inf):
            return
        refused = kind in (Kind.RESEND, Kind.ERROR, Kind.UNKNOWN_COMMAND, Kind.JUNK)
        if state.second is not None and refused:
            noisy = state.errors.count(state.number)  # it has ended that line
            events += [noisy] if noisy else []
            self._begin_doubt(reply, now, events)
        elif kind is Kind.OK and state.numbered and not state.tokens.suspect:
            # M410 without emergency parser may have a token run twice: that ok names our own line
            self._hold_at_surplus(0 if reply.number >= 0 else 1, events)
        elif kind in (Kind.OK, Kind.RESEND, Kind.ERROR, Kind.UNKNOWN_COMMAND, Kind.JUNK):
            events.append(said.Notice(f"stray {reply.words!r} with nothing in flight"))

    def _in_flight(self, reply: Reply, now: float, events: list[Event]) -> None:
        state = self._state
        kind = reply.kind
        if state.tokens.suspect and self._token(reply, now, events):
            return
        if kind is Kind.OK and self._is_foreign(reply):
            self._hold_at_surplus(1, events)
            state.deadline = now + state.timing.silence_s
        elif kind is Kind.OK and reply.number in (-1, state.number + 1):
            if reply.text != b"ok":
                state.said.append(reply.text)
            self._sender.acknowledge(now, events)
        elif kind is Kind.BUSY:
            state.tokens.busy(now)
            state.deadline = now + state.timing.silence_s
        elif kind in _NOTED:
            state.deadline = now + state.timing.silence_s
        elif kind in (Kind.REPORT, Kind.NOTICE, Kind.CHATTER) or (
            reply.text.startswith(b"echo:") and kind is Kind.TEXT
        ):
            state.said.append(reply.text)
            if kind is Kind.TEXT and not state.flight_control:
                self._remark(reply, events)
            if b" W:" in reply.text or state.flight_control:
                state.deadline = now + state.timing.silence_s
        elif kind is Kind.TEXT and (state.awaiting or self._answers_text):
            state.said.append(reply.text)
            state.deadline = now + state.timing.silence_s
        else:
            self._begin_doubt(reply, now, events)

    def _hold_at_surplus(self, foreign: int, events: list[Event]) -> None:
        """Hold the job: an ok came that answers none of the host's lines."""
        events.append(said.StrayOk(self._state.number, foreign, self._state.cut))
        self._state.hold()

    def _is_foreign(self, reply: Reply) -> bool:
        """Whether an ok answers none of the host's lines: those have numbers, and have left."""
        state = self._state
        state.names_lines |= reply.number >= 0
        unsent = bool(state.out)  # it came in one read with the answer to the line before
        return (unsent or (state.names_lines and reply.unnamed)) and not state.tokens.suspect

    @property
    def _answers_text(self) -> bool:
        """Whether the line in flight is a control command, which may be answered by any text."""
        state = self._state
        return state.flight_control and not state.tokens.flying

    def _token(self, reply: Reply, now: float, events: list[Event]) -> bool:
        """Take an echo, an ok while a token is in flight, or a late answer; False for all else."""
        state = self._state
        tokens = state.tokens
        if state.questions.answered_late(reply, now, math.inf):
            state.deadline = now + state.timing.silence_s
            return True
        if state.hear_token(reply.text):
            state.deadline = now + tokens.ok_wait_s(state.timing.answer_s)
            return True
        if tokens.flying and not tokens.echoed and tokens.resembles(reply.text):
            tokens.move_on()
            self._begin_doubt(reply, now, events)
            return True
        if reply.kind is not Kind.OK or not tokens.flying:
            return False
        if tokens.echoed or reply.number == state.number + 1:
            self._token_answered(now, events)
            return True
        tokens.heard += 1
        tokens.move_on()
        if reply.text != b"ok":
            state.said.append(reply.text)
        state.deadline = now + state.timing.silence_s
        return True

    def _token_answered(self, now: float, events: list[Event]) -> None:
        """The token's own ok has come: all before it is done, and what comes now is the next's."""
        state = self._state
        self._sender.count_flight()
        if state.tokens.behind:
            self._sender.send_token(now, events)
            return
        self._sender.answer(events)
        doubted, state.set_backs = state.tokens.doubted, 0
        surplus = state.tokens.settle()
        if surplus:
            self._hold_at_surplus(0 if doubted else surplus, events)
        state.flight, state.cut = None, 0
        if state.confirming:
            state.confirming = False
            self._doubting.arrive(events)
        else:
            self._sender.send_next(now)

    def _remark(self, reply: Reply, events: list[Event]) -> None:
        """Report a text that no table has; on a wire that makes errors it may be noise's."""
        if self._state.errors.total or not _WORD.search(reply.text):
            events.append(said.Notice(f"unknown reply {reply.words!r}"))
        else:
            events.append(said.Remark(reply.words))

    def _begin_doubt(self, reply: Reply, now: float, events: list[Event]) -> None:
        state = self._state
        if reply.kind is Kind.TEXT and not state.flight_control:
            self._remark(reply, events)
        elif reply.kind not in (Kind.RESEND, Kind.ERROR):
            events.append(said.Notice(f"doubtful reply {reply.words!r} to line {state.number + 1}"))
        state.refusal = reply.words
        state.begin_doubt(QueryGoal.GO_ON, now)
        self._doubting.hear(reply, now)


# Find the last line that Marlin accepted after a doubtful reply: wait, query, go on or resend.

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
