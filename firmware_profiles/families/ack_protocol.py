"""Base of RepRapFirmware's and Klipper's link protocols: one G-code line at a time, until its ok.

Neither keeps count of lines as Marlin does: a line number is at most part of a checksum. So
there is no asking "which line did you take last". Line numbers here are the host's own count.

What is evidence: the position. After silence M114 is sent behind the line in flight, again and
again until it is answered. Lines are worked on in turn, so the answer, whenever it comes, is of a
time when that line's fate was sealed; no line leaves between a doubt's questions, so that all their
answers say the same. Where each question was answered nothing was lost: the line's own ok counts.
Else, where the line's end is, it was taken; where the line before it ended, it was not and is sent
again; elsewhere, ask again, and end the print where the answer stays the same. Where the line
changes no position, it is sent again if doing it twice is doing it once (temperatures, modes, a
move to where the needle is), else the print ends: nobody knows. Silence alone is followed by no
repeat.

Until an ok without a position before it has come, one behind a position may answer a question of an
earlier doubt: it counts for no line then.
"""

from __future__ import annotations

import math
import re
from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Sequence
from enum import Enum, auto
from typing import Final

from firmware_profiles.families import link_protocol as said
from firmware_profiles.families.known_messages import COMPLAINTS, MessageMeaning, MessageTable
from firmware_profiles.families.link_protocol import Event, Places
from firmware_profiles.families.position_reply import parse_position
from firmware_profiles.families.timing import HOST_LATE_S, LineErrors, Timing

PROBE: Final = b"M105"
"""Asked only to hear an answer: temperatures, which every family tells at any time."""
PLACE: Final = b"M114"
_REST_LIMIT: Final = 65536
WITHIN_MM: Final = 0.0016
"""M114 has three decimals, of a 32-bit float."""
_SURE: Final = 3
_HARMLESS: Final = frozenset(
    b"G0 G1 G4 G21 G90 G92 M42 M82 M84 M85 M92 M104 M105 M106 M107 M109 M114 M115 M116 M140 M190"
    b" M191 M200 M201 M203 M204 M220 M221 M302 M400".split()
)
"""Done twice is done once, where no position changes (a dwell is only longer)."""
_WORD: Final = re.compile(rb"([GM])0*(\d+)(?![.\d])")


def _code(command: bytes) -> bytes:
    match = _WORD.match(command)
    return match[1] + match[2] if match else b""


def nowhere(lines: Sequence[bytes], done: int) -> dict[str, float]:
    """Tell no place."""
    return {}


class Sort(Enum):
    """What a line from the printer is."""

    OK = auto()
    FAULT = auto()
    REFUSAL = auto()
    HALT = auto()
    RESTART = auto()
    NOTICE = auto()
    TEXT = auto()


_SORTS: Final = {
    MessageMeaning.HALT: Sort.HALT,
    MessageMeaning.FAULT: Sort.FAULT,
    MessageMeaning.REFUSAL: Sort.REFUSAL,
    MessageMeaning.NOTICE: Sort.NOTICE,
}
_REPORT: Final = re.compile(rb"(?:[TBC]\d*:|[XYZ]:|//|echo:)")
"""How answers begin that a job's own lines ask for, or that macros write."""
_GLUED: Final = re.compile(rb"ok(?![a-z])")
"""An ok whose line end was lost: what follows is another line."""
_ENDS: Final = frozenset({Sort.FAULT, Sort.REFUSAL, Sort.HALT, Sort.RESTART})
"""After these nothing leaves, not even for an ok before them in the same read."""


