"""The job's room: jobs, their checks, the print that goes on, and what is written down of it."""

from __future__ import annotations

import json
import threading
import time
from collections.abc import Iterable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import IO, Any, Final

from design.files import write_text
from printctl.link.errors import LinkError, NoLink
from printctl.link.job import load_job
from printctl.link.reach import alive, what_is_known
from printctl.link.record import JOURNAL, load_record
from printctl.link.recovering import declared_start
from printctl.printing.find import running
from printctl.set_up import Check
from printctl.web.controls import Principal
from printctl.web.core import Core
from printctl.web.errors import ConflictError, WebError
from printctl.web.job.aftercare import Aftercare
from printctl.web.job.camera.watching import Watching
from printctl.web.job.finding import Finder
from printctl.web.job.following import Heard, PrintFollower
from printctl.web.job.hands import PrintHands
from printctl.web.job.jobs import (
    JobEntry,
    add_job,
    entry_of,
    list_jobs,
    recipe_of,
    set_up_of_recipe,
)
from printctl.web.job.journalled import journalled
from printctl.web.job.machine import Machine, Printing, mounted_checks, set_up_of
from printctl.web.job.preflight import Preflight, Preflights, file_hash, load_table, refuse, row
from printctl.web.job.progress import predicted_s, progress
from printctl.web.job.record import PrintRecord, Records
from printctl.web.job.remaining import Remaining
from printctl.web.job.set_up import JobSetUp, refuse_foreign_files
from printctl.web.job.starting import order_of, refuse_unconfirmed
from printctl.web.job.station_printing import StationPrinting
from printctl.web.job.table import JobTable
from printctl.web.job.viability import Viability, viability
from printctl.web.live import JobSource
from printctl.web.live.maker import SceneMaker

SET_UP: Final = "set_up.json"
_LONGEST_LINE: Final = 10_000


