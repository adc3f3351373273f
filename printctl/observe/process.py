"""Main function of the observer process: set up, wait for the print, follow it to its end."""

from __future__ import annotations

import logging
import os
import shlex
import shutil
import time
from collections.abc import Callable, Iterable
from contextlib import suppress
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, Final

from design.files import write_text
from printctl.machine.control.look_book import LookDecision
from printctl.machine.errors import LinkError, NoLink, Refused
from printctl.machine.job.job import file_count
from printctl.machine.process.clients.client import PrintClient, attach
from printctl.machine.process.contact import alive, hold_folder
from printctl.machine.records.record import JOURNAL, load_record
from printctl.machine.records.replay import read_journal, read_journal_if_any
from printctl.machine.records.states import LinkState, Status
from printctl.observe.deciding import Decider, FlowControl
from printctl.observe.devices import PICTURE_TIME_SHARE, DeviceError, DeviceSettings, acquire
from printctl.observe.looks.height_maps import read_matrix, try_laser_frame
from printctl.observe.looks.look_context import Look
from printctl.observe.looks.views import EMPTY_LOOK_NUMBER, camera_frame, open_view
from printctl.observe.observed_job import ObservedJob
from printctl.observe.observer import Observer
from printctl.observe.order import ObserverOrder
from printctl.observe.records import (
    OBSERVER_LOCK,
    READY_FILE,
    clear_look_folder,
    read_answer,
)
from printctl.system_errors import explain
from sim.devices.camera.laser_line import ProfilerField
from sim.devices.scanner.oct import OctField

_BEGIN_LIMIT_S: Final = 120.0
"""A print for which its observer was started begins at once, or not at all."""
_POLL_S: Final = 0.1
_MIN_PICTURE_S: Final = 1.0
"""Least time for a look's picture, even if the look's time is up."""
log = logging.getLogger(__name__)


def try_device(order: ObserverOrder, folder: Path) -> None:
    """Raise if the device can't be used; take a picture by a camera, start no scanner.

    Parameters
    ----------
    order : ObserverOrder
    folder : Path
        The print's; a camera's picture is kept as the one before the first look.

    Raises
    ------
    DeviceError
        When camera, folder, program or file isn't there, or the camera's marks have moved.
    UsageError, SimError, ValueError, OSError
        When the frame or a simulated device's file can't be read.
    """
    _try_frame(order)
    device = order.device
    if device.kind == "camera":
        picture = acquire(device, clear_look_folder(folder, EMPTY_LOOK_NUMBER) / "picture")
        open_view(picture, order, 0.0, 0.0)
    elif device.kind == "simulated" and not order.tells_heights:
        acquire(_without_record(device), clear_look_folder(folder, EMPTY_LOOK_NUMBER) / "picture")
    elif device.kind == "folder" and not Path(device.source).is_dir():
        raise DeviceError(
            f"folder {device.source} isn't there; the device's program writes into it (a command "
            "would say {out}, the file to write)"
        )
    elif device.kind == "command":
        program = shlex.split(device.source)[0]
        if shutil.which(program) is None:
            raise DeviceError(f"the device's program {program} isn't there, or may not be run")


def _without_record(device: DeviceSettings) -> DeviceSettings:
    """Return a simulated device without the printer's record, which may be an earlier print's."""
    extra = {name: value for name, value in device.extra.items() if name != "record"}
    return replace(device, extra=extra)


def _try_frame(order: ObserverOrder) -> None:
    if not order.tells_heights:
        camera_frame(order)
    elif order.frame:
        if order.oct:
            read_matrix(Path(order.frame), "an OCT")
        else:
            try_laser_frame(Path(order.frame))
    elif order.oct:
        OctField.load(Path(order.device.extra["oct"]))
    else:
        ProfilerField.load(Path(order.device.extra["laser_line"]))


def observe(folder: Path) -> None:
    """Load all that is needed, try the device, wait for the print, and observe it to its end.

    Raises
    ------
    AlreadyPrinting
        When another observer is at work there.
    LinkError
        When no print begins.
    PrintctlError, OSError, ValueError
        When the order, what it names or the device can't be used.
    """
    with hold_folder(folder, OBSERVER_LOCK, "an observer is at work"):
        order = ObserverOrder.load(folder)
        job = ObservedJob(folder, order)
        job.load()
        try_device(order, folder)
        write_text(folder / READY_FILE, f"{os.getpid()}\n")
        _await_print(folder)
        with attach(folder) as client, attach(folder) as events:
            follow(events.events(), _build_observer(job, client), lambda: client.status)


def _await_print(folder: Path) -> None:
    """Wait until a link process serves the folder.

    Raises
    ------
    NoLink
    """
    limit = time.monotonic() + _BEGIN_LIMIT_S
    while time.monotonic() < limit:
        with suppress(NoLink):
            record = load_record(folder)
            if alive(folder) and record.address and not record.status:
                return
        time.sleep(_POLL_S)
    raise NoLink(f"no print began in {folder} within {_BEGIN_LIMIT_S:g} s")


