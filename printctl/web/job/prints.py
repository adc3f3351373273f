"""The prints of a workspace: found whoever started them, followed, and read when they are over."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Final

from printctl.link.errors import LinkError, NoLink
from printctl.link.reach import alive, what_is_known
from printctl.link.record import JOURNAL, load_record
from printctl.web.hashes import file_hash
from printctl.web.job.finding import Finder
from printctl.web.job.following import Heard, PrintFollower
from printctl.web.job.journalled import journalled
from printctl.web.job.preflight import Preflights, load_table
from printctl.web.job.progress import predicted_s, progress
from printctl.web.job.record import Records
from printctl.web.job.remaining import Remaining
from printctl.web.job.set_up import JobSetUp
from printctl.web.job.set_ups import SetUps
from printctl.web.job.table import JobTable
from printctl.web.workspace import Workspace

_FIRST_WORD_S: Final = 10.0


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
        tell: Callable[[Heard], None],
    ) -> None:
        self._workspace, self._preflights, self._set_ups = workspace, preflights, set_ups
        self._records, self._tell = records, tell
        self._followers: dict[str, PrintFollower] = {}
        self._lock = threading.Lock()
        self._finder = Finder(workspace, self.follow)

    def begin(self) -> None:
        """Look for prints that go on."""
        self._finder.begin()

    def close(self) -> None:
        """Follow no more; prints go on."""
        self._finder.end()
        for follower in list(self._followers.values()):
            follower.end()

    def follow(self, job: str, folder: Path) -> None:
        """Follow a print; nothing happens where it is followed already."""
        with self._lock:
            before = self._followers.get(job)
            if before is not None and before.alive and not before.over:
                return
            follower = PrintFollower(job, folder, lambda: self._table(job, folder), self._hear)
            self._followers[job] = follower
            follower.begin()

    def heard(self, job: str) -> Heard | None:
        """The job's print as it was heard of last; None when none was ever started."""
        folder = self._workspace.print_folder(job)
        with self._lock:
            follower = self._followers.get(job)
        if follower is not None and follower.heard is not None:
            return follower.heard
        try:
            going_on = not load_record(folder).status and alive(folder)
        except NoLink:
            return None
        if going_on:
            self.follow(job, folder)
            return self.heard_soon(job)
        return self._ended(job, folder)

    def heard_soon(self, job: str) -> Heard:
        """The first word of a print that is followed.

        Raises
        ------
        LinkError
            When it doesn't come.
        """
        limit = time.monotonic() + _FIRST_WORD_S
        while time.monotonic() < limit:
            found = self._followers[job].heard
            if found is not None:
                return found
            time.sleep(0.01)
        raise LinkError(f"the print of {job} doesn't tell where it stands; see its link.log")

    def current(self) -> Heard | None:
        """The print that goes on; of several the one begun last."""
        with self._lock:
            heard = [one.heard for one in self._followers.values() if one.heard]
        live = [one for one in heard if not one.status.ended]
        return max(live, key=lambda one: one.journal.started, default=None)

    def _ended(self, job: str, folder: Path) -> Heard:
        """A print that is over, from what it left; it is told to nobody."""
        status, journal = what_is_known(folder), journalled(folder / JOURNAL)
        heard = Heard(job, folder, status, journal)
        self._note_end(heard)
        file, said = self._workspace.job_file(job), self._set_ups.printed(folder)
        if said is None or journal.sha256 != file_hash(file):
            return heard
        known = self._preflights.known(file, said)
        if known is None:
            return heard
        table = load_table(known.table)
        at = predicted_s(table, status.lines_executed)
        left = Remaining(float(table.time_s[-1])).estimate(at)
        done = progress(table, status.lines_executed, journal.active_s, time.time(), left)
        return replace(heard, progress=done)

    def _hear(self, heard: Heard) -> None:
        if heard.status.ended:
            self._note_end(heard)
        self._tell(heard)

    def _note_end(self, heard: Heard) -> None:
        for record in self._records.of_job(heard.job)[-1:]:
            found = self._records.load(record)
            if found.get("started") and "ended" not in found:
                state = heard.status.state.value
                self._records.mark(record, "printctl", ended=time.time(), state=state)

    def _table(self, job: str, folder: Path) -> JobTable | None:
        """The table of the file that is printed; None when that file has changed since."""
        file = self._workspace.job_file(job)
        printed = journalled(folder / JOURNAL).sha256
        if printed and printed != file_hash(file):
            return None
        return load_table(self._preflights.of(file, self._set_up_of(job, folder)).table)

    def _set_up_of(self, job: str, folder: Path) -> JobSetUp:
        """What a print was started with, as far as its link's record tells it."""
        said = self._set_ups.printed(folder)
        if said is not None:
            return said
        link = load_record(folder)
        syringe = str(link.care.get("syringe", ""))
        values = self._set_ups.of(job).model_dump() | {"printer": link.profile}
        return JobSetUp.model_validate(values | ({"syringe": syringe} if syringe else {}))
