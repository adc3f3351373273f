"""Service behind the Job page: jobs, set-ups, checks, start, the running print and its record."""

from __future__ import annotations

import asyncio
import contextlib
import threading
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import IO, Any, Final

from firmware_profiles import Printer, ProfileError, Syringe, load
from printctl.checks.kinds import Kind
from printctl.checks.made_for import record_of
from printctl.checks.set_up import NONE, SetUp
from printctl.errors import PrintctlError, SafetyError
from printctl.machine.control.idle.station_status import NO_PRINTER
from printctl.machine.job.care import Care
from printctl.machine.job.job import load_job
from printctl.machine.job.syringes import usable_mm
from printctl.machine.prints.mends import MendStrokes, mend_strokes
from printctl.machine.prints.mounted import keep_confirmed
from printctl.machine.process.clients.starting import running
from printctl.machine.process.orders import Order
from printctl.machine.records.printed_job import grown_in
from printctl.machine.records.record import load_record
from printctl.observe.observer_launch import end_idle_observer, start_observer
from printctl.observe.order import ObserverOrder
from printctl.observe.records import ORDER_FILE
from printctl.pipeline.checked_order import completed
from printctl.web.controls import Principal
from printctl.web.core import Core
from printctl.web.errors import ConflictError, WebError
from printctl.web.job.aftercare import Aftercare, Viability, viability
from printctl.web.job.camera.service import CameraService
from printctl.web.job.jobs import JobEntry, JobId, add_job, all_jobs, entry_of
from printctl.web.job.looks import LookService
from printctl.web.job.machine import (
    Machine,
    StationPrinting,
    set_up_of,
)
from printctl.web.job.preflight import Preflight, PreflightReport, Preflights, key_of, report
from printctl.web.job.print_commands import PrintCommands
from printctl.web.job.prints import PrintReport, Prints
from printctl.web.job.readiness import (
    Readiness,
    Refusal,
    check_refusal,
    ink_refusals,
    machine_refusals,
    record_refusal,
    record_refusals,
)
from printctl.web.job.record import PrintRecord, Records
from printctl.web.job.set_up import (
    PROFILES,
    JobSetUp,
    Place,
    SetUps,
    read_declared,
    recipe_of,
)
from printctl.web.live import JobSource, SceneError
from printctl.web.live.routes import SceneMaker
from printctl.web.profile_store import ProfileStore
from printctl.web.rest import Asking

_FOUND_S: Final = 3.0
"""So long after its start a server knows the print that goes on, which scenes are made behind."""
_LARGEST_BYTES: Final = 100_000_000
"""Two million moves: about two seconds."""


