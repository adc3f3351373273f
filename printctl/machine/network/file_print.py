"""State machine of a print whose file a network host runs: upload, start once, follow, end.

The start is the one step that must not be made twice. Its intention is in the journal, on the disk,
before the command leaves. Afterwards the host's own record decides: a file that it reports as
begun, or has in its job history, is followed; one that it reports as selected and not begun, for
`SETTLE_S` on end, may be started again where the first answer was lost; anything else ends the
print as ``position_unknown``, and nothing more is sent. A process that takes a print over goes the
same way.

A start names its file. The file of a lost start is replaced by a copy and deleted before the copy
is started: a start that was held back on the way finds no file, whenever it arrives. A print that
ends before the host has begun its file deletes it for the same reason, or says that it couldn't.

One thread polls and uploads; pause and resume go by a second connection in a thread of their own,
a stop by a third; the emergency stop by a fourth that is open beforehand.
"""

from __future__ import annotations

import hashlib
import logging
import math
import queue
import re
import threading
import time
from bisect import bisect_right
from collections import deque
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property
from http import HTTPStatus
from itertools import accumulate
from typing import Any, Final, NamedTuple

from firmware_profiles import Printer
from printctl.machine.control.board.halting import UNCONFIRMED
from printctl.machine.errors import HostRefused, HostSilent, JournalError, LinkError, Refused
from printctl.machine.job.coordinates import declared_start
from printctl.machine.job.job import Job
from printctl.machine.job.moves import moves_ahead, surely_moved
from printctl.machine.network.host import (
    ACTIVE,
    OVER,
    RUNNING,
    HostAddress,
    HostEnd,
    HostReport,
    HostState,
    PrintHost,
)
from printctl.machine.network.hosts import make_host
from printctl.machine.network.http_client import ReadyConnection
from printctl.machine.records.journal import Journal
from printctl.machine.records.replay import UNANSWERED
from printctl.machine.records.states import LinkState, PrintEnded, Status, state_words

POLL_S: Final = 0.5
SILENT_S: Final = 3.0
"""After so long without an answer the print's state is unknown."""
SETTLE_S: Final = 3.0
"""So long a host must report a file as selected and not begun before it is started again."""
DECIDE_S: Final = 5.0
"""So long a host may report neither the file nor a job history of it after a start."""
CONNECT_S: Final = 4.0
"""So long a host that isn't there or gives no answer is asked again before a print; with one answer
awaited (`ANSWER_S`) a person waits 8 s at most."""
HALT_S: Final = 4.0
"""Longest wait for the host's word that the firmware has halted; the stop is repeated meanwhile."""
SILENT_LIMIT_S: Final = 1800.0
MAX_STARTS: Final = 3
MAX_UPLOADS: Final = 4
_AGAIN_S: Final = 2.0
"""So long after a cancel that the host refused or didn't answer it may be sent again."""
_BEGIN_POLL_S: Final = 0.05
_BUSY_WAIT_S: Final = 5.0
_ASIDE_MM: Final = 0.05
_READ_AHEAD: Final = 32
"""Lines that a host may have read and not given to its printer yet."""
HOST_ENDED: Final = "the needle is where the host's own end left it"
_SAME_START_S: Final = 0.1
_ENDING: Final = ".gcode"
_NAME: Final = re.compile(r"[^a-z0-9_-]+")

_LINK: Final = {
    HostState.PRINTING: LinkState.PRINTING,
    HostState.FINISHING: LinkState.PRINTING,
    HostState.PAUSING: LinkState.PAUSING,
    HostState.PAUSED: LinkState.PAUSED,
    HostState.RESUMING: LinkState.RESUMING,
    HostState.CANCELLING: LinkState.STOPPING,
}
log = logging.getLogger(__name__)


def name_on_host(print_id: str, job_name: str) -> str:
    """Return a file name that no other print has, in characters that every host takes."""
    stem = _NAME.sub("-", job_name.rpartition(".")[0].lower() or job_name.lower())[:40]
    return f"{file_stem(print_id)}{stem.strip('-') or 'job'}{_ENDING}"