def follow(events: Iterable[Status], observer: Observer, now: Callable[[], Status]) -> None:
    """Look at each look once, from when the needle is held, until the print is over.

    Events queued during a look arrive after it, when the motors may move again: so ``now``, the
    current status, decides.
    """
    made: set[int] = set()
    for event in events:
        look = active_look(event)
        if look is None or look["number"] in made:
            continue
        with suppress(LinkError):  # if the link is too busy to answer, the event counts
            look = active_look(now())
        if look is None or look["number"] in made:
            continue
        observer.restore_state(look["number"])
        if _handle_look(observer, look):
            made.add(look["number"])


def active_look(status: Status) -> dict[str, Any] | None:
    """Return the look that the print is held for or was decided; None while the motors may move.

    The link reports a look while its lines are still being written and the needle is lifted.
    """
    look = status.look
    if look is None or status.state is LinkState.LOOKING or look["decision"]:
        return look
    return None


def _build_observer(job: ObservedJob, client: PrintClient) -> Observer:
    folder, order = job.folder, job.order
    begun = job.begun = read_journal_if_any(folder / JOURNAL).started
    return Observer(
        folder=folder,
        link=client,
        acquire=partial(_acquire_in_time, job),
        judge=job.judge,
        mend_lines=job.mend_lines,
        decider=Decider(order.limits, FlowControl(order.limits.flow)),
        ended=partial(_has_left_look, client),
        begun=begun,
    )


def _acquire_in_time(job: ObservedJob, look: Look, out: Path) -> Path:
    """Take one of a look's pictures within what time it has."""
    device = job.order.device
    left_s = max(look.until_s - time.monotonic(), _MIN_PICTURE_S)
    device = replace(device, limit_s=min(device.limit_s, left_s))
    return acquire(device, out, job.region(look) if job.order.tells_heights else None)


def _handle_look(observer: Observer, reported: dict[str, Any]) -> bool:
    """Handle a reported look once; any failure pauses the print for the operator.

    False where it is to be made again: the link died meanwhile, and the next one holds the print
    for the same look. What an operator approved isn't tried again once the link has refused it: the
    print would go on at an arbitrary moment.
    """
    number = int(reported["number"])
    try:
        if reported["decision"]:
            kept = observer.find_record(number)
            if reported["decision"] == "pause" and kept is not None and kept.asked:
                if reported["insert_sha256"]:  # it was approved, and is in the job already
                    observer.go_on(number)
                else:
                    observer.ask_again(build_look(reported, observer))
        elif reported["insert_sha256"]:  # put in at the look before, or by an observer that died
            observer.link.decide(number, LookDecision.GO_ON, "mended here already")
        elif _was_answered_go_on(observer, reported):  # while the syringe was changed
            why = "the operator's word at the look before (go_on)"
            observer.link.decide(number, LookDecision.GO_ON, why)
        else:
            record = observer.look(build_look(reported, observer))
            log.info("look %d: %s: %s", record.number, record.decision, record.why)
    except LinkError as exc:
        log.warning("look %d couldn't be decided: %s", number, exc)
        return bool(reported["decision"]) and isinstance(exc, Refused)
    except Exception as exc:  # our own fault must not leave the needle waiting
        log.exception("look %d failed", number)
        reason = explain(exc).message if isinstance(exc, OSError | MemoryError) else exc
        why = f"the observer failed: {reason}"
        with suppress(OSError):  # of a full disk
            observer.note_failure(build_look(reported, observer), why)
        with suppress(LinkError):  # it was decided already
            observer.link.decide(number, LookDecision.PAUSE, why, again=True)
    return True


def _was_answered_go_on(observer: Observer, reported: dict[str, Any]) -> bool:
    """Return whether the look before, at the same place, was answered ``go_on``."""
    before = observer.find_record(int(reported["number"]) - 1)
    if before is None or before.done != reported["done"] or not before.asked:
        return False
    return read_answer(observer.folder, before.number) == "go_on"


def build_look(reported: dict[str, Any], observer: Observer) -> Look:
    """Return the look of a status, with the position of the last judged one."""
    positions = read_journal(observer.folder / JOURNAL).positions
    done = int(reported["done"])
    earlier = [one.done for one in observer.looks if one.has_judgement and one.done < done]
    return Look(
        number=int(reported["number"]),
        done=done,
        job_line=file_count(done, positions),
        before=max(earlier, default=0),
        mark=str(reported["mark"]),
        until_s=time.monotonic() + PICTURE_TIME_SHARE * float(reported["limit_s"]),
    )


def _has_left_look(client: PrintClient, number: int) -> bool:
    """Return whether the print has left a look."""
    look = client.status.look
    return look is None or look["number"] != number