class JobService:
    """The job's room; any thread may call, and calls may block.

    It finds the prints of the workspace that go on, whoever started them, and follows them. The
    printer is the workspace's station by default.
    """

    def __init__(self, core: Core, printing: StationPrinting | None = None) -> None:
        self.core = core
        self.store = ProfileStore(core.workspace.root)
        self.printing = printing or StationPrinting(core.workspace.station)
        self._preflights = Preflights(core.workspace)
        self.set_ups = SetUps(core.workspace)
        self.records = Records(core.workspace.root / "records")
        self.prints = Prints(
            core.workspace, self._preflights, self.set_ups, self.records, self._tell
        )
        self.hands = PrintCommands(core, self.printing)
        self.after = Aftercare(core, self.records, self.printing, self.set_up)
        self.scenes = SceneMaker()
        self.watching = CameraService(core, self.prints)
        self.looks = LookService(core, self.prints)
        self._starting = threading.Lock()
        self.prints.begin()

    def close(self) -> None:
        """Follow no more; prints go on."""
        self.prints.close()
        self.after.close()
        self.watching.close()

    def upload(self, name: str, stream: IO[bytes]) -> JobEntry:
        """Keep an uploaded G-code file; nothing in it is run."""
        workspace, limit = self.core.workspace, int(self.core.settings.upload_mb * 1e6)
        return entry_of(workspace, add_job(workspace, name, stream, limit))

    def scene(self, job: str) -> JobSource:
        """What the live view draws; KeyError when there is no such job."""
        try:
            file, mounted = self.core.workspace.job_file(job), self.set_ups.of(job)
        except WebError as exc:
            raise KeyError(job) from exc
        cache = self.core.workspace.private / "scenes"
        return JobSource(file, cache, mounted.printer, mounted.syringe.partition(",")[0])

    def mends(self, job: JobId) -> list[MendStrokes]:
        """What an observer had written again in the job's last print."""
        file, folder = self.core.workspace.job_file(job), self.core.workspace.print_folder(job)
        printer = load(Printer, load_record(folder).profile)
        return mend_strokes(grown_in(folder, load_job(file, printer)))

    def set_up(self, job: str) -> JobSetUp:
        """The form filled in: as kept last time; else by the run's recipe, and what is mounted."""
        before, kept = self.set_ups.of(job), self.set_ups.kept(job)
        return set_up_of(self.printing.machine(), before, self.declared(job), kept)

    def declared(self, job: str) -> Place | None:
        """Where the job itself says that it starts; None where it starts where the tip stands."""
        printer = self.set_ups.of(job).printer
        return read_declared(self.core.workspace.job_file(job), printer)

    def to_start(self, who: Principal, job: str, start_mm: Place) -> Machine:
        """Bring the tip to where the job starts: up, over, down, within the soft limits."""
        self.core.controls.require(who)
        self.core.workspace.job_file(job)
        self._connected()
        self.printing.to_start(start_mm)
        return self._connected()

    def choices(self, part: str) -> dict[str, str]:
        """Return what may be there as one part, by what `JobSetUp` takes."""
        nothing = {NONE: "nothing there"} if part in ("needle", "bath", "dish") else {}
        return nothing | self.store.choices(PROFILES[part])

    def keep_set_up(self, job: JobId, set_up: JobSetUp) -> JobSetUp:
        """Remember a set-up for a job, and give it filled in with what the printer has measured."""
        self.set_ups.keep(job, self._resolved(set_up))
        return self.set_up(job)

    def preflight(self, job: str, set_up: JobSetUp) -> PreflightReport:
        """Check a job; takes as long as a dry run unless it was checked so before."""
        set_up = self._resolved(set_up)
        checked = self._checked(job, set_up)
        self.set_ups.keep(job, set_up)
        machine = self.printing.machine()
        refusals = [*machine_refusals(machine, set_up), *ink_refusals(machine, checked)]
        return report(job, checked, [one.as_row() for one in refusals])

    def readiness(
        self, who: Principal, job: str, set_up: JobSetUp | None = None, wait: bool = True
    ) -> Readiness:
        """List all that refuses a start, as `start` itself judges it.

        The set-up is as it is filled in if left out. With ``wait`` the job is checked now where it
        wasn't yet, which takes as long as a dry run; not while the printer moves.
        """
        file, machine = self.core.workspace.job_file(job), self.printing.machine()
        set_up = set_up or self.set_up(job)
        unresolved: WebError | None = None
        try:
            set_up = self._resolved(set_up)
        except WebError as exc:
            unresolved = exc
        refusals = [
            *self._others_controls(who),
            *machine_refusals(machine, set_up),
            *record_refusals(machine, self.record(job)),
        ]
        checked, usable, key = None, True, ""
        try:
            if unresolved is not None:
                raise unresolved
            key = key_of(file, set_up)
            observer_order(file, set_up, set_up.mounted())
            checked = self._preflights.known(file, set_up)
            if checked is None and wait and not (machine and machine.state == "busy"):
                checked = self._checked(job, set_up)
        except (PrintctlError, ProfileError) as exc:
            refusals.append(Refusal(Kind.JOB, "job and set-up", str(exc)))
            usable = False
        if checked is not None:
            refusals += ink_refusals(machine, checked)
            if not checked.facts["recorded"]:
                mounted = record_of(set_up.mounted())
                refusals += record_refusal(machine, checked.facts["sha256"], mounted)
            offers = bool(checked.facts["offers_reload"])
            refusals += [check_refusal(one, offers) for one in checked.checks if one.refuses]
        return Readiness(
            job=job,
            ready=checked is not None and not refusals,
            checked=checked is not None or not usable,
            key=key,
            refusals=tuple(refusals),
            machine=machine,
            preflight=None if checked is None else report(job, checked),
        )

    def confirm_set_up(self, who: Asking, job: JobId) -> None:
        """Keep that the job's file was made for its set-up, which it doesn't record itself."""
        self.core.controls.require(who)
        set_up = self._resolved(self.set_up(job))
        sha256 = self._checked(job, set_up).facts["sha256"]
        keep_confirmed(sha256, record_of(set_up.mounted()))

    def record(self, job: JobId) -> PrintRecord:
        """What is written down for the job's next print, or for the one that goes on."""
        self.core.workspace.job_file(job)
        return self.records.values(self.records.current(job))

    def write_down(self, who: Asking, job: JobId, changes: dict[str, Any]) -> PrintRecord:
        """Change the record; what was said before stays in it."""
        self.core.workspace.job_file(job)
        return self.records.change(self.records.current(job), who.by, changes)

    def start(self, who: Principal, job: str, set_up: JobSetUp, confirmed: str) -> PrintReport:
        """Start a print, or find the one that goes on.

        ``confirmed`` is the machine, as `Machine.words` calls it. SafetyError says all that refuses
        the start; ObserverError, LinkError: nothing has moved.
        """
        self.core.controls.require(who)
        with self._starting:  # a second click waits, and then finds the first one's print
            folder = self.core.workspace.print_folder(job)
            going_on = self.prints.heard(job)
            if going_on is not None and not going_on.status.ended:
                return going_on
            readiness = self.readiness(who, job, set_up)
            if readiness.refusals:
                refused = "; ".join(one.sentence() for one in readiness.refusals)
                raise SafetyError(f"the print isn't started: {refused}")
            machine = self._connected()
            if confirmed != machine.words:
                raise ConflictError(
                    f"the start is confirmed for {confirmed[:120] or 'no machine'!r}, and "
                    f"connected is {machine.words!r}; confirm that one"
                )
            set_up = self._resolved(set_up)
            record = self.records.current(job)
            checked = self._checked(job, set_up)
            file = self.core.workspace.job_file(job)
            mounted = set_up.mounted()
            observer = observer_order(file, set_up, mounted)
            order = order_of(file, folder, set_up, mounted, machine, checked, observer)
            client = running(order)
            if client is None:
                with observer_ready(order, observer):
                    self.set_ups.keep_printed(folder, set_up)
                    client = self.printing.start(order)
            client.detach()
            # Crossings are accepted for one print.
            self.set_ups.keep(job, set_up.model_copy(update={"accept_crossings": False}))
            self.records.mark(
                record,
                who.by,
                started=time.time(),
                print_id=client.record.print_id,
                folder=str(folder),
                sha256=checked.facts["sha256"],
                set_up=set_up.model_dump(mode="json"),
                confirmed=confirmed,
                accepted=list(checked.facts["accepted"]),
            )
            self.prints.follow(job, folder)
        return self.prints.heard_soon(job)

    def viability(self, job: JobId) -> Viability:
        """The clock of the cells."""
        set_up = self.set_ups.of(job)
        heard = self.prints.heard(job)
        left = heard.progress.remaining_s if heard and heard.progress else None
        budget = set_up.budget(set_up.mounted())
        ended = heard is not None and heard.status.ended
        return viability(self.record(job), budget, time.time(), None if ended else left)

    def _connected(self) -> Machine:
        machine = self.printing.machine()
        if machine is None:
            raise ConflictError(NO_PRINTER)
        return machine

    def _resolved(self, set_up: JobSetUp) -> JobSetUp:
        """Replace the names of profiles by what loads them; see `ProfileStore.resolve`."""
        machine = self.printing.machine()
        values: dict[str, str] = {}
        used = machine.profiles if machine else ()
        for part, model in PROFILES.items():
            names = getattr(set_up, part).split(",")
            values[part] = ",".join(
                name if name in ("", NONE) else self.store.resolve(model, name, used)
                for name in names
            )
        return set_up.model_copy(update=values)

    def _checked(self, job: str, set_up: JobSetUp) -> Preflight:
        """Check a job, unless it was checked so before."""
        return self._preflights.of(self.core.workspace.job_file(job), set_up)

    def _others_controls(self, who: Principal) -> Iterator[Refusal]:
        holder = self.core.controls.holder
        if holder is not None and holder.id != who.id:
            name = holder.name or "another browser"
            yield Refusal(
                Kind.CONTROLS, "controls", f"{name} holds them; take them over", "controls"
            )

    def _tell(self, heard: PrintReport) -> None:
        self.watching.lapse.hear(heard)
        self.core.events.publish("print", **heard.to_dict())