def file_stem(print_id: str) -> str:
    """Return how the name of each of a print's files begins on a host."""
    return f"printctl-{print_id}-"


@dataclass(frozen=True)
class HostedJob:
    """A job's file as a host runs it: its bytes, its name there, the tip's checked start, mm."""

    job: Job
    data: bytes
    name: str
    printer: Printer
    start_mm: tuple[float, float, float] | None = None

    @cached_property
    def _ends(self) -> list[int]:
        """Byte of the file behind each command line."""
        ends = [*accumulate(len(line) for line in self.data.splitlines(keepends=True))]
        return [ends[line - 1] for line in self.job.file_lines]

    def lines_read(self, position: int) -> int:
        """Return the command lines in the file's first ``position`` bytes."""
        return bisect_right(self._ends, position)


class _Commands(NamedTuple):
    """A thread's connection to the host, and the commands that it is to give."""

    host: PrintHost
    wanted: queue.Queue[tuple[str, Callable[[str], None]] | None]


class FilePrint:
    """One print on a network host; `run` is its thread's, the rest may be called by any.

    Attributes
    ----------
    on_status : callable
        Given each status.
    stopping, killing : bool
        Whether a person has requested its end.
    """

    def __init__(
        self,
        address: HostAddress,
        key: str,
        hosted: HostedJob,
        journal: Journal,
        on_status: Callable[[Status], None] = lambda status: None,
        silent_limit_s: float | None = None,
    ) -> None:
        self.address, self.hosted, self._journal = address, hosted, journal
        self.actions: deque[dict[str, Any]] = deque()  # requests, for the print's thread to write
        self.on_status, self._silent_limit_s = on_status, silent_limit_s or SILENT_LIMIT_S
        self._host = make_host(address, key)
        self._ready = ReadyConnection(address)
        # A stop doesn't wait for a pause's answer.
        self._commands = _Commands(make_host(address, key), queue.Queue())
        self._stops = _Commands(make_host(address, key), queue.Queue())
        self.stopping = self.killing = False
        self._cancelled_at, self._halted_at, self._halt_taken = 0.0, 0.0, False
        self._cancelling = False  # a cancel waits, or is being sent
        # Lines read when a cancel's answer was missed; inf: not counted yet, -inf: none was.
        self._lost_at = -math.inf
        self._report: HostReport | None = None  # the last one in which the host has its printer
        self._known_at = time.monotonic()
        self._silence = self._words = ""
        self._start_sent = self._answered = self._begun = False
        self._unanswered = ""  # file of a start that the host may not have received yet
        self._begun_s: float | None = None
        self._status = Status(LinkState.CONNECTING, lines_total=len(hosted.job))

    # --- for any thread ------------------------------------------------------------------------

    @property
    def status(self) -> Status:
        """The print as the host reported it last, with the report's age."""
        status = self._status
        if status.ended:
            return status
        if self._begun and time.monotonic() - self._known_at > SILENT_S:
            status = replace(status, state=LinkState.UNKNOWN, position_known=False)
        return replace(status, message=self._said(status))

    def stop(self, by: str = "the user") -> None:
        """End the print in the host's own way; before its start nothing is started."""
        if not self.stopping:
            log.info("cancel requested by %s", by)
        self.stopping = True
        self._cancel()

    def pause(self) -> None:
        """Have the host pause."""
        self._refuse_unless(self._begun, "the print hasn't begun")
        self._commands.wanted.put(("pause", lambda why: None))

    def resume(self, answer: Callable[[str], None]) -> None:
        """Have the host go on; ``answer`` gets why not, empty where it does."""
        paused = self._begun and self._status.state is LinkState.PAUSED
        self._refuse_unless(paused, "the host doesn't report a paused print")
        self._commands.wanted.put(("resume", answer))

    def kill(self) -> None:
        """Halt the firmware at once, by the connection open for it; Refused for another's file."""
        if self._status.ended:
            return
        self.see_no_other_file()
        self.killing = True
        self._halt()

    def see_no_other_file(self) -> None:
        """Raise Refused where the last report, if not too old, says that another file is run."""
        other = self._other_file(self._report)
        if other and time.monotonic() - self._known_at <= SILENT_S:
            raise Refused(
                f"not halted: {self.address} runs {other}; if the printer must stop all the same, "
                "use the host's own emergency stop or cut the power"
            )

    def _refuse_unless(self, right: bool, why: str) -> None:
        if not right or self._status.ended:
            raise Refused(f"{why} ({state_words(self.status.state)}: {self.status.message})")

    def _cancel(self) -> None:
        """Send a cancel, unless one is just being sent: a person's every one, a repeat if due."""
        if not self._cancelling:
            self._cancelling, self._cancelled_at = True, math.inf
            self._stops.wanted.put(("cancel", lambda why: None))

    def _cancel_again(self) -> None:
        """Repeat a cancel; a lost one only where the file is read on: else its macro may run."""
        done = self._status.lines_done
        if self._lost_at == math.inf:
            self._lost_at = done
        elif done > self._lost_at + 1:  # the line that was being made is read to its end
            self._cancel()

    def _halt(self) -> None:
        self._halted_at = time.monotonic()
        try:
            status = self._ready.send(self._host.halt_request())
            self._halt_taken |= status < 300
            log.info("the emergency stop was answered by HTTP %d", status)
        except LinkError as exc:
            log.error("%s", exc)

    # --- the commands' threads -----------------------------------------------------------------

    def _obey(self, commands: _Commands) -> None:
        host = commands.host
        with suppress(LinkError):
            host.identify()  # its session is there beforehand
        while (wanted := commands.wanted.get()) is not None:
            (do, answer), why = wanted, ""
            if self.stopping and do != "cancel":
                answer(f"{do} isn't sent: cancelling is requested")
                continue
            left = False
            try:
                if do == "cancel" and not self._has_begun(host):
                    continue
                if self._begun:  # else `_has_begun` has seen its file
                    self._refuse_other_file(do, host)
                left = True
                getattr(host, do)(self.hosted.name)
            except LinkError as exc:
                left &= isinstance(exc, HostSilent) and exc.sent
                done = "may be done or not, see `printctl status`" if left else "isn't done"
                why = f"{do} {done}: {exc}"
                log.error("%s", why)
                if do != "cancel" and self._begun:
                    self._write("alarm", text=why)
                    self._status = replace(self._status, alarms=self._status.alarms + 1)
            if do == "cancel":
                self._lost_at = math.inf if why and left else -math.inf
                self._cancelled_at = time.monotonic() if why else math.inf
                self._cancelling = False
            answer(why)
        host.close()

    def _has_begun(self, host: PrintHost) -> bool:
        """Wait until the host runs the file, also one whose start has no answer yet, or the end."""
        while not (self._begun or self._status.ended or self.killing):
            name = self._unanswered or self.hosted.name
            with suppress(LinkError):
                if self._start_sent and host.state(name).active_file == name:
                    return True
            time.sleep(_BEGIN_POLL_S)
        return self._begun

    def _refuse_other_file(self, do: str, host: PrintHost) -> None:
        """Raise HostRefused where the host runs another file: no command is for that one.

        Klipper answers a question up to 0.25 s late: to pause or stop, a poll's answer does.
        """
        report = self._report
        if do == "resume" or report is None or time.monotonic() - self._known_at > 2 * POLL_S:
            report = host.state(self.hosted.name)
        if report.active_file not in ("", self.hosted.name):
            raise HostRefused(f"{self.address} runs {report.active_file}")

    def _write(self, sort: str, **values: Any) -> None:
        """Add to the journal; a full disk doesn't keep a print from being followed."""
        try:
            self._journal.add(sort, **values)
        except JournalError as exc:
            log.error("%s", exc)
            if self._journal.use_reserve():
                with suppress(JournalError):
                    self._journal.add(sort, **values)

    def _write_actions(self) -> None:
        while self.actions:
            self._write("action", **self.actions.popleft())

    # --- the print's thread --------------------------------------------------------------------

    def run(self, taken_over: bool = False, step: str = "") -> Status:
        """Print to the end; return the last status.

        ``taken_over``: the journal has an earlier process's part of this print; ``step``: the last
        one there (`JournalledPrint.hosted`).
        """
        started = step not in ("", "selected")
        self._unanswered = self.hosted.name if step in ("start", UNANSWERED) else ""
        for each in (self._commands, self._stops):
            threading.Thread(target=self._obey, args=(each,), name="commands", daemon=True).start()
        self._start_sent, self._host.begun = started, step in ("begun", UNANSWERED)
        try:
            self._connect(patient=started)
            if not started:
                self._prepare(taken_over)
                self._start()
            elif not self._was_begun(answered=False):
                self._start()
            self._follow()
        except PrintEnded as ended:
            halted = self.killing and ended.state is not LinkState.KILLED
            self._end(self._halt_end() if halted else ended)
        except LinkError as exc:
            failed = PrintEnded(LinkState.FAILED, str(exc), not self._begun, type(exc).__name__)
            self._end(self._halt_end() if self.killing else failed)
        finally:
            self._commands.wanted.put(None)
            self._stops.wanted.put(None)
            self._ready.close()
            self._host.close()
        return self._status

    def _connect(self, patient: bool) -> None:
        self._enter(LinkState.CONNECTING, f"asks {self.address}")
        limit = time.monotonic() + CONNECT_S
        while True:
            self._look_for_end()
            try:
                self._words = self._host.identify()
                return
            except (HostSilent, HostRefused) as exc:
                self._silence = str(exc)
                if not patient and (isinstance(exc, HostRefused) or time.monotonic() > limit):
                    raise
            if patient:
                self._unknown("an earlier process began this print, or was about to")
            time.sleep(POLL_S)

    def _prepare(self, taken_over: bool = False, lost: str = "") -> None:
        """Refuse a busy or halted printer; upload, compare what was stored, select.

        ``lost`` is the file of a start that may be under way still; it is deleted.
        """
        hosted = self.hosted
        self._enter(LinkState.CHECKING, f"{self._words}: checks the printer")
        self._refuse_unready(taken_over, lost)
        for attempt in range(1, MAX_UPLOADS + 1):
            try:
                self._host.upload(hosted.name, hosted.data, self._uploading)
                self._compare_stored()
                self._refuse_unready(taken_over, lost)  # an upload takes its time
                self._look_for_end()
                self._host.select(hosted.name)
                if lost:
                    self._delete(lost)
                break
            except HostSilent as exc:  # none of these moves anything
                self._silence = str(exc)
                if attempt == MAX_UPLOADS:
                    raise
                time.sleep(POLL_S * attempt)
        self._journal.add("host", do="selected", file=hosted.name, bytes=len(hosted.data))

    def _delete(self, lost: str) -> None:
        _delete_unbegun(self._host, lost)
        if not self._is_ready(self._poll()):
            raise HostSilent(f"{self.address} doesn't report {self.hosted.name} as selected")
        self._unanswered = ""

    def _uploading(self, share: float) -> None:
        self._look_for_end()
        words = f"{self._words}: uploads, {100 * share:.0f} %"
        if words != self._status.message:
            self._status = replace(self._status, message=words)
            self.on_status(self.status)

    def _refuse_unready(self, taken_over: bool, lost: str) -> None:
        if lost:  # it may come now, and be over before a wait is
            found = self._host.state(lost)
            ready = found.state is HostState.READY and found.file == lost
            if not ready and not self._is_ready(self._poll()):  # the copy may be selected already
                raise HostRefused(f"{self.address} doesn't report {lost} as selected, not begun")
            return
        busy = ACTIVE | {HostState.OFFLINE}
        report = self._await(_BUSY_WAIT_S, lambda one: one.state not in busy)
        if report is None or report.state in busy:
            why = self._silence if report is None else _in_words(report)
            raise Refused(f"{self.address} can't print now: {why}; nothing was started")
        if report.state is HostState.HALTED:
            raise Refused(
                f"{self.address}: the firmware has halted ({report.message}); see to the machine "
                "and restart it by the host's own page; nothing was started"
            )
        if taken_over and report.file == self.hosted.name and report.state is not HostState.READY:
            raise Refused(f"{self.address} has run this file already: {_in_words(report)}")
        self._check_place(report)

    def _check_place(self, report: HostReport) -> None:
        start, place = self.hosted.start_mm, report.place
        if start is None or place is None or declared_start(self.hosted.job) is not None:
            return
        if max(abs(a - b) for a, b in zip(start, place, strict=True)) > _ASIDE_MM:
            raise Refused(
                f"the host says that the tip is at {_place_words(place)}, and the checks took it "
                f"to stand at {_place_words(start)} (--start); nothing was started"
            )

    def _compare_stored(self) -> None:
        hosted = self.hosted
        stored = self._host.stored(hosted.name, hosted.data)
        right = stored.size == len(hosted.data)
        right &= stored.sha1 in ("", hashlib.sha1(hosted.data).hexdigest())
        right &= stored.sha256 in ("", hashlib.sha256(hosted.data).hexdigest())
        if not right:
            raise HostRefused(
                f"{self.address} has stored {stored.size} bytes of {len(hosted.data)}, or others; "
                "nothing was started"
            )

    def _start(self) -> None:
        """Start the file; again only where the host proves that it wasn't begun."""
        for attempt in range(1, MAX_STARTS + 1):
            self._see_selected()
            self._look_for_end()
            self._start_sent = True
            self._journal.add("host", do="start", attempt=attempt, file=self.hosted.name)
            self._answered, self._unanswered = False, self.hosted.name
            try:
                self._host.start(self.hosted.name)
                self._answered = True
            except HostSilent as exc:
                self._silence = str(exc)
            except HostRefused as exc:
                self._silence = str(exc)
                if 400 <= exc.status < 500:
                    self._unanswered = ""
                    if not self._is_begun(self._poll()):
                        words = f"not started, nothing moved: {exc}"
                        raise PrintEnded(LinkState.FAILED, words) from exc
            if self._was_begun(self._answered):
                return
        words = f"not started: {self.address} reports the file as selected, not begun"
        raise PrintEnded(LinkState.FAILED, words)

    def _see_selected(self) -> None:
        """End the print where the host doesn't report the file as selected, a start's proof."""
        report = self._await(SETTLE_S, self._is_ready)
        if not self._is_ready(report):
            said = self._silence if report is None else _in_words(report)
            file = "" if report is None else f", file {report.file or 'none'}"
            words = f"not started: {self.address} doesn't report the file as selected ({said}"
            raise PrintEnded(LinkState.FAILED, f"{words}{file}); is another client at work?")

    def _was_begun(self, answered: bool) -> bool:
        """Return whether the host has begun the file, by its own record alone.

        Raises `PrintEnded` where that can't be known.
        """
        ready_since, lost_since = 0.0, 0.0
        while True:
            report, now = self._poll(), time.monotonic()
            if self.killing:
                self._begun = True
                return True
            if report is None or report.state is HostState.OFFLINE:
                ready_since = lost_since = 0.0
                self._unknown("whether the print has begun isn't known")
            elif report.state is HostState.HALTED:
                raise _halted(report)
            elif self._has_file(report) and report.state is HostState.READY:
                ready_since, lost_since = ready_since or now, 0.0
                if not answered and now - ready_since > SETTLE_S:
                    if self._history():  # begun, ended and selected anew
                        break
                    self._write("host", do="not begun", by=_in_words(report))
                    return not self._replaced()
                if now - ready_since > 10 * SETTLE_S:
                    raise _lost(
                        f"{self.address} was sent a start and doesn't report that the file has "
                        "begun; it isn't started again"
                    )
            elif self._is_begun(report) or self._history():
                break
            else:
                ready_since, lost_since = 0.0, lost_since or now
                if now - lost_since > DECIDE_S:
                    runs, restarted = report.active_file, "it, or its printer, may have restarted"
                    why = f"it runs {runs}" if runs else restarted
                    raise _lost(
                        f"a start was sent to {self.address}, which has no record of the file now "
                        f"({_in_words(report)}; {why}). Whether ink was written isn't known, and "
                        "it isn't started again"
                    )
            time.sleep(POLL_S / 2)
        self._begun = self._host.begun = True
        if self._answered:  # until then a host may only have queued it
            self._unanswered = ""
        do = UNANSWERED if self._unanswered else "begun"  # by its start, or by another client
        self._write("host", do=do, file=self.hosted.name, by=_in_words(report))
        return True

    def _replaced(self) -> bool:
        """Put a copy in the place of the file whose start was lost; False if that has begun."""
        lost = self.hosted
        self.hosted = replace(lost, name=f"{lost.name.removesuffix(_ENDING)}-again{_ENDING}")
        try:
            self._prepare(lost=lost.name)
        except LinkError as exc:
            log.error("%s", exc)
            self.hosted = lost
            return not self._was_begun(answered=True)
        self._start_sent = False
        return True

    def _has_file(self, report: HostReport) -> bool:
        return report.file == self.hosted.name

    def _other_file(self, report: HostReport | None) -> str:
        """Return the file, not this print's, that a report says is run; empty for none."""
        runs = "" if report is None or not report.active_file else report.file
        return "" if runs in (self.hosted.name, self._unanswered) else runs

    def _is_ready(self, report: HostReport | None) -> bool:
        return report is not None and report.state is HostState.READY and self._has_file(report)

    def _is_begun(self, report: HostReport | None) -> bool:
        return report is not None and self._has_file(report) and report.state in ACTIVE | OVER

    def _follow(self) -> None:
        """Follow what the host reports until its end."""
        missing, offline_since = 0, 0.0
        while True:
            ended, report, now = self._history(), self._poll(), time.monotonic()
            if self.killing:
                raise self._halt_end()
            if report is not None and self._has_file(report):
                self._see_one_print(ended.ends if ended else 0, report)
            offline = report is not None and report.state is HostState.OFFLINE
            offline_since = (offline_since or now) if offline else 0.0
            if report is None or offline:
                self._unknown("the print goes on by itself, if it does")
                if report is not None and now - offline_since > 2 * DECIDE_S:
                    self._finish_by_history(ended, report)
            elif report.state is HostState.HALTED:
                raise _halted(report)
            elif report.active_file == self.hosted.name:
                missing = 0
                self._take(report)
                if self.stopping and now - self._cancelled_at > _AGAIN_S:
                    self._cancel_again()
            elif self._has_file(report) and report.state in OVER:
                self._finish(report.state, report)
            else:
                if report.active_file:
                    self._status = replace(self._status, position_known=False)
                    self._enter(LinkState.UNKNOWN, "")
                # A history has ends before the last move.
                if not report.moving or report.active_file:
                    missing += 1
                    self._finish_by_history(ended, report)
                if missing > DECIDE_S / POLL_S:
                    raise _lost(
                        f"{self.address} runs the file no longer ({_in_words(report)}) and has no "
                        "record of its end; it, or its printer, may have restarted"
                    )
            time.sleep(POLL_S)

    def _history(self) -> HostEnd | None:
        """Return what the host's job history has of the file; None where it has nothing."""
        try:
            return self._host.ended(self.hosted.name)
        except LinkError:
            return None

    def _see_one_print(self, ends: int, report: HostReport) -> None:
        """End the print where its file was begun anew; ``report`` is younger than ``ends``."""
        begun_s, runs = report.begun_s, report.state in RUNNING
        if begun_s is not None:
            self._begun_s = begun_s if self._begun_s is None else self._begun_s
            ends += abs(begun_s - self._begun_s) > _SAME_START_S
        if ends > 1 or (ends and runs):
            raise _lost(
                f"the file has ended once on {self.address} and was begun anew, by another client; "
                f"it says {_in_words(report)}"
            )

    def _finish_by_history(self, ended: HostEnd | None, report: HostReport) -> None:
        """End the print where the host's job history has its end."""
        if ended is not None and ended.state is not None:
            self._finish(ended.state, replace(report, message=ended.message))

    def _finish(self, end: HostState, report: HostReport) -> None:
        place, read = (report.place, report.position) if self._has_file(report) else (None, None)
        where = (
            f"the tip is at {_place_words(place)}" if place else "the tip's place isn't reported"
        )
        said = f"{self.address} says {end.value}"
        if end is HostState.COMPLETE and read not in (None, len(self.hosted.data)):
            words = f"{said}, and has read {read} of {len(self.hosted.data)} bytes; {where}"
            raise PrintEnded(LinkState.FAILED, words, known=False)
        if end is HostState.COMPLETE:
            self._status = replace(self._status, lines_done=len(self.hosted.job))
            rests = report.state is not HostState.OFFLINE and not self._other_file(report)
            where += "" if rests else "; whether its motors rest isn't known"
            raise PrintEnded(LinkState.DONE, f"{said}; {where}", rests)
        if self.stopping or end is HostState.CANCELLED:
            by = "the user" if self.stopping else "someone at the host"
            words = f"cancelled by {by}; {said}; {where}; {HOST_ENDED}"
            raise PrintEnded(LinkState.STOPPED, words, known=place is not None)
        raise PrintEnded(LinkState.FAILED, f"{said}: {report.message}", known=False)

    def _halt_end(self) -> PrintEnded:
        """Repeat the emergency stop until the host says that the firmware has halted."""
        limit, words = time.monotonic() + HALT_S, UNCONFIRMED
        while time.monotonic() < limit:
            report = self._poll()
            state = None if report is None else report.state
            if state is HostState.HALTED or (state is HostState.OFFLINE and self._halt_taken):
                words = f"{self.address} says {_in_words(report)}"
                break
            if time.monotonic() - self._halted_at > 1.0:
                self._halt()
            time.sleep(POLL_S / 4)
        return PrintEnded(LinkState.KILLED, f"emergency stop by the user; {words}", known=False)

    def _look_for_end(self) -> None:
        """End a print of which no start is under way, where a person wants that."""
        if self.killing:
            raise self._halt_end()
        if self.stopping and not self._start_sent:
            words = "cancelled by the user before its start; nothing moved"
            raise PrintEnded(LinkState.STOPPED, words)

    # --- what is known -------------------------------------------------------------------------

    def _poll(self) -> HostReport | None:
        """Ask the host for its state; None without an answer."""
        self._write_actions()
        asked_at = time.monotonic()  # the answer may have been under way for as long
        try:
            report = self._host.state(self.hosted.name).without_nonsense(len(self.hosted.data))
        except (HostSilent, HostRefused) as exc:
            self._silence = str(exc)
            self._ready.hold(False)
            return None
        self._ready.hold(True)
        if report.state is HostState.OFFLINE:
            self._silence = f"{self.address} says {_in_words(report)}"
        else:
            self._report, self._known_at, self._silence = report, asked_at, ""
        return report

    def _await(self, limit_s: float, right: Callable[[HostReport], bool]) -> HostReport | None:
        """Poll until a report is right, for so long; return the last one."""
        limit = time.monotonic() + limit_s
        while True:
            report = self._poll()
            if report is not None and right(report):
                return report
            self._look_for_end()
            if time.monotonic() > limit:
                return report
            time.sleep(POLL_S / 4)

    def _take(self, report: HostReport) -> None:
        hosted, status = self.hosted, self._status
        done = status.lines_done
        if report.position is not None:
            done = max(done, hosted.lines_read(report.position))
        behind = max(done - _READ_AHEAD, 0)
        made = surely_moved(hosted.job.lines, behind, moves_ahead(hosted.printer))
        if done != status.lines_done:
            self._write("ack", done=done)
        self._status = replace(
            status,
            lines_done=done,
            lines_executed=max(made, status.lines_executed),
            file_line=hosted.job.file_line(done),
            position_known=True,
        )
        self._enter(_LINK[report.state], "")

    def _unknown(self, why: str) -> None:
        """Say that the state isn't known; end the print after the limit of silence."""
        silent_s = time.monotonic() - self._known_at
        if silent_s > SILENT_S:
            self._status = replace(self._status, position_known=False)
            self._enter(LinkState.UNKNOWN, why)
        if silent_s > self._silent_limit_s:
            words = f"unknown since {_clock(silent_s)}, look at the machine: {self._silence}; {why}"
            raise PrintEnded(LinkState.POSITION_UNKNOWN, words, False, HostSilent.__name__)

    def _said(self, status: Status) -> str:
        """Return the state's message: what the host said last, and how long ago."""
        report, age_s = self._report, time.monotonic() - self._known_at
        asked = "; cancelling is requested" if self.stopping else ""
        if self._lost_at > -math.inf and not self._cancelling:
            asked += ", and its answer was lost: if the print doesn't end, cancel it again"
        if self._begun and age_s <= SILENT_S and (other := self._other_file(report)):
            words = f"{self.address} runs another file, {other} ({_in_words(report)}"
            return f"{words}, {age_s:.1f} s ago){asked}"
        if status.state is LinkState.UNKNOWN:
            since = f"unknown since {_clock(age_s)} ({self._silence or 'no answer yet'})"
            said = "; ".join(filter(None, (since, status.message)))
            return f"{said}; the last report: {_in_words(report)}{asked}"
        if report is None or not self._begun:
            return "; ".join(filter(None, (status.message, self._silence)))
        return f"{self.address} says {_in_words(report)}, {age_s:.1f} s ago{asked}"

    def _enter(self, state: LinkState, message: str) -> None:
        if state is not self._status.state:
            self._write("state", state=state, message=message or _in_words(self._report))
        self._status = replace(self._status, state=state, message=message)
        self.on_status(self.status)

    def _end(self, ended: PrintEnded) -> None:
        late = void_start(lambda: self._host, self._unanswered, self._begun)
        if self._unanswered and not late:
            self._write("host", do="deleted", file=self._unanswered)
        status = replace(
            self._status,
            state=ended.state,
            message=ended.message + late,
            error=ended.error,
            position_known=ended.known,
        )
        if ended.state is LinkState.DONE:
            status = replace(status, lines_executed=status.lines_done)
        self._status = status
        self._write_actions()
        self._write("end", **status.end_record())
        self.on_status(status)


