"""Interpret Marlin's replies (ok, resend, busy, error) for the command in flight."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import replace
from typing import Final

from firmware_profiles.families import link_protocol as said
from firmware_profiles.families.link_protocol import Event
from firmware_profiles.families.marlin.doubt_resolver import DoubtResolver
from firmware_profiles.families.marlin.replies import (
    ACTION,
    Kind,
    Reply,
    classify,
    may_be_line_error,
)
from firmware_profiles.families.marlin.sender import Sender
from firmware_profiles.families.marlin.state import (
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
