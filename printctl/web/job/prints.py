"""Prints of a job: find them, follow them."""

from __future__ import annotations

import contextlib
import logging
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Final

from printctl.machine.link.errors import LinkError, NoLink
from printctl.machine.link.find_link import alive
from printctl.machine.link.record import JOURNAL, RECORD, load_record
from printctl.machine.print_state.actions import PrintAction
from printctl.machine.print_state.state import keep_table, kept_table, read_print
from printctl.machine.printing.job_table import JobTable
from printctl.machine.printing.journal_facts import read_journal_facts
from printctl.machine.station.record import RECORD as STATION_RECORD
from printctl.web.job.following import PrintFollower, PrintReport, Tell
from printctl.web.job.preflight import Preflights, load_table
from printctl.web.job.record import Records
from printctl.web.job.set_up import JobSetUp
from printctl.web.job.set_ups import SetUps
from printctl.web.workspace import Workspace, file_hash, is_name

# Find running prints of a workspace, also those started from the command line.

LOOK_AGAIN_S: Final = 1.0


def prints_of(workspace: Workspace) -> Iterator[tuple[str, Path]]:
    """Job and folder of every print that was ever started in a workspace."""
    folders = [("run", path.parent) for path in workspace.found(f"runs/*/print/{RECORD}")]
    folders += [("file", path.parent) for path in workspace.found(f"jobs/*.print/{RECORD}")]
    for sort, folder in folders:
        name = folder.parent.name if sort == "run" else folder.name.removesuffix(".print")
        if is_name(name):
            yield f"{sort}~{name}", folder


class Finder:
    """A thread that looks for prints that go on.

    Parameters
    ----------
    workspace : Workspace
    found : function
        Given job and folder of a print that goes on, each time that it is seen.
    ended : function
        Given job and folder of the newest print where none goes on, each time that it has changed.
    """

    def __init__(
        self,
        workspace: Workspace,
        found: Callable[[str, Path], None],
        ended: Callable[[str, Path], None],
    ) -> None:
        self._workspace, self._found, self._ended_print = workspace, found, ended
        self._newest: tuple[object, ...] = ()
        self._dead: dict[Path, int] = {}
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._look, name="prints", daemon=True)

    def begin(self) -> None:
        """Start to look."""
        self._thread.start()

    def end(self) -> None:
        """Look no more."""
        self._ended.set()
        self._thread.join(5.0)

    def look(self) -> None:
        """Look once."""
        prints = list(prints_of(self._workspace))
        live = [(job, folder) for job, folder in prints if self._goes_on(folder)]
        for job, folder in live:
            self._found(job, folder)
        if prints and not live:
            self._look_at_newest(max(prints, key=lambda one: _changed(one[1] / RECORD)))

    def _look_at_newest(self, newest: tuple[str, Path]) -> None:
        """Hand on the newest print where anything has changed that its truth rests on."""
        job, folder = newest
        station = self._workspace.station / STATION_RECORD
        now = (folder, *map(_changed, (folder / RECORD, folder / JOURNAL, station)))
        if now != self._newest:
            self._newest = now
            with contextlib.suppress(LinkError, OSError):  # it begins, or goes away, meanwhile
                self._ended_print(job, folder)

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

    def _look(self) -> None:
        while not self._ended.is_set():
            # Without a file handle, say: the next look tells what this one couldn't see.
            with contextlib.suppress(OSError):
                self.look()
            self._ended.wait(LOOK_AGAIN_S)


def _changed(path: Path) -> int:
    """When a file was changed last, ns; 0 for one that isn't there."""
    try:
        return path.stat().st_mtime_ns
    except OSError:
        return 0


_FIRST_WORD_S: Final = 10.0
log = logging.getLogger(__name__)


class Prints:
    """Follows the prints that go on, and tells what it hears of them.

    Parameters
    ----------
    workspace : Workspace
    preflights : Preflights
        They hold the tables that progress is told by.
    set_ups : SetUps
    records : Records
        A print's end is marked in its record.
    tell : function
        Given what was heard of a print that is followed.
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
        self._finder = Finder(workspace, self.follow, self._review)
        self._reviewed: PrintReport | None = None
        self._unwritten: dict[str, float] = {}

    def begin(self) -> None:
        """Look for prints that go on."""
        self._finder.begin()

    def close(self) -> None:
        """Follow no more; prints go on."""
        self._finder.end()
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
            tell: Tell = lambda heard: self._hear(heard, follower)  # noqa: E731
            follower = PrintFollower(job, folder, lambda: self._table(job, folder), tell)
            self._followers[job] = follower
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
        return self._ended(job, folder)

    def heard_soon(self, job: str) -> PrintReport:
        """The first word of a print that is followed.

        Raises
        ------
        LinkError
            When it doesn't come.
        """
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
        """The print that goes on; of several the one begun last."""
        with self._lock:
            heard = [one.heard for one in self._followers.values() if one.heard]
        live = [one for one in heard if not one.status.ended]
        return max(live, key=lambda one: one.journal.started, default=None)

    def unfinished(self) -> PrintReport | None:
        """The newest print of the workspace, if it was broken off and nobody has said what next."""
        with self._lock:
            known = [one.heard for one in self._followers.values()]
        if self.current() is not None:
            return None
        heard = [one for one in (*known, self._reviewed) if one is not None]
        newest = max(heard, key=lambda one: one.journal.started, default=None)
        report = None if newest is None else self.heard(newest.job)
        return report if report is not None and _open(report) else None

    def _review(self, job: str, folder: Path) -> None:
        """Look again at the newest print, which nobody follows, and tell what has changed of it."""
        before = self._reviewed
        heard = PrintReport(job, read_print(folder))
        if before is not None and before == heard:
            return
        self._reviewed = heard
        if _open(heard) or job in self._followers or (before is not None and before.job == job):
            self._tell(heard)

    def _ended(self, job: str, folder: Path) -> PrintReport:
        """A print that is over, from what it left; it is told to nobody."""
        self._keep_known_table(job, folder)
        heard = PrintReport(job, read_print(folder))
        self._note_end(heard)
        return heard

    def _keep_known_table(self, job: str, folder: Path) -> None:
        """Leave the table that a check made beside the journal, if it is of what was printed."""
        sha256 = read_journal_facts(folder / JOURNAL).sha256
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
        printed = read_journal_facts(folder / JOURNAL).sha256
        if printed and printed != file_hash(file):
            return None
        return load_table(self._preflights.of(file, self._set_up_of(job, folder)).table)

    def _set_up_of(self, job: str, folder: Path) -> JobSetUp:
        """What a print was started with, as far as its link's record tells it."""
        printed = self._set_ups.printed(folder)
        if printed is not None:
            return printed
        link = load_record(folder)
        syringe = str(link.care.get("syringe", ""))
        values = self._set_ups.of(job).model_dump() | {"printer": link.profile}
        return JobSetUp.model_validate(values | ({"syringe": syringe} if syringe else {}))


def _open(heard: PrintReport) -> bool:
    """Whether a print was broken off, and neither gone on with nor given up."""
    return heard.status.ended and heard.truth.may(PrintAction.GIVE_UP).possible
