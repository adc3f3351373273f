"""Find the prints of a workspace, also those of the command line; follow them to their end."""

from __future__ import annotations

import contextlib
import logging
import threading
import time
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from printctl.machine.errors import LinkError, NoLink
from printctl.machine.prints.progress import JobTable, Supply
from printctl.machine.prints.state import (
    PrintAction,
    PrintTruth,
    assemble_state,
    keep_table,
    kept_table,
    read_print,
    supply_of,
)
from printctl.machine.process.clients.client import PrintClient, attach
from printctl.machine.process.contact import STATION_RECORD, alive
from printctl.machine.process.simulated import was_simulated
from printctl.machine.records.record import JOURNAL, RECORD, load_record
from printctl.machine.records.replay import JournalReader, read_journal_if_any
from printctl.machine.records.states import Status
from printctl.web.errors import NotFoundError
from printctl.web.job.preflight import Preflights, load_table
from printctl.web.job.record import Records
from printctl.web.job.set_up import JobSetUp, SetUps, read_declared
from printctl.web.workspace import Workspace, file_hash, is_name

log = logging.getLogger(__name__)
APART_S: Final = 0.25
"""Least time between two reports of one print that tell nothing new."""
LOOK_AGAIN_S: Final = 1.0
_FIRST_WORD_S: Final = 10.0


@dataclass(frozen=True)
class PrintReport(PrintTruth):
    """A job's print as it was heard of last."""

    job: str = ""

    @staticmethod
    def of(job: str, truth: PrintTruth) -> PrintReport:
        """Name the job that a print is of."""
        return PrintReport(**vars(truth), job=job)

    def to_dict(self) -> dict[str, Any]:
        """As a JSON object; what `printctl.web.core` is told."""
        return {"job": self.job, "simulated": was_simulated(self.folder), **super().to_dict()}


class PrintFollower:
    """A thread that follows one print to its end, or until it is told to let go.

    ``table_of`` gives the job's table; it may take long, and is called in a thread of its own.
    ``tell`` is given what was heard and by whom, at most four times a second but for what is new.
    """

    def __init__(
        self,
        job: str,
        folder: Path,
        table_of: Callable[[str, Path], JobTable | None],
        tell: Callable[[PrintReport, PrintFollower], None],
    ) -> None:
        self.job, self.folder = job, folder
        self._table_of, self._tell = table_of, tell
        self._table: JobTable | None = None
        self._supply: Supply | None = None
        self._client: PrintClient | None = None
        self._lock, self._left = threading.Lock(), threading.Event()
        self._last: Status | None = None
        self._journal = JournalReader(folder / JOURNAL)
        self._told = 0.0
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
        if self._client is not None:
            self._client.detach()
        self._threads[0].join(5.0)

    @property
    def over(self) -> bool:
        """Whether it has heard of the print's end."""
        return self._last is not None and self._last.ended

    @property
    def session(self) -> str:
        """The link process's work on the print that it follows (`ContactRecord.session`)."""
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
            table = self._table_of(self.job, self.folder)
        except Exception:
            log.warning("no progress for %s", self.job, exc_info=True)
            return
        if table is None:
            return
        supply = supply_of(self.folder)
        with self._lock:
            keep_table(self.folder, self._journal.read().sha256, table)
            self._table, self._supply = table, supply
            if self._last is not None:
                self._publish(self._last)

    def _hear(self, status: Status) -> None:
        with self._lock:
            before, self._last = self._last, status
            new = before is None or _words(before) != _words(status)
            if new or time.monotonic() - self._told >= APART_S:
                self._publish(status)

    def _publish(self, status: Status) -> None:
        self._told = time.monotonic()
        journal = self._journal.read()
        truth = assemble_state(self.folder, status, journal, self._table, self._supply)
        heard = PrintReport.of(self.job, truth)
        try:
            self._tell(heard, self)
        except Exception:  # a full disk: the print is followed all the same
            log.exception("what the print of %s does can't be told", self.job)
        self.heard = heard


def _words(status: Status) -> tuple[object, ...]:
    """What a person must be told at once."""
    return status.state, status.message, status.waits_for, status.alarms, status.position_known