class JobService:
    """The job's room; any thread may call, and calls may block.

    It finds the prints of the workspace that go on, whoever started them, and follows them.

    Parameters
    ----------
    core : Core
    printing : Printing, optional
        The workspace's station by default.

    Attributes
    ----------
    core : Core
    records : Records
    hands : PrintHands
        Pause, resume, change of syringe, cancel.
    scenes : SceneMaker
        Of the live view.
    after : Aftercare
        Steps, notes, photos, warming, flushing.
    watching : Watching
        The camera, the time-lapses.
    """

    def __init__(self, core: Core, printing: Printing | None = None) -> None:
        self.core = core
        self.printing: Printing = printing or StationPrinting(core.workspace.station)
        self._facts = core.workspace.private / "jobs"
        self._preflights = Preflights(core.workspace.private / "preflight")
        self.records = Records(core.workspace.root / "records")
        self.hands = PrintHands(core)
        self.after = Aftercare(core, self.records, self.printing, self.set_up)
        self.scenes = SceneMaker()
        self.watching = Watching(core)
        self._followers: dict[str, PrintFollower] = {}
        self._lock = threading.Lock()
        self._starting = threading.Lock()
        self._finder = Finder(core.workspace, self._follow)
        self._finder.begin()

    def close(self) -> None:
        """Follow no more; prints go on."""
        self._finder.end()
        self.after.close()
        self.watching.close()
        for follower in list(self._followers.values()):
            follower.end()

    # --- jobs ----------------------------------------------------------------------------------

    def jobs(self) -> list[JobEntry]:
        """Every job, the newest first."""
        return list_jobs(self.core.workspace, self._facts)

    def job(self, job: str) -> JobEntry:
        """One job."""
        return entry_of(self.core.workspace, job, self._facts)

    def upload(self, name: str, parts: IO[bytes] | Iterable[bytes]) -> JobEntry:
        """Keep an uploaded G-code file; nothing in it is run."""
        limit = int(self.core.settings.upload_mb * 1e6)
        return self.job(add_job(self.core.workspace, name, parts, limit))

    def scene(self, job: str) -> JobSource:
        """What the live view draws.

        Raises
        ------
        KeyError
            When there is no such job.
        """
        try:
            file, said = self.core.workspace.job_file(job), self._own_set_up(job)
        except WebError as exc:
            raise KeyError(job) from exc
        cache = self.core.workspace.private / "scenes"
        return JobSource(file, cache, said.printer, said.syringe.partition(",")[0])

    # --- before the print ----------------------------------------------------------------------

    def machine(self) -> Machine | None:
        """The printer that is connected."""
        return self.printing.machine()

    def set_up(self, job: str) -> JobSetUp:
        """The form filled in: as last time, else by the run's recipe; the printer knows better."""
        declared = _declared(self.core.workspace.job_file(job))
        return set_up_of(self.printing.machine(), self._own_set_up(job), declared)

    def to_start(self, who: Principal, job: str, start_mm: tuple[float, float, float]) -> Machine:
        """Bring the tip to where the job starts: up, over, down, within the soft limits.

        Raises
        ------
        NotInControlError, ConflictError, SafetyError, LinkError
        """
        self.core.controls.require(who)
        self.core.workspace.job_file(job)
        self._connected()
        self.printing.to_start(start_mm)
        return self._connected()

    def preflight(self, job: str, said: JobSetUp) -> dict[str, Any]:
        """Check a job; takes as long as a dry run unless it was checked so before.

        Returns
        -------
        dict
            ``checks`` (each with its answer in a word), ``passed``, ``key`` and what was found.
        """
        found = self._looked_at(job, said)
        mounted = self._against_mounted(said, found)
        return {
            "job": job,
            "key": found.key,
            "passed": found.passed and not any(check.refuses for check in mounted),
            "checks": [*map(row, mounted), *found.rows()],
            **found.facts,
        }

    def record(self, job: str) -> PrintRecord:
        """What is written down for the job's next print, or for the one that goes on."""
        return self.records.values(self.records.current(job))

    def write_down(self, who: Principal, job: str, said: Mapping[str, Any]) -> PrintRecord:
        """Change the record; what was said before stays in it."""
        self.core.workspace.job_file(job)
        return self.records.change(self.records.current(job), who.name or who.id, said)

    # --- the print -----------------------------------------------------------------------------

    def start(self, who: Principal, job: str, said: JobSetUp, confirmed: str) -> Heard:
        """Start a print, or find the one that goes on.

        Parameters
        ----------
        who : Principal
        job : str
        said : JobSetUp
        confirmed : str
            The machine, as `Machine.words` calls it.

        Raises
        ------
        NotInControlError, SafetyError, ConflictError, BadRequestError, LinkError
        """
        self.core.controls.require(who)
        with self._starting:  # a second click waits, and then finds the first one's print
            folder = self.core.workspace.print_folder(job)
            going_on = self.heard(job)
            if going_on is not None and not going_on.status.ended:
                return going_on
            machine = self._connected()
            record = self.records.current(job)
            refuse_unconfirmed(machine, self.records.values(record), confirmed)
            found = self._looked_at(job, said)
            refuse([*self._against_mounted(said, found), *found.checks])
            file = self.core.workspace.job_file(job)
            order = order_of(file, folder, said, said.mounted(), machine, found)
            client = running(order)
            if client is None:
                folder.mkdir(parents=True, exist_ok=True)
                write_text(folder / SET_UP, said.model_dump_json(indent=1) + "\n")
                client = self.printing.start(order)
            client.detach()
            self.records.mark(
                record,
                who.name or who.id,
                started=time.time(),
                folder=str(folder),
                sha256=found.facts["sha256"],
                set_up=said.model_dump(mode="json"),
                confirmed=confirmed,
                accepted=list(found.facts["accepted"]),
            )
            self._follow(job, folder)
        return self._heard_soon(job)

    def heard(self, job: str) -> Heard | None:
        """The job's print as it was heard of last; None when none was ever started."""
        folder = self.core.workspace.print_folder(job)
        with self._lock:
            follower = self._followers.get(job)
        if follower is not None and follower.heard is not None:
            return follower.heard
        try:
            going_on = not load_record(folder).status and alive(folder)
        except NoLink:
            return None
        if going_on:
            self._follow(job, folder)
            return self._heard_soon(job)
        return self._ended(job, folder)

    def current(self) -> Heard | None:
        """The print that goes on; of several the one begun last."""
        with self._lock:
            heard = [one.heard for one in self._followers.values() if one.heard]
        live = [one for one in heard if not one.status.ended]
        return max(live, key=lambda one: one.journal.started, default=None)

    def viability(self, job: str) -> Viability:
        """The clock of the cells."""
        said = self._own_set_up(job)
        heard = self.heard(job)
        left = heard.progress.remaining_s if heard and heard.progress else None
        budget = said.budget(said.mounted())
        ended = heard is not None and heard.status.ended
        return viability(self.record(job), budget, time.time(), None if ended else left)

    # --- between -------------------------------------------------------------------------------

    def _connected(self) -> Machine:
        machine = self.printing.machine()
        if machine is None:
            raise ConflictError("no printer is connected; connect it on the page Printer")
        return machine

    def _looked_at(self, job: str, said: JobSetUp) -> Preflight:
        machine = self.printing.machine()
        known = {machine.profile, *machine.mounted.values()} if machine else set()
        refuse_foreign_files(said, self.core.workspace.root, frozenset(known))
        found = self._preflights.of(self.core.workspace.job_file(job), said)
        write_text(self._facts / f"{found.facts['sha256']}.json", json.dumps(found.facts) + "\n")
        self._keep_set_up(job, said)
        return found

    def _against_mounted(self, said: JobSetUp, found: Preflight) -> list[Check]:
        ink_ul = float(found.facts.get("ink_pushed_ul", 0.0))
        return mounted_checks(self.printing.machine(), said, ink_ul)

    def _own_set_up(self, job: str) -> JobSetUp:
        """As it was said for this job last, else by its recipe and its first lines."""
        kept = self._kept(job)
        if kept.is_file():
            return JobSetUp.model_validate_json(kept.read_text(encoding="utf-8"))
        path, said = self.core.workspace.job_file(job), JobSetUp()
        recipe = recipe_of(path.parent) if job.startswith("run~") else None
        if recipe is not None:
            said = set_up_of_recipe(recipe, said)
        declared = _declared(path)
        return said if declared is None else said.model_copy(update={"start_mm": declared})

    def _kept(self, job: str) -> Path:
        self.core.workspace.job_file(job)
        return self.core.workspace.private / "set_ups" / f"{job}.json"

    def _keep_set_up(self, job: str, said: JobSetUp) -> None:
        write_text(self._kept(job), said.model_dump_json() + "\n")

    def _follow(self, job: str, folder: Path) -> None:
        with self._lock:
            before = self._followers.get(job)
            if before is not None and before.alive and not before.over:
                return
            follower = PrintFollower(job, folder, lambda: self._table(job, folder), self._tell)
            self._followers[job] = follower
            follower.begin()

    def _ended(self, job: str, folder: Path) -> Heard:
        """A print that is over, from what it left; it is told to nobody."""
        status, journal = what_is_known(folder), journalled(folder / JOURNAL)
        heard = Heard(job, folder, status, journal)
        self._note_end(heard)
        file = self.core.workspace.job_file(job)
        if journal.sha256 != file_hash(file) or not (folder / SET_UP).is_file():
            return heard
        said = JobSetUp.model_validate_json((folder / SET_UP).read_text(encoding="utf-8"))
        known = self._preflights.known(file, said)
        if known is None:
            return heard
        table = load_table(known.table)
        at = predicted_s(table, status.lines_executed)
        done = progress(
            table,
            status.lines_executed,
            journal.active_s,
            time.time(),
            Remaining(float(table.time_s[-1])).estimate(at),
        )
        return replace(heard, progress=done)

    def _heard_soon(self, job: str) -> Heard:
        limit = time.monotonic() + 10.0
        while time.monotonic() < limit:
            found = self._followers[job].heard
            if found is not None:
                return found
            time.sleep(0.01)
        raise LinkError(f"the print of {job} doesn't tell where it stands; see its link.log")

    def _tell(self, heard: Heard) -> None:
        if heard.status.ended:
            self._note_end(heard)
        self.watching.hear(heard)
        self.core.events.publish("print", **heard.to_dict())

    def _note_end(self, heard: Heard) -> None:
        for record in self.records.of_job(heard.job)[-1:]:
            found = self.records.load(record)
            if found.get("started") and "ended" not in found:
                self.records.mark(
                    record, "printctl", ended=time.time(), state=heard.status.state.value
                )

    def _table(self, job: str, folder: Path) -> JobTable | None:
        """The table of the file that is printed; None when that file has changed since."""
        link = load_record(folder)
        said = self._set_up_of_print(job, folder, link.profile, str(link.care.get("syringe", "")))
        file = self.core.workspace.job_file(job)
        printed = journalled(folder / JOURNAL).sha256
        if printed and printed != file_hash(file):
            return None
        return load_table(self._preflights.of(file, said).table)

    def _set_up_of_print(self, job: str, folder: Path, profile: str, syringe: str) -> JobSetUp:
        path = folder / SET_UP
        if path.is_file():
            return JobSetUp.model_validate_json(path.read_text(encoding="utf-8"))
        said = self._own_set_up(job).model_dump()
        said |= {"printer": profile} | ({"syringe": syringe} if syringe else {})
        return JobSetUp.model_validate(said)


def _declared(path: Path) -> tuple[float, float, float] | None:
    """Where the job tells the firmware that the tip stands; None where it doesn't, or can't."""
    try:
        job = load_job(path, _LONGEST_LINE)
        return declared_start(job, len(job))
    except LinkError:
        return None