class AckProtocol(ABC):
    """State machine of one printer; see `firmware_profiles.families.link_protocol.LinkProtocol`.

    A family gives `frame` (a command as it is sent), `sort` (what a reply is), its ``messages``,
    and how its errors begin (`error_starts`).

    Nothing leaves while a line from the printer is cut by a read: it may be an error. After
    ``silence_s`` its first half counts: as an error where it may be the beginning of one.

    Parameters
    ----------
    places : callable, optional
        Where the job's text says needle and plunger are after so many lines.
    timing : Timing, optional
    """

    kill_bytes: bytes = b"\nM112\n"
    messages: MessageTable
    error_starts: tuple[bytes, ...]

    def __init__(self, places: Places = nowhere, timing: Timing | None = None) -> None:
        self.timing = timing or Timing()
        self.deadline = math.inf
        self.lines_done = self.number = self.limit = 0
        self.held = self.keepalive = True
        self.lines: Sequence[bytes] = ()
        self._controls: deque[bytes] = deque()
        self.flight: bytes | None = None
        self.in_job = self.probing = self._placing = self._over = self._waits = False
        self._behind_job = self._complained = self._doubted = False
        self.sent_at = 0.0
        self._rest = self.report = b""
        self.out: list[bytes] = []
        self.heard: list[bytes] = []
        self._places = places
        self._begin_doubt_count()
        self._asking = self._placed = False
        self._elsewhere: dict[str, float] = {}
        self._told = 0
        self._earlier, self._earlier_until_s = 0, -math.inf
        self.errors = LineErrors(self.timing.noise_window, self.timing.noise_limit)

    # --- a family's own ----------------------------------------------------------------------

    @abstractmethod
    def frame(self, number: int, command: bytes) -> bytes:
        """A command as it goes over the wire."""

    @abstractmethod
    def sort(self, text: bytes) -> Sort:
        """Tell what a line from the printer is."""

    def sort_known(self, text: bytes) -> Sort:
        """Tell what a line is by the family's messages, wherever in it they stand."""
        message = self.messages.find(text)
        if message is not None and message.meaning in COMPLAINTS:
            return _SORTS[message.meaning]
        if text == b"ok" or text.startswith(b"ok "):
            return Sort.OK
        return Sort.TEXT if message is None else _SORTS.get(message.meaning, Sort.TEXT)

    # --- what the streamer calls -----------------------------------------------------------

    @property
    def idle(self) -> bool:
        """Nothing is in flight and nothing is being asked."""
        return self.flight is None

    @property
    def line_errors(self) -> int:
        """Lines sent again so far."""
        return self.errors.total

    def load(self, lines: Sequence[bytes], first: int, number: int) -> None:
        """Take a job; go on at line ``first``, the count of lines being ``number``."""
        self.grow(lines)
        self.lines_done, self.number = first, number

    def grow(self, lines: Sequence[bytes]) -> None:
        """Take a job that has got lines behind those that were taken; nothing may be in flight."""
        self.lines, self.limit = lines, len(lines)

    def renumber(self, now: float) -> None:
        """Hear that the printer answers, and count from 0; `Synchronised` follows."""
        self.number = 0
        self.ask(now)

    def confirm(self, now: float) -> None:
        """Hear where the printer is, which it says in its turn; `Synchronised` follows.

        An ok without a position before it answers an earlier line, and is passed over.
        """
        self.flight, self.in_job, self.probing = PLACE, False, True
        self._placing, self.heard = True, []
        self.fly(now)

    def ask(self, now: float) -> None:
        """Check that the printer answers; it can't name its last line. `Synchronised` follows."""
        if self.lines:
            self.confirm(now)
            return
        self.flight, self.in_job, self.probing = PROBE, False, True
        self.fly(now)

    def submit(self, command: bytes, now: float) -> None:
        """Send a control command ahead of further job lines; `Replied` follows."""
        self._controls.append(command)
        self.go(now)

    def cut_in(self, commands: Sequence[bytes], again: bool, now: float) -> bool:
        """Write nothing: an ok names no line, and there is no token to tell it from others."""
        return False

    def go(self, now: float) -> None:
        """Send the next line if nothing is in flight."""
        if self.flight is None and not self._over:
            self._send_next(now)

    def take_output(self) -> bytes:
        """Give what must be written now, and forget it."""
        data = b"".join(self.out)
        self.out.clear()
        return data

    def feed(self, data: bytes, now: float) -> Sequence[Event]:
        """Take what the printer said."""
        events: list[Event] = []
        *texts, self._rest = (self._rest + data).split(b"\n")
        if len(self._rest) > _REST_LIMIT:
            texts, self._rest = [*texts, self._rest], b""
        ends = len(texts) > 1 and any(self.sort(text.strip()) in _ENDS for text in texts)
        waited, self._waits = self._waits, ends or bool(self._rest)
        for text in map(bytes.strip, texts):
            if text and not self._over:
                self.hear(text, now, events)
        if (waited or ends) and not self._rest:
            self._go_on(now)
        return events

    def _go_on(self, now: float) -> None:
        """Send what had to wait until all of an answer was heard."""
        self._waits = False
        if self._controls or not self.held:
            self.go(now)

    def tick(self, now: float) -> Sequence[Event]:
        """Take notice that it is ``now`` and nothing has come."""
        events: list[Event] = []
        if now >= self.deadline:
            if now - self.deadline > HOST_LATE_S:
                self.sent_at += now - self.deadline
            if self.flight is None and self._rest:
                self._take_half(now, events)
            elif now - self.sent_at > self._patience():
                self.end(said.NoReply(now - self.sent_at), events)
            elif self._asking and self._position:
                self._settle(now, events)
            else:
                self._ask(now, events)
        return events

    def _take_half(self, now: float, events: list[Event]) -> None:
        """Judge a line by its first half: the second hasn't come."""
        half, self._rest = self._rest.strip(), b""
        if any(half.startswith(start) or start.startswith(half) for start in self.error_starts):
            words = half.decode("ascii", "backslashreplace")
            late = f"{words} ... (the rest of the line didn't come in {self.timing.silence_s:g} s)"
            self.held = True
            events.append(said.Fault(late, self.lines_done, self._behind_job))
        self.deadline = math.inf
        self._go_on(now)

    # --- steps -----------------------------------------------------------------------------

    def _patience(self) -> float:
        early = self.probing and not self.lines
        return self.timing.doubt_limit_s if early else self.timing.busy_limit_s

    def _send_next(self, now: float) -> None:
        self.heard = []
        if self._controls and not self._waits:
            self.flight, self.in_job = self._controls.popleft(), False
        elif not self.held and not self._waits and self.lines_done < self.limit:
            self.flight, self.in_job = self.lines[self.lines_done], True
        else:
            self.flight, self.in_job = None, False
            self.deadline = now + self.timing.silence_s if self._rest else math.inf
            return
        self.fly(now)

    def fly(self, now: float) -> None:
        """Write the line in flight for the first time."""
        self.sent_at, self._told, self._placed = now, 0, False
        self._complained = False
        self._begin_doubt_count()
        self._write(now)

    def _write(self, now: float) -> None:
        self.out.append(self.frame(self.number + 1, self.flight or PLACE))
        self.deadline = now + self.timing.silence_s

    def hear(self, text: bytes, now: float, events: list[Event]) -> None:
        """Take one line from the printer."""
        sort, words = self.sort(text), text.decode("ascii", "backslashreplace")
        if sort is Sort.HALT:
            self.end(said.FirmwareHalted(words), events)
        elif sort is Sort.RESTART:
            over = bool(self.lines)
            self.end(said.FirmwareReset(), events) if over else events.append(
                said.FirmwareStarted()
            )
        elif sort in (Sort.FAULT, Sort.REFUSAL):
            self.held = True
            answers = self.in_job or (self.flight is None and self._waits and self._behind_job)
            line, refusal = self.lines_done + self.in_job, sort is Sort.REFUSAL
            events.append(said.Fault(words, line, answers, refusal))
            self._refused += self._asking
            self._complained |= not self._asking
            if self._refused == _SURE:  # it answers, but won't tell where it is
                self.end(said.NoReply(now - self.sent_at), events)
            elif _GLUED.match(text):
                self._hear_ok(b"ok", now, events)
        elif sort is Sort.OK:
            self._hear_ok(text, now, events)
        elif sort is Sort.NOTICE:
            events.append(said.Remark(words, known=True))
            if _GLUED.match(text):
                self._hear_ok(b"ok", now, events)
        elif self.flight is not None:
            self._hear_place(text, now)
            if self.in_job and not _REPORT.match(text):
                events.append(said.Remark(words))
            if not (self._asking and self._placed):
                self.heard.append(text)
            elif self._asks_place:  # one answer, of many to the same question
                self.heard = [text]
            self._await_more(now)

    def _await_more(self, now: float) -> None:
        """Set the deadline behind a line that ends nothing."""
        if not self._asking:
            self.deadline = now + self.timing.silence_s
        elif self._position:
            self.deadline = now + self.timing.quiet_s

    def _hear_ok(self, text: bytes, now: float, events: list[Event]) -> None:
        if self.flight is None:
            self._surplus(events)
            return
        if text != b"ok":
            self.heard.append(text)
        placed, self._placed = self._placed, False
        asks_place = self._asks_place
        if self._asking:
            self._bare += not placed
            self.sent_at = now  # it isn't silent
            self._await_more(now)
        elif placed and self._is_late(now, asks_place):
            self.heard.clear()
            self._await_more(now)
        elif self._placing and not placed:
            self._surplus(events)
            self._await_more(now)
        else:
            if not asks_place:  # it left behind all questions
                self._earlier = 0
            self.acknowledge(now, events)

    def _surplus(self, events: list[Event]) -> None:
        """Hold the job at an ok that answers no line: another program's, but behind a doubt."""
        if self.lines:
            self.held = True
            events.append(said.StrayOk(self.number, 0 if self._doubted else 1))

    def acknowledge(self, now: float, events: list[Event]) -> None:
        """Count the line in flight as taken, and send the next."""
        self._end_doubt()
        if self.probing:
            self._doubted &= not self._placing  # all answers of before have come
            self.probing = self._placing = False
            events.append(said.Synchronised(self.number))
            self.flight, self.deadline = None, math.inf
            return
        self.number += 1
        self._behind_job = self.in_job
        if self.in_job:
            self.lines_done += 1
        else:
            events.append(said.CommandReplied(self.flight or b"", self.number, tuple(self.heard)))
        self._send_next(now)

    # --- doubt ---------------------------------------------------------------------------------

    def _begin_doubt_count(self) -> None:
        self._asked = self._answered = self._bare = self._refused = 0
        self._asked_s = -math.inf
        self._position: dict[str, float] = {}

    def _ask(self, now: float, events: list[Event]) -> None:
        """Ask where the printer is, ever again; once a minute of one that stays silent."""
        silent = now - self.sent_at
        self._asking = self._doubted = True
        self._asked, self._asked_s = self._asked + 1, now
        self.out.append(self.frame(self.number + 2, PLACE))
        self.deadline = now + self.timing.answer_s
        if silent >= self.timing.deaf_s:
            events.append(said.Notice(f"line {self.number + 1}: no word for {silent:.0f} s"))
            self.deadline = now + self.timing.deaf_s

    def _hear_place(self, text: bytes, now: float) -> None:
        """Take a position: an answer of this doubt, or of one before."""
        position = parse_position((text,))
        self._placed = bool(position)
        if self._asking and position and not self._is_late(now, asks_place=True):
            self._answered += 1
            self._position = position

    @property
    def _asks_place(self) -> bool:
        return _code(self.flight or b"") == PLACE

    def _is_late(self, now: float, asks_place: bool) -> bool:
        """Whether a position answers a question of an earlier doubt; such come in turn.

        Where the line in flight asks for none itself, however late.
        """
        late = self._earlier > 0 and (not asks_place or now <= self._earlier_until_s)
        self._earlier -= late
        return late

    def _end_doubt(self) -> None:
        """Keep in mind which answers may come yet."""
        if self._asking:
            self._earlier = self._asked + self._asks_place - self._answered
            self._earlier_until_s = self._asked_s + self.timing.doubt_limit_s
        self._asking = False

    def _settle(self, now: float, events: list[Event]) -> None:
        """Decide whether the line in flight was taken: the printer has answered and is quiet."""
        position, self._position = self._position, {}
        after, before = (self._there(position, self.lines_done + k) for k in (1, 0))
        moves = self.in_job and after != before
        missing = self._asked - self._answered
        answered = self._complained or (self._bare and missing <= 0)
        if self._asks_place or answered:
            if not answered:
                events.append(said.Notice(f"line {self.number + 1} was answered when asked again"))
            self.acknowledge(now, events)
        elif moves and after:
            events.append(said.Notice(f"the ok to line {self.number + 1} was lost"))
            self.acknowledge(now, events)
        elif self.in_job and not after and not before:
            self._is_elsewhere(position, now, events)
        elif moves:
            self._send_again(now, events)
        elif missing > 0 and now < self._asked_s + self.timing.doubt_limit_s:
            self._position = position  # more may come
            self.deadline = self._asked_s + self.timing.doubt_limit_s
        elif _code(self.flight or b"") in _HARMLESS:
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
            self._ask(now, events)
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
        """Write the line in flight once more; what was heard of it counts no longer."""
        events.append(said.Notice(f"line {self.number + 1} wasn't answered; it is sent again"))
        noisy = self.errors.count(self.number)
        if noisy:
            events.append(noisy)
        if self.errors.stuck:
            text = (self.flight or b"").decode("ascii", "backslashreplace")
            line = self.lines_done + 1 if self.in_job else 0
            refused = said.LineRefused(self.number + 1, self.errors.in_turn, text, line)
            self.end(refused, events)
            return
        self._end_doubt()
        self._begin_doubt_count()
        self.heard, self.sent_at = [], now
        self._write(now)

    def end(self, event: Event, events: list[Event]) -> None:
        """Take no further part."""
        self._over, self.deadline = True, math.inf
        events.append(event)
