"""State and alarms of a running print: sent to its clients and written to its journal."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, Final

from printctl.machine.control.board.progress import JobProgress
from printctl.machine.control.board.shell import write_end
from printctl.machine.control.board.standstill import Standstill
from printctl.machine.control.board.steps import Record
from printctl.machine.control.board.wiring import Wiring
from printctl.machine.errors import Refused
from printctl.machine.records.journal import RESERVE_BYTES
from printctl.machine.records.replay import JournalledPrint
from printctl.machine.records.states import EARLY, LinkState, PrintEnded, Status

NOTE_S: Final = 0.25
"""Interval of progress records and progress events."""
MAX_FAULTS: Final = 3
"""Complaints given in one message."""
MAX_REMARKS: Final = 1000
"""Unknown replies counted."""
MAX_STANDSTILLS: Final = 100
"""Written down one by one; further ones are counted."""
_NUMBER: Final = re.compile(r"\d+(?:\.\d+)?")


@dataclass
class _Alarm:
    """An alarm's first and last words, how often it came, and how often was written down."""

    first: str
    text: str
    times: int = 0
    written: int = 1


class Logbook:
    """State of one print, reported and written down; the only one that records in the journal.

    ``details`` adds to a status what other parts know; `note` is due at ``next_due``, s, at the
    latest; records of the sorts in ``unrecorded`` aren't written down.
    """

    def __init__(
        self,
        wiring: Wiring,
        progress: JobProgress,
        details: Callable[[Status], Status] = lambda status: status,
        next_due: Callable[[], float] = lambda: math.inf,
        unrecorded: frozenset[str] = frozenset(),
    ) -> None:
        self.progress = progress
        self._wiring, self._exchange, self._unrecorded = wiring, wiring.exchange, unrecorded
        self._details, self._next_due = details, next_due
        self.state, self._message = LinkState.CONNECTING, ""
        self.next_note = 0.0  # s: when `note` is due
        self.resumed = False  # begun by a process that died
        self.complaints = 0  # how often the printer has complained
        self._noted = self._alarm_count = 0
        self._open: list[tuple[str, bool]] = []
        self._remarks: list[str] = []
        self._alarms: dict[str, _Alarm] = {}
        self._standstills: list[Standstill] = []
        self._final: Status | None = None

    # --- as it stands, for any thread ------------------------------------------------------------

    @property
    def begun(self) -> bool:
        """Whether the printer may have lines of the job."""
        return self.resumed or self.state not in EARLY

    @property
    def fault(self) -> str:
        """The printer's complaints that end the print; or empty."""
        if not self._open:
            return ""  # it is looked for with each line
        texts = [text for text, _ in self._open]
        return "; ".join(list(dict.fromkeys(texts))[:MAX_FAULTS])

    @property
    def remarks(self) -> str:
        """What to add to the message of the end about replies that no table has; or empty."""
        if not self._remarks:
            return ""
        first, count = self._remarks[0], len(self._remarks)
        more = f" and {count - 1} other replies" if count > 1 else ""
        return (
            f"; the printer said {first!r}{more}, which printctl doesn't know: see the printer's "
            "manual"
        )

    @property
    def status(self) -> Status:
        """The print as it stands."""
        if self._final is not None:
            return self._final
        progress, (done, made) = self.progress, self.progress.known
        return self._details(
            Status(
                state=self.state,
                lines_done=done,
                lines_executed=made,
                lines_total=len(progress.job),
                file_line=progress.job.file_line(done),
                message=self._message,
                line_errors=self._wiring.protocol.line_errors,
                alarms=self._alarm_count,
                inserted=progress.job.positions,
            )
        )

    # --- state -----------------------------------------------------------------------------------

    def go_on(self, history: JournalledPrint) -> None:
        """Go on with a print that was begun by a process that died, from what its journal says."""
        self.resumed, self._alarm_count = True, len(history.alarms)
        self.progress.restore(history.done, history.made)
        self._noted = history.done

    def enter(self, state: LinkState, message: str) -> None:
        """Pass to a state; write it down and tell the clients."""
        now, standstills = self._wiring.exchange.now_s, self.progress.standstills
        self.note(now)
        if state is LinkState.PRINTING:
            standstills.begin(self._wiring.protocol.lines_done, now)
        elif state in (LinkState.PAUSING, LinkState.STOPPING):
            standstills.end_at_rest()
        self.state, self._message = state, message
        self.record("state", state=state, message=message)
        self._exchange.tell(self._wiring.on_status, self.status)

    def end(self, ended: PrintEnded) -> Status:
        """Write down how the print ended; return the last status."""
        self._note_standstills()
        twice = self.progress.doubled_words()
        # a client that asks meanwhile must see the print either running, or ended with all
        status = replace(
            self.status,
            state=ended.state,
            message=ended.message + self._standstill_words() + (f"; {twice}" if twice else ""),
            position_known=ended.known,
            error=ended.error,
            look=None,
            waits_for="",
        )
        self.state, self._final = ended.state, status
        refused = self.progress.refused
        for alarm in self._alarms.values():
            if alarm.times > alarm.written:
                self._record_times(alarm)
        end = status.end_record()
        if refused is not None:
            end |= {"refused": refused, "made": status.lines_executed}
        if "end" not in self._unrecorded:
            self._exchange.effects.append(partial(write_end, end, self._wiring))
        return status

    # --- the journal -----------------------------------------------------------------------------

    def record(self, sort: str, **values: Any) -> None:
        """Have a record added to the journal, at the next wait."""
        if sort not in self._unrecorded:
            self._exchange.effects.append(Record(sort, values))

    def refuse_without_room(self, values: dict[str, Any], name: str) -> None:
        """Raise `Refused` for a large record that the disk hasn't room for.

        One that fails costs the reserve.
        """
        size = len(json.dumps(values)) + RESERVE_BYTES
        free = self._wiring.journal.free_bytes()
        if size > free:
            raise Refused(
                f"{name} isn't accepted: its record needs {size:,} bytes on the journal's disk, "
                f"but only {free:,} are free; free some space"
            )

    def record_control(self, number: int, command: bytes) -> None:
        """Write down a command between two lines of the job, before it is sent."""
        self.record("control", n=number, command=command.decode("ascii"))

    def record_back(self, number: int, controls: Sequence[bytes]) -> None:
        """Write down that the last line taken was ``number``, and which commands go again."""
        self._noted = self.progress.known[0]
        self.record("back", done=self._noted, n=number)
        for count, command in enumerate(controls, number + 1):
            self.record_control(count, command)

    def note(self, now: float) -> None:
        """Write down progress and tell the clients."""
        self.next_note = min(now + NOTE_S, max(self._next_due(), now))
        self._note_standstills()
        done = self.progress.known[0]
        if done != self._noted:
            self.record("ack" if done > self._noted else "back", done=done)
            self._noted = done
            self._exchange.tell(self._wiring.on_status, self.status)

    def _note_standstills(self) -> None:
        """Write down where the ink stood still, each by itself: up to a number."""
        found = self.progress.standstills.found
        for one in found:
            self._standstills.append(one)
            count = len(self._standstills)
            self.alarm(
                f"the needle stopped while extruding, {self.progress.standstill_words(one)}; "
                "inspect the part",
                kind=f"standstill {min(count, MAX_STANDSTILLS)}",
            )
        found.clear()

    def stood_s(self, since: int) -> float:
        """Return for how long the ink stood still behind ``since`` lines of the job, s."""
        return sum(one.seconds for one in self._standstills if one.last >= since)

    def _standstill_words(self) -> str:
        """Return what to add to the last message; empty where the ink never stood still."""
        if not self._standstills:
            return ""
        longest = max(self._standstills, key=lambda one: one.seconds)
        where = self.progress.standstill_words(longest)
        if len(self._standstills) == 1:
            return f"; the needle stopped while extruding, {where}"
        total = sum(one.seconds for one in self._standstills)
        many = f"{len(self._standstills)} times, {total:.1f} s in total"
        return f"; the needle stopped while extruding {many}, longest {where}"

    # --- what a person should see ----------------------------------------------------------------

    def alarm(self, text: str, kind: str = "") -> None:
        """Write down what a person must see; the same alarm again is counted.

        Alarms of one ``kind`` are the same; by default those that differ in numbers alone.
        """
        alarm = self._alarms.setdefault(kind or _NUMBER.sub("0", text), _Alarm(text, text))
        alarm.text, alarm.times = text, alarm.times + 1
        if alarm.times == 1:
            self._alarm_count += 1
            self.record("alarm", text=text)
        elif alarm.times & (alarm.times - 1) == 0:  # the 2nd, 4th, 8th: thousands fill no disk
            self._record_times(alarm)

    def _record_times(self, alarm: _Alarm) -> None:
        alarm.written = alarm.times
        self.record("repeated", first=alarm.first, text=alarm.text, times=alarm.times)

    def notice(self, text: str) -> None:
        """Write down what needs no action."""
        self.record("notice", text=text)

    def remark(self, text: str, known: bool) -> None:
        """Write down what the printer said of its own; ``known``: its family's table has it."""
        if known:
            self.alarm(f"the printer says {text!r}")
            return
        if len(self._remarks) < MAX_REMARKS:
            self._remarks.append(text)
        self.alarm(f"the printer says {text!r}, which printctl doesn't know", kind="unknown reply")

    def complain(self, text: str, about_command: bool = False) -> None:
        """Keep a complaint that ends the print; ``about_command``: it may be excused."""
        self._open.append((text, about_command))
        self.complaints += 1

    def take_fault(self) -> str:
        """Return the complaints, and forget them."""
        text, self._open = self.fault, []
        return text

    def excuse(self, before: str = "") -> str:
        """Forget complaints about one command, not about the printer; return them.

        None are forgotten where there were complaints ``before`` that command was sent.
        """
        if before:
            return ""
        excused = [text for text, about_command in self._open if about_command]
        self._open = [one for one in self._open if not one[1]]
        return "; ".join(excused)
