"""Follows a print that goes on, whoever started it, and tells how far it has come."""

from __future__ import annotations

import contextlib
import logging
import math
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from firmware_profiles import Syringe, load
from printctl.link.care import Care
from printctl.link.client import PrintClient, attach
from printctl.link.errors import LinkError
from printctl.link.record import JOURNAL
from printctl.link.states import LinkState, Status
from printctl.web.job.journalled import Journalled, journalled
from printctl.web.job.progress import Filling, Progress, predicted_s, progress
from printctl.web.job.remaining import Remaining
from printctl.web.job.table import JobTable

log = logging.getLogger(__name__)
APART_S: Final = 0.25

Tell = Callable[["Heard"], None]


@dataclass(frozen=True)
class Heard:
    """A print as it was heard of last.

    Attributes
    ----------
    job : str
    folder : Path
    status : Status
    journal : Journalled
    progress : Progress or None
        None while the job's table isn't there.
    """

    job: str
    folder: Path
    status: Status
    journal: Journalled
    progress: Progress | None = None

    def to_dict(self) -> dict[str, Any]:
        """As a JSON object; what `printctl.web.events` is told."""
        return {
            "job": self.job,
            "folder": str(self.folder),
            **self.status.to_dict(),
            "started": self.journal.started,
            "progress": None if self.progress is None else self.progress.to_dict(),
        }


class PrintFollower:
    """A thread that follows one print to its end, or until it is told to let go.

    Parameters
    ----------
    job : str
    folder : Path
        The print's.
    table_of : function
        Gives the job's table; may take long, and is called in a thread of its own.
    tell : function
        Given what was heard, at most four times a second but for what is new.
    """

    def __init__(
        self, job: str, folder: Path, table_of: Callable[[], JobTable | None], tell: Tell
    ) -> None:
        self.job, self.folder = job, folder
        self._table_of, self._tell = table_of, tell
        self._table: JobTable | None = None
        self._remaining: Remaining | None = None
        self._filling: Filling | None = None
        self._client: PrintClient | None = None
        self._lock = threading.Lock()
        self._last: Status | None = None
        self._journal = Journalled()
        self._told = 0.0
        self._left = threading.Event()
        self.heard: Heard | None = None
        self._threads = [
            threading.Thread(target=work, name=f"{job} {name}", daemon=True)
            for name, work in (("print", self._follow), ("table", self._prepare))
        ]

    def begin(self) -> None:
        """Start to follow."""
        for thread in self._threads:
            thread.start()

    def end(self) -> None:
        """Let go of the print, which goes on."""
        self._left.set()
        client = self._client
        if client is not None:
            client.detach()
        self._threads[0].join(5.0)

    @property
    def over(self) -> bool:
        """Whether it has heard of the print's end."""
        return self._last is not None and self._last.ended

    @property
    def alive(self) -> bool:
        """Whether it still follows."""
        return self._threads[0].is_alive()

    def _follow(self) -> None:
        try:
            self._client = client = attach(self.folder)
            for status in client.events():
                if self._left.is_set():
                    return
                self._hear(status)
        except (LinkError, OSError) as exc:
            log.warning("the print in %s can't be followed: %s", self.folder, exc)

    def _prepare(self) -> None:
        """Make or load the table, which may take as long as a dry run."""
        try:
            table = self._table_of()
        except Exception:
            log.warning("no progress for %s", self.job, exc_info=True)
            return
        if table is None:
            return
        with self._lock:
            self._remaining = Remaining(float(table.time_s[-1]))
            self._table = table
            if self._last is not None:
                self._refill(self._last)
                self._publish(self._last)

    def _hear(self, status: Status) -> None:
        with self._lock:
            before, self._last = self._last, status
            new = before is None or _words(before) != _words(status)
            if before is None or before.state is not status.state:
                self._journal = journalled(self.folder / JOURNAL)
                self._refill(status)
            if new or time.monotonic() - self._told >= APART_S:
                self._publish(status)

    def _publish(self, status: Status) -> None:
        self._told = time.monotonic()
        now = time.time()
        heard = Heard(self.job, self.folder, status, self._journal, self._progress(status, now))
        try:
            self._tell(heard)
        except Exception:  # a full disk: the print is followed all the same
            log.exception("what the print of %s does can't be told", self.job)
        self.heard = heard

    def _progress(self, status: Status, now: float) -> Progress | None:
        table, remaining = self._table, self._remaining
        if table is None or remaining is None or len(table) != status.lines_total:
            return None
        executed = executed_of(status)
        active = self._journal.active_until(now)
        at = predicted_s(table, executed)
        if status.state is LinkState.PRINTING:
            remaining.saw(at, active)
        return progress(table, executed, active, now, remaining.estimate(at), self._filling)

    def _refill(self, status: Status) -> None:
        """Which syringe is in use; nobody knows it of several heads."""
        if self._client is None or self._table is None:
            return
        care = Care.from_dict(self._client.record.care)
        if care.head_capacity_mm or not care.syringe or not care.capacity_mm:
            return
        with contextlib.suppress(Exception):  # a profile that is gone: the ink left isn't told
            bore = load(Syringe, care.syringe).inner_mm
            at, used = self._journal.filled or (0, 0.0)
            self._filling = Filling(at, care.capacity_mm - used, math.pi / 4 * bore**2)


def executed_of(status: Status) -> int:
    """Commands whose motion has been made."""
    return status.lines_executed


def _words(status: Status) -> tuple[object, ...]:
    """What a person must be told at once."""
    return status.state, status.message, status.waits_for, status.alarms, status.position_known
