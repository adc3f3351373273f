"""Find a job's print in a folder (running, ended or interrupted), or start one."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

from firmware_profiles import Printer, load
from printctl.errors import PrintctlError, SafetyError
from printctl.machine.errors import LinkError, NoLink
from printctl.machine.families import refuse_unsent
from printctl.machine.job.care import Care
from printctl.machine.job.retreat import Retreat
from printctl.machine.process.client import PrintClient, attach, resume_print, start_print
from printctl.machine.process.executed_note import is_complete_record, record_for
from printctl.machine.process.resuming import resumable
from printctl.machine.process.simulated import SIMULATED, was_simulated
from printctl.machine.records.record import JOURNAL
from printctl.machine.records.replay import read_journal
from printctl.machine.records.states import LinkState


@dataclass(frozen=True)
class Order:
    """What is to be printed where.

    Attributes
    ----------
    job : Path
        G-code file.
    printer : str
        Profile, by name or path.
    port : str
        As the user named it.
    folder : Path
        For journal and record.
    retreat : Retreat
        How the needle leaves the bath.
    care : Care
        How the print is watched over.
    baud : int, "auto" or None
        In place of the profile's.
    resume : bool
        Whether to go on with an interrupted print of the same file.
    once : bool
        Whether a print of the same file that is done in the folder counts as this one; of a
        simulated printer only where the record of its motion is whole.
    """

    job: Path
    printer: str
    port: str
    folder: Path
    retreat: Retreat
    resume: bool = False
    once: bool = False
    care: Care = field(default_factory=Care)
    baud: int | str | None = None

    @property
    def sha256(self) -> str:
        """Hash of the job file."""
        return hashlib.sha256(self.job.read_bytes()).hexdigest()


def find_or_start(order: Order, open_port: Callable[[], str]) -> PrintClient:
    """Attach to the order's print if it is going on or done; else go on with it, or start it.

    What was interrupted on a real machine is neither repeated nor resumed unasked. A simulated
    printer is simply started anew, but for a print that a station has done (`order.once`).

    Parameters
    ----------
    order : Order
    open_port : function
        Gives the port to open; called only when a print is started.

    Raises
    ------
    PrintctlError
        When another file is being printed in the folder.
    SafetyError
        When the file's print was interrupted, and `resume` isn't set.
    LinkError
        When the print can't be started or gone on with; `Refused` for a printer that takes no
        lines from a host.
    """
    client = running(order)
    if client is not None:
        return client
    refuse_unsent(load(Printer, order.printer), str(order.job))
    if order.resume:
        if order.port != SIMULATED and was_simulated(order.folder):
            raise SafetyError(
                f"the print in {order.folder} was a simulated one, and {order.port} has printed "
                "none of it; print the file from its beginning, in another folder"
            )
        return resume_print(order.folder, open_port())
    counts = order.port != SIMULATED or is_complete_record(
        record_for(order.folder), order.sha256, load(Printer, order.printer)
    )
    if order.once and counts and (done := finished(order)) is not None:
        return done
    if order.port != SIMULATED:
        _refuse_interrupted(order)
    return start_print(
        order.job,
        order.printer,
        open_port(),
        order.folder,
        retreat=order.retreat,
        baud=order.baud,
        care=order.care,
    )


def running(order: Order) -> PrintClient | None:
    """A client of the order's print, if it is going on.

    Raises
    ------
    PrintctlError
        When another file is being printed in the folder.
    """
    client = _attached(order.folder)
    if client is None or client.status.ended:
        return None
    if _journalled_hash(order.folder) != order.sha256:
        client.detach()
        raise PrintctlError(
            f"another file is being printed in {order.folder}, or {order.job.name} has changed "
            "since; wait for that print, or stop it from a terminal with its own file"
        )
    return client


def finished(order: Order) -> PrintClient | None:
    """A client of the order's print, if it is done."""
    if order.port != SIMULATED and was_simulated(order.folder):
        return None  # a rehearsal is no print
    client = _attached(order.folder)
    if client is None or client.status.state is not LinkState.DONE:
        return None
    return client if _journalled_hash(order.folder) == order.sha256 else None


def _refuse_interrupted(order: Order) -> None:
    begun = _journalled_hash(order.folder)
    try:
        history = resumable(order.folder, begun)
    except LinkError:
        return
    if begun != order.sha256:
        raise SafetyError(
            f"the print of another file was interrupted in {order.folder} after at least "
            f"{history.done} of {history.total} lines, or {order.job.name} (or its recipe) has "
            "changed since: what was printed lies where the needle would write; make the file as "
            "it was to go on (`printctl resume`), or give that print up (`printctl give-up "
            f"{order.folder}`) and clear the dish"
        )
    raise SafetyError(
        f"the print of {order.job.name} was interrupted in {order.folder} after at least "
        f"{history.done} of {history.total} lines; if the printer kept its power, go on with "
        f"`printctl print {order.job} --printer {order.printer} --port {order.port} "
        f"--folder {order.folder} --resume`; to begin anew, move that folder away"
    )


def _attached(folder: Path) -> PrintClient | None:
    try:
        return attach(folder)
    except NoLink:
        return None


def _journalled_hash(folder: Path) -> str:
    try:
        return str(read_journal(folder / JOURNAL).job.get("sha256", ""))
    except LinkError:
        return ""