def prints_of(workspace: Workspace) -> Iterator[tuple[str, Path]]:
    """Job and folder of every print that was ever started in a workspace."""
    for path in workspace.found(f"runs/*/print/{RECORD}"):
        if is_name(name := path.parent.parent.name):
            yield f"run~{name}", path.parent
    for path in workspace.found(f"jobs/*.print/{RECORD}"):
        if is_name(name := path.parent.name.removesuffix(".print")):
            yield f"file~{name}", path.parent


def _changed(path: Path) -> int:
    """When a file was changed last, ns; 0 for one that isn't there."""
    try:
        return path.stat().st_mtime_ns
    except OSError:
        return 0


class Prints:
    """Finds the prints that go on, whoever started them, and tells what it hears of them.

    Progress is told by the tables of ``preflights``; a print's end is marked in its record.
    """

    def __init__(
        self,
        workspace: Workspace,
        preflights: Preflights,
        set_ups: SetUps,
        records: Records,
        tell: Callable[[PrintReport], None],
    ) -> None:
        self._workspace, self._preflights, self._set_ups = workspace, preflights, set_ups
        self._records, self._tell = records, tell
        self._followers: dict[str, PrintFollower] = {}
        self._lock, self._noting = threading.Lock(), threading.Lock()
        self._closed = threading.Event()
        self._reviewed: PrintReport | None = None
        self._newest: tuple[object, ...] = ()
        self._dead: dict[Path, int] = {}
        self._unwritten: dict[str, float] = {}
        self._thread = threading.Thread(target=self._look, name="prints", daemon=True)

    def begin(self) -> None:
        """Look for prints that go on."""
        self._thread.start()

    def close(self) -> None:
        """Follow no more; prints go on."""
        self._closed.set()
        self._thread.join(5.0)
        for follower in list(self._followers.values()):
            follower.end()

    def follow(self, job: str, folder: Path) -> None:
        """Follow a print; nothing happens where it is or was followed already.

        A link process that has told of its end lives on until it has written its record.
        """
        session = load_record(folder).session
        with self._lock:
            before = self._followers.get(job)
            if before is not None and (before.session == session if before.over else before.alive):
                return
            self._followers[job] = follower = PrintFollower(job, folder, self._table, self._hear)
            follower.begin()

    def heard(self, job: str) -> PrintReport | None:
        """The job's print as it was heard of last; None when none was ever started."""
        folder = self._workspace.print_folder(job)
        with self._lock:
            follower = self._followers.get(job)
        if follower is not None and follower.heard is not None and not follower.over:
            return follower.heard
        try:
            going_on = not load_record(folder).status and alive(folder)
        except NoLink:
            return None
        if going_on:
            self.follow(job, folder)
            return self.heard_soon(job)
        self._keep_known_table(job, folder)
        heard = PrintReport.of(job, read_print(folder))
        self._note_end(heard)
        return heard

    def last(self, job: str) -> PrintReport:
        """`heard`, of a job that was printed; NotFoundError for another."""
        heard = self.heard(job)
        if heard is None:
            raise NotFoundError(f"no print of {job} was ever started")
        return heard

    def heard_soon(self, job: str) -> PrintReport:
        """The first word of a print that is followed; LinkError when it doesn't come."""
        limit = time.monotonic() + _FIRST_WORD_S
        while time.monotonic() < limit:
            follower = self._followers[job]
            alive = follower.alive  # before it is asked: its last word comes before its end
            if follower.heard is not None:
                return follower.heard
            if not alive:
                break
            time.sleep(0.01)
        raise LinkError(f"the print of {job} doesn't tell where it stands; see its link.log")

    def current(self) -> PrintReport | None:
        """The print that goes on, of several the one begun last.

        Else the newest print of the workspace, if it was broken off and nobody has said what next.
        """
        with self._lock:
            known = [one.heard for one in self._followers.values() if one.heard is not None]
        if going_on := [one for one in known if not one.status.ended]:
            return _newest(going_on)
        newest = _newest([*known, *([self._reviewed] if self._reviewed else [])])
        report = None if newest is None else self.heard(newest.job)
        return report if report is not None and _open(report) else None

    def _look(self) -> None:
        while not self._closed.is_set():
            # Without a file handle, say: the next look tells what this one couldn't see.
            with contextlib.suppress(OSError, LinkError):
                self._look_once()
            self._closed.wait(LOOK_AGAIN_S)

    def _look_once(self) -> None:
        prints = list(prints_of(self._workspace))
        live = [one for one in prints if self._goes_on(one[1])]
        for job, folder in live:
            self.follow(job, folder)
        if prints and not live:
            self._review(*max(prints, key=lambda one: _changed(one[1] / RECORD)))

    def _goes_on(self, folder: Path) -> bool:
        """Whether a link process lives there; one known to be dead isn't asked for its lock again.

        Asking takes the lock for a moment, in which no other process could begin there.
        """
        try:
            changed = (folder / RECORD).stat().st_mtime_ns
            if self._dead.get(folder) == changed:
                return False
            record = load_record(folder)
        except (NoLink, OSError):
            return False
        if not record.status and record.address and alive(folder):
            return True
        if record.status or record.address:
            self._dead[folder] = changed
        return False

    def _review(self, job: str, folder: Path) -> None:
        """Tell of the newest print, which nobody follows, where anything of it has changed."""
        station = self._workspace.station / STATION_RECORD
        now = (folder, *map(_changed, (folder / RECORD, folder / JOURNAL, station)))
        if now == self._newest:
            return
        self._newest, before = now, self._reviewed
        try:
            heard = PrintReport.of(job, read_print(folder))
        except (LinkError, OSError):  # it begins, or goes away, meanwhile
            return
        if before is not None and before == heard:
            return
        self._reviewed = heard
        if _open(heard) or job in self._followers or (before is not None and before.job == job):
            self._tell(heard)

    def _keep_known_table(self, job: str, folder: Path) -> None:
        """Leave the table that a check made beside the journal, if it is of what was printed."""
        sha256 = read_journal_if_any(folder / JOURNAL).sha256
        file, printed = self._workspace.job_file(job), self._set_ups.printed(folder)
        if printed is None or sha256 != file_hash(file) or kept_table(folder, sha256) is not None:
            return
        known = self._preflights.known(file, printed)
        if known is not None:
            keep_table(folder, sha256, load_table(known.table))

    def _hear(self, heard: PrintReport, follower: PrintFollower) -> None:
        """Tell of a print, unless another one of its job is followed by now.

        The table of a long job is made in minutes: it may come after the next print has begun.
        """
        if self._followers.get(heard.job) is not follower:
            return
        if heard.status.ended:
            self._note_end(heard)
        self._tell(heard)

    def _note_end(self, heard: PrintReport) -> None:
        state = heard.status.state.value
        with self._noting:  # whoever comes second finds it all written
            for record in self._records.of_job(heard.job)[-1:]:
                record_values = self._records.load(record)
                if record_values.get("print_id", "") not in ("", heard.journal.print_id):
                    continue  # the next print's record
                if record_values.get("started") and record_values.get("state") != state:
                    self._write_end(record, record_values.get("ended"), state)

    def _write_end(self, record: str, ended: float | None, state: str) -> None:
        """Mark a print's end in its record; where that fails, keep its time for the next try."""
        at = self._unwritten.get(record, time.time() if ended is None else ended)
        try:
            self._records.mark(record, "printctl", ended=at, state=state)
        except OSError as exc:
            if record not in self._unwritten:
                log.error("the end of a print can't be noted in its record %s: %s", record, exc)
            self._unwritten[record] = at
        else:
            self._unwritten.pop(record, None)

    def _table(self, job: str, folder: Path) -> JobTable | None:
        """The table of the file that is printed; None when that file has changed since."""
        file = self._workspace.job_file(job)
        printed = read_journal_if_any(folder / JOURNAL).sha256
        if printed and printed != file_hash(file):
            return None
        return load_table(self._preflights.of(file, self._set_up_of(job, folder)).table)

    def _set_up_of(self, job: str, folder: Path) -> JobSetUp:
        """What a print was started with, as far as its link's record tells it."""
        printed = self._set_ups.printed(folder)
        if printed is not None:
            return printed
        link, values = load_record(folder), self._set_ups.of(job).model_dump()
        start_mm = read_declared(self._workspace.job_file(job), link.profile)
        known = {"syringe": link.care.get("syringe"), "start_mm": start_mm, "printer": link.profile}
        return JobSetUp.model_validate(values | {k: one for k, one in known.items() if one})


def _open(heard: PrintReport) -> bool:
    """Whether a print was broken off, and neither gone on with nor given up."""
    return heard.status.ended and heard.may(PrintAction.GIVE_UP).possible


def _newest(reports: Iterable[PrintReport]) -> PrintReport | None:
    return max(reports, key=lambda one: one.journal.started, default=None)