def observer_order(job: Path, set_up: JobSetUp, mounted: SetUp) -> ObserverOrder | None:
    """Return how a job's print is observed, with what is mounted; None where nobody asks for it.

    The recipe of the run that the G-code file is of may ask for an observer; ConflictError when the
    run's folder doesn't say how.
    """
    folder = job.parent
    recipe = recipe_of(folder)
    if recipe is None or recipe.observe is None:
        return None
    try:
        order = ObserverOrder.load(folder)
    except (OSError, ValueError) as exc:
        raise ConflictError(
            f"the recipe of {folder.name} has its print observed, and {ORDER_FILE} in its folder, "
            f"which says how, can't be read ({exc}): make the run anew (`printctl run RECIPE "
            "--until toolpath`); nothing was moved"
        ) from exc
    syringe = load(Syringe, set_up.syringe)
    return replace(
        order,
        job=str(job.resolve()),
        profile=set_up.printer,
        syringe=set_up.syringe,
        ink=set_up.ink,
        needle=set_up.needle if set_up.profiles["needle"] else order.needle,
        capacity_ul=usable_mm(syringe, mounted.printer) * syringe.area_mm2,
    )


@contextlib.contextmanager
def observer_ready(order: Order, observer: ObserverOrder | None) -> Iterator[None]:
    """Have an observer ready before a print begins, and end it where the print doesn't.

    ObserverError when it can't be started; nothing has moved.
    """
    if observer is None:
        yield
        return
    order.folder.mkdir(0o700, parents=True, exist_ok=True)
    observer.save(order.folder)
    start_observer(order.folder)
    try:
        yield
    except Exception:
        end_idle_observer(order.folder)
        raise


