"""Continue a print: after a pause, a syringe change, or the death of its link process."""

from __future__ import annotations

from pathlib import Path
from typing import Final

from firmware_profiles import Printer, Syringe, load
from printctl.errors import PrintctlError, UsageError
from printctl.machine.job.care import Care, NewSyringe
from printctl.machine.job.marks import MarkKind
from printctl.machine.job.syringes import usable_mm
from printctl.machine.ports.detection import runs_files
from printctl.machine.prints.mounted import refuse_remounted
from printctl.machine.prints.state import refuse_forgotten
from printctl.machine.process.clients.client import PrintClient, attach
from printctl.machine.process.clients.starting import resume_print
from printctl.machine.process.contact import alive
from printctl.machine.process.outcome import resumable
from printctl.machine.records.record import JOURNAL, load_record
from printctl.machine.records.replay import read_journal_if_any
from printctl.machine.records.states import LinkState, Status, state_words
from printctl.observe.observer_launch import end_idle_observer, ensure_observer
from printctl.observe.records import OBSERVER_LOCK, look_awaiting_answer, read_looks

_RUNNING_STATES: Final = (LinkState.CONNECTING, LinkState.CHECKING, LinkState.PRINTING)


def continue_print(
    folder: Path,
    *,
    port: str | None = None,
    syringe: str | None = None,
    plunger_mm: float | None = None,
    unchanged: bool = False,
    unobserved: bool = False,
) -> Status:
    """Resume the print in ``folder``; return its status.

    An observed print without a running observer gets a new one first. If its last look waits for
    an answer, the new observer asks again, and the print stays paused.

    Parameters
    ----------
    folder : Path
    port : str, optional
        When the printer's port has another name now.
    syringe : str, optional
        Profile of the syringe that was put in, where it is another.
    plunger_mm : float, mm, optional
        Travel that its plunger has used up; 0 for a full one.
    unchanged : bool
        The syringe wasn't changed after all.
    unobserved : bool
        Go on without an observer: each look then becomes a pause.

    Raises
    ------
    UsageError
        When the arguments contradict each other.
    ObserverError
        When no observer can be started; nothing has moved.
    PrintctlError
        When the print isn't paused, or its observer is judging a look.
    SafetyError
        When other parts are mounted than the file was made for.
    LinkError
        When the printer can't be reached, or the print can't be resumed.
    """
    changed = syringe is not None or plunger_mm is not None
    if unchanged and changed:
        raise UsageError("the syringe is either unchanged or a new one; say one of both")
    with attach(folder) as attached:
        status = attached.status
    _refuse_status(folder, status, changed, unchanged, unobserved)
    refuse_remounted(folder)
    started = not (status.ended or unobserved) and ensure_observer(folder)
    with restart(folder, port, unobserved) if status.ended else attach(folder) as client:
        if status.ended and client.status.state is not LinkState.PAUSED:
            if changed and not client.status.ended:
                raise PrintctlError(
                    f"the print in {folder} goes on with the syringe that was given before its "
                    "link process died; the one given now isn't used"
                )
            return client.status
        change = new_syringe_of(client, syringe, plunger_mm) if changed else None
        if not awaits_observer(folder, client.status, started):
            client.resume(change, unchanged, unobserved)
        return client.status


def _refuse_status(
    folder: Path, status: Status, changed: bool, unchanged: bool, unobserved: bool
) -> None:
    """Refuse to resume a print that isn't paused, or with a syringe that it can't take.

    Raises
    ------
    PrintctlError
    """
    if status.state in _RUNNING_STATES and not status.waits_for and not (changed or unchanged):
        raise PrintctlError(
            f"the print in {folder} isn't paused ({state_words(status.state)}: {status.message})"
        )
    if changed and status.ended:
        _refuse_unchanged(folder)
    if not unobserved:
        _refuse_in_look(folder, status)


def _refuse_in_look(folder: Path, status: Status) -> None:
    """Refuse to resume while an observer judges a look: its gaps would not be mended.

    Raises
    ------
    PrintctlError
    """
    look = status.look
    if status.state is not LinkState.LOOKING or look is None or not alive(folder, OBSERVER_LOCK):
        return
    raise PrintctlError(
        f"look {look['number']} is being judged, and the print in {folder} isn't paused: it goes "
        f"on when that is decided, and is paused where that takes more than {look['limit_s']:g} s "
        "(observe.limit_s). `printctl resume RUN --unobserved` goes on without this look"
    )


def awaits_observer(folder: Path, status: Status, started: bool) -> bool:
    """Return whether a print stays held for an observer that was just ``started``.

    Otherwise a look's picture would show the needle, and a question of the dead observer would be
    lost: the new one asks it again.
    """
    if not started or status.state is LinkState.LOOKING:
        return started
    looks = read_looks(folder, read_journal_if_any(folder / JOURNAL).started)
    return not status.waits_for and look_awaiting_answer(looks, status) is not None


def _refuse_unchanged(folder: Path) -> None:
    """Refuse a new syringe unless the print was held for one when its process died.

    Raises
    ------
    PrintctlError
    """
    history = resumable(folder)
    if history.reload is not None:
        return
    requested = history.wanted is not None and history.wanted["after"] == MarkKind.RELOAD
    then = "the change asked for is made first" if requested else "`printctl reload RUN` makes room"
    raise PrintctlError(
        f"when its link process died, the print in {folder} wasn't held for a change of syringe "
        f"(last {state_words(history.state)}), so it takes no new one; `printctl resume RUN` "
        f"without --syringe and --plunger-mm, then {then}"
    )


def restart(folder: Path, port: str | None = None, unobserved: bool = False) -> PrintClient:
    """Go on with a print whose link process died or lost its port; ask its last line first.

    Raises
    ------
    ObserverError
        When it is one with looks, and no observer can be started; unless ``unobserved``.
    LinkError
        See `resume_print`; `Refused` where the printer has certainly forgotten its place.
    """
    record = load_record(folder)
    if runs_files(record.port):
        return resume_print(folder, port)
    resumable(folder)  # how it ended comes first; what the printer knows matters only then
    refuse_forgotten(folder, port or record.port, load(Printer, record.profile))
    if not unobserved:
        ensure_observer(folder)
    try:
        return resume_print(folder, port)
    except Exception:
        end_idle_observer(folder)
        raise


def new_syringe_of(
    client: PrintClient, syringe: str | None, plunger_mm: float | None
) -> NewSyringe:
    """Return what was put in, for the syringe that a paused print waits for.

    Raises
    ------
    UsageError
        When its bore isn't the last one's: the job's plunger travel holds for one bore only.
    """
    what, _, number = client.status.waits_for.partition(" ")
    head = int(number) if what == "syringe" and number else None  # of several
    if syringe is None:  # one like the last
        return NewSyringe(plunger_mm or 0.0)
    new = load(Syringe, syringe)
    before, _ = Care.from_dict(client.record.care).of_head(head)
    if before and (old := load(Syringe, before)).inner_mm != new.inner_mm:
        raise UsageError(
            f"{new.name} ({syringe}) has a bore of {new.inner_mm:g} mm, {old.name} ({before}) of "
            f"{old.inner_mm:g} mm: the job's plunger travel would give another volume; put in "
            "one of the same bore"
        )
    machine = load(Printer, client.record.profile)
    return NewSyringe(plunger_mm or 0.0, syringe, usable_mm(new, machine.of_head(head or 0)))
