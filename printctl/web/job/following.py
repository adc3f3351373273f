"""Thread that follows one running print, whoever started it, and publishes its progress."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any, Final

from printctl.machine.link.client import PrintClient, attach
from printctl.machine.link.errors import LinkError
from printctl.machine.link.record import JOURNAL
from printctl.machine.link.states import Status
from printctl.machine.print_state.state import (
    PrintTruth,
    assemble_state,
    filling_of,
    keep_table,
    remaining_of,
)
from printctl.machine.printing.job_table import JobTable
from printctl.machine.printing.journal_facts import JournalledFacts, read_journal_facts
from printctl.machine.printing.progress import Filling, Progress
from printctl.machine.printing.remaining import Remaining
from printctl.machine.printing.simulated import was_simulated

log = logging.getLogger(__name__)
APART_S: Final = 0.25

Tell = Callable[["PrintReport"], None]


@dataclass(frozen=True)
class PrintReport:
    """A job's print as it was heard of last.

    Attributes
    ----------
    job : str
    truth : PrintTruth
    """

    job: str
    truth: PrintTruth

    @property
    def folder(self) -> Path:
        """Where the print's journal is."""
        return self.truth.folder

    @property
    def status(self) -> Status:
        """State, lines, message."""
        return self.truth.status

    @property
    def journal(self) -> JournalledFacts:
        """What the journal tells."""
        return self.truth.journal

    @property
    def progress(self) -> Progress | None:
        """How far it is; None while the job's table isn't there."""
        return self.truth.progress

    def to_dict(self) -> dict[str, Any]:
        """As a JSON object; what `printctl.web.core` is told."""
        simulated = is_simulated(self.folder, self.journal.started)
        return {"job": self.job, "simulated": simulated, **self.truth.to_dict()}


@lru_cache(maxsize=64)
def is_simulated(folder: Path, started: float) -> bool:
    """Return whether a folder's print, begun at a time, goes to a simulated printer."""
    return was_simulated(folder)


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
        self._journal = JournalledFacts()
        self._told = 0.0
        self._left = threading.Event()
        self.heard: PrintReport | None = None
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
    def session(self) -> str:
        """The link process's work on the print that it follows (`LinkRecord.session`)."""
        return "" if self._client is None else self._client.record.session

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
        journal = read_journal_facts(self.folder / JOURNAL)
        keep_table(self.folder, journal.sha256, table)
        with self._lock:
            self._remaining = remaining_of(table, journal)
            self._table = table
            if self._last is not None:
                self._filling = filling_of(self.folder, journal)
                self._publish(self._last)

    def _hear(self, status: Status) -> None:
        with self._lock:
            before, self._last = self._last, status
            new = before is None or _words(before) != _words(status)
            if before is None or _written_down(before) != _written_down(status):
                self._journal = read_journal_facts(self.folder / JOURNAL)
                self._filling = filling_of(self.folder, self._journal)
            if new or time.monotonic() - self._told >= APART_S:
                self._publish(status)

    def _publish(self, status: Status) -> None:
        self._told = time.monotonic()
        views = self._table, self._remaining, self._filling
        heard = PrintReport(self.job, assemble_state(self.folder, status, self._journal, *views))
        try:
            self._tell(heard)
        except Exception:  # a full disk: the print is followed all the same
            log.exception("what the print of %s does can't be told", self.job)
        self.heard = heard


def _words(status: Status) -> tuple[object, ...]:
    """What a person must be told at once."""
    return status.state, status.message, status.waits_for, status.alarms, status.position_known


def _written_down(status: Status) -> tuple[object, ...]:
    """What changes with a record of the journal that is told of here."""
    return status.state, status.alarms, status.inserted