def order_of(
    job: Path,
    folder: Path,
    set_up: JobSetUp,
    mounted: SetUp,
    machine: Machine,
    preflight: Preflight,
    observer: ObserverOrder | None = None,
) -> Order:
    """The order of a job that was checked, with the looks of a run's observer.

    ``mounted`` is what the set-up names; the journal goes into ``folder``.
    """
    order = Order(job, machine.profile, machine.port, folder, once=True)
    order = completed(order, mounted, set_up.care, preflight.plan)
    if observer is None:
        return order
    return replace(order, care=Care.from_dict(order.care.to_dict() | observer.care))


async def make_first_scene(service: JobService) -> None:
    """Have that of the job made which the page will show first, while nobody waits for it yet.

    Scenes are made one at a time: that of a very large job is left until somebody wants it.
    """
    await asyncio.sleep(_FOUND_S)
    with contextlib.suppress(OSError, WebError, KeyError, SceneError):  # the view's own request
        job = await asyncio.to_thread(_first_job, service)  # tells what is wrong with it
        if job is not None and job.size <= _LARGEST_BYTES:
            await service.scenes.scene_file(await asyncio.to_thread(service.scene, job.id))


def _first_job(service: JobService) -> JobEntry | None:
    """The job of the print that goes on or broke off, else the newest."""
    workspace = service.core.workspace
    if current := service.prints.current():
        return entry_of(workspace, current.job)
    return next(iter(all_jobs(workspace)), None)