def _delete_unbegun(host: PrintHost, name: str, over: bool = False) -> None:
    """Delete the file of a start that may be under way; LinkError where that isn't certain.

    A file that has begun is left, unless its print is ``over``: with it a host may drop its record.
    """
    if host.state(name).active_file == name or not (over or host.ended(name) is None):
        raise HostRefused("it has started after all; `printctl emergency-stop` halts it")
    with suppress(HostRefused):  # it may be gone already
        host.delete(name)
    try:
        gone = host.stored(name, b"").size < 0
    except HostRefused as exc:
        gone = exc.status == HTTPStatus.NOT_FOUND
    if not gone:
        raise HostSilent("the host doesn't confirm that it is deleted")


def void_start(host: Callable[[], PrintHost], name: str, over: bool = False) -> str:
    """Delete the file of an unanswered start; return what is left to do, for a message.

    ``host`` makes the host. Empty where nothing is: also for no file.
    """
    try:
        if name:
            _delete_unbegun(host(), name, over)
    except LinkError as exc:
        return f"; a start of {name} may still come; delete it on the host ({exc})"
    return ""


def _halted(report: HostReport) -> PrintEnded:
    words = f"the firmware has halted: {report.message}"
    return PrintEnded(LinkState.KILLED, words, known=False)


def _lost(words: str) -> PrintEnded:
    """Return the end of a print of which the host can't say what became of it."""
    words = f"unknown, look at the machine: {words}"
    return PrintEnded(LinkState.POSITION_UNKNOWN, words, known=False)


def _in_words(report: HostReport | None) -> str:
    if report is None:
        return "nothing yet"
    share = "" if report.progress is None else f" {100 * report.progress:.0f} %"
    return f"{report.state.value}{share}" + (f" ({report.message})" if report.message else "")


def _place_words(place: tuple[float, float, float]) -> str:
    return " ".join(f"{axis}{mm:.2f}" for axis, mm in zip("XYZ", place, strict=True))


def _clock(ago_s: float) -> str:
    return time.strftime("%H:%M:%S", time.localtime(time.time() - ago_s))
