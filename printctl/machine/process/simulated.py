"""Simulated printers: start one behind a pseudo-terminal; note that its motion record is whole.

By the note a run takes over what was printed from the operator's page, instead of printing it
again.
"""

from __future__ import annotations

import hashlib
import json
import os
import subprocess
import sys
import time
from pathlib import Path
from typing import Any, Final

from design.files import write_text
from firmware_profiles import Printer
from printctl.errors import PrinterFailedError
from printctl.machine.errors import LinkError
from printctl.machine.ports.detection import SIMULATED
from printctl.machine.ports.locking import lock
from printctl.machine.process.contact import alive
from printctl.machine.records.record import JOURNAL, SIM_ADDRESS, load_record, reported_port
from printctl.sources import python_command, source_digest

EXECUTED: Final = "executed.npz"
_COMES_UP_S: Final = 120.0
"""It takes one or two; a machine under heavy load needs far longer to import and compile."""
_CODE: Final = ("gcode", "sim", "printctl/machine", "firmware_profiles")
"""What decides what a simulated printer does with a job."""


def simulated_printer(
    profile: str,
    start_mm: tuple[float, float, float],
    job: Path | None,
    record: Path | None,
    folder: Path,
    *,
    speed: float = 0.0,
    journal: Path | None = None,
    faults: Path | None = None,
    detached: bool = True,
    linger_s: float = 0.0,
) -> str:
    """Start a simulated printer and return the port to reach it by.

    It records what its motors did into ``record``. It ends when its host hangs up, so that it
    outlives a command line that detaches from the print but not the print; and, if this process
    ends before a host has come, with it.

    Parameters
    ----------
    start_mm : (3,) mm
        Where the tip stands at power-up, printer's frame.
    job : Path or None
        The G-code that will be sent, by whose commands the record names what was done; None where
        it is moved by hand.
    record : Path or None
        ``.npz`` of the executed motion.
    folder : Path
        For its log and its address.
    speed : float
        Times real time; 0 for virtual time, as fast as it can.
    journal : Path, optional
        Of the print, which has what is inserted into the job; the one in ``folder`` by default.
    faults : Path or None
        A fault file (`sim.devices.faults`).
    detached : bool
        Else signals to this process's group, as Ctrl-C, end it, too, and so its print.
    linger_s : float
        How long it waits for another host if this process dies; not on Windows. Its address is
        locked as long as it lives (`living_port`).

    Raises
    ------
    PrinterFailedError
        When it doesn't come up.
    """
    address, errors = folder / SIM_ADDRESS, folder / "sim.log"
    command = [*python_command("sim"), "--printer", profile, "--speed", f"{speed:g}"]
    command += ["--start", ",".join(f"{value:.6f}" for value in start_mm)]
    if job:
        journal = journal or folder / JOURNAL
        command += ["--job", str(job.resolve()), "--journal", str(journal.resolve())]
    command += ["--record", str(record.resolve())] if record else []
    command += ["--faults", str(faults.resolve())] if faults else []
    command += ["--exit-on-hangup"]
    # On Windows a process's parent may be the launcher of a virtual environment.
    command += ["--tcp", "0"] if sys.platform == "win32" else ["--parent-pid", str(os.getpid())]
    lingers = linger_s > 0 and sys.platform != "win32"
    command += ["--linger", f"{linger_s:g}"] if lingers else []
    address.unlink(missing_ok=True)  # an earlier one that lingers keeps its own
    with address.open("wb") as out, errors.open("wb") as log:
        if lingers:
            lock(out)  # the process inherits it with its stdout
        process = subprocess.Popen(
            command,
            stdin=subprocess.DEVNULL,
            stdout=out,
            stderr=log,
            start_new_session=detached,
            creationflags=getattr(subprocess, "CREATE_NEW_PROCESS_GROUP", 0),
        )
    limit = time.monotonic() + _COMES_UP_S
    while time.monotonic() < limit and process.poll() is None:
        port, complete, _ = address.read_text().partition("\n")
        if complete:
            return port.strip()
        time.sleep(0.02)
    ended = process.poll() is not None
    process.kill()
    tail = errors.read_text(errors="replace").strip()[-500:]
    raise PrinterFailedError(
        "the simulated printer didn't come up"
        f"{'' if ended else f' within {_COMES_UP_S:g} s'}: {tail or 'no message'}"
    )


def living_port(folder: Path, port: str) -> str:
    """Return the port of a print's simulated printer that outlived its link; else ``port``."""
    if reported_port(folder, port) != SIMULATED or not alive(folder, SIM_ADDRESS):
        return port
    return (folder / SIM_ADDRESS).read_text().partition("\n")[0].strip()


def was_simulated(folder: Path) -> bool:
    """Return whether a folder's print went to a simulated printer."""
    try:
        return reported_port(folder, load_record(folder).port) == SIMULATED
    except LinkError:
        return False


def record_for(folder: Path) -> Path:
    """Path of the record of a print in ``folder``: a run's beside the print, else in it."""
    return folder.parent / EXECUTED if folder.name == "print" else folder / EXECUTED


def write_note(record: Path, sha256: str, printer: Printer, blocks: int) -> None:
    """Write down what a whole record of so many blocks is of; ``sha256`` of the job's file."""
    write_text(_note(record), json.dumps(_facts(sha256, printer, blocks)) + "\n")


def is_complete_record(record: Path, sha256: str, printer: Printer) -> bool:
    """Whether a record is of this job on this printer, by this version, and whole."""
    import numpy as np  # A print's clients do without it.

    try:
        note = json.loads(_note(record).read_text(encoding="utf-8"))
        with np.load(record) as data:
            blocks = len(data["line"])
    except (OSError, ValueError, KeyError):
        return False
    return bool(note == _facts(sha256, printer, blocks))


def _note(record: Path) -> Path:
    return record.with_suffix(".json")


def _facts(sha256: str, printer: Printer, blocks: int) -> dict[str, Any]:
    profile = json.dumps(printer.model_dump(mode="json"), sort_keys=True)
    return {
        "job": sha256,
        "printer": hashlib.sha256(profile.encode()).hexdigest(),
        "code": source_digest(_CODE),
        "blocks": blocks,
    }
