"""Plan the rest of a print whose printer lost its position, and write it as a job."""

from __future__ import annotations

import math
import shlex
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

from design.files import write_bytes
from firmware_profiles import Printer, ProfileError, Syringe, load
from printctl.errors import PrintctlError
from printctl.machine.errors import LinkError
from printctl.machine.job.care import Care
from printctl.machine.job.retreat import Retreat
from printctl.machine.ports.detection import runs_files
from printctl.machine.prints.recovery import NoCheckpoint, Recovery, plan_recovery
from printctl.machine.process.contact import stays_alive
from printctl.machine.records.printed_job import load_printed_job
from printctl.machine.records.record import JOURNAL, load_record
from printctl.machine.records.replay import read_journal
from printctl.machine.records.states import LinkState

_UNOBSERVED: Final = (
    "The print was observed; nobody looks at the rest: it is a file of its own, without looks and "
    "mends. Look at each layer yourself, the last one that was written, too."
)


def _ul_per_mm(care: Care) -> float | None:
    """Ink of the plunger's travel; None where the syringe isn't known, as of several heads."""
    if care.head_capacity_mm or not care.syringe:
        return None
    try:
        return math.pi / 4 * load(Syringe, care.syringe).inner_mm ** 2
    except ProfileError:
        return None


def planned(folder: Path, from_line: int | None = None) -> Recovery:
    """Plan how to go on with the print in ``folder``; nothing is written or sent.

    ``from_line`` of the job's file is where to begin, in place of the last checkpoint. Raises
    `NoCheckpoint` where a person must say where to begin, `PrintctlError` where there is nothing to
    recover, or it can't be, `LinkError` where the print or its job can't be read.
    """
    record = load_record(folder)
    if stays_alive(folder):
        raise PrintctlError(f"the print in {folder} is going on; there is nothing to recover")
    if runs_files(record.port):
        raise PrintctlError(
            f"{record.port} ran the file by itself, so no place in it is proved to be made and no "
            "rest can be planned; look at the part, and print what is missing as a file of its own"
        )
    history = read_journal(folder / JOURNAL)
    if not history.begun:
        raise PrintctlError(
            f"no line of the job was sent in {folder}: there is nothing to recover; print it anew"
        )
    printer = load(Printer, record.profile)
    path = Path(record.job)
    job = load_printed_job(path, printer, history)
    if history.job.get("sha256") != job.sha256:
        raise PrintctlError(
            f"{record.job} has changed since it was printed in {folder}; put the file back that "
            "was printed (its hash is in the journal)"
        )
    if history.end is not None and history.end.get("state") == LinkState.DONE:
        raise PrintctlError(f"the print in {folder} was done; there is nothing to recover")
    retreat = Retreat(**record.retreat)
    try:
        care = Care.from_dict(record.care)
        ink, data = _ul_per_mm(care), path.read_bytes()
        plan = plan_recovery(job, data, history, printer, retreat, from_line, ink, care.start_mm)
    except NoCheckpoint:
        raise
    except LinkError as exc:  # nothing was sent, so it isn't the printer that failed
        raise PrintctlError(str(exc)) from exc
    return replace(plan, steps=(*plan.steps, _UNOBSERVED)) if care.looks else plan


def write_rest(folder: Path, plan: Recovery, file: Path | None = None) -> dict[str, Any]:
    """Write the rest of a print's job; return where, what to do first, and how to print it.

    To ``NAME.rest.gcode`` beside the job by default, with its map, where the job has one: the
    needle's shaft is checked by it.
    """
    record = load_record(folder)
    place = file or Path(record.job).with_suffix(".rest.gcode")
    # Loads numpy, which a print's status needs none of.
    from printctl.machine.prints.map_of_rest import write_map

    write_bytes(place, plan.gcode)
    write_map(Path(record.job), plan, place)
    start = ["--start", ",".join(f"{value:g}" for value in plan.start)] if plan.start else []
    command = ["printctl", "print", str(place), "--printer", record.profile, "--port", record.port]
    return {
        "file": str(place),
        "steps": list(plan.steps),
        "lines_left_out": plan.begin,
        "command": shlex.join([*command, *record.care.get("set_up", ()), *start]),
    }
