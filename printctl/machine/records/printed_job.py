"""Read a print's job from its file, with lines inserted during printing."""

from __future__ import annotations

from pathlib import Path

from firmware_profiles import Printer
from printctl.machine.errors import JournalError
from printctl.machine.job.job import Job, load_job
from printctl.machine.records.journalled_print import JournalledPrint, read_journal
from printctl.machine.records.record import JOURNAL


def load_printed_job(path: Path, printer: Printer, history: JournalledPrint) -> Job:
    """Read a job as it stood when its journal was written last.

    Inserts are left out of a file that isn't the print's any more; its hash tells.

    Parameters
    ----------
    path : Path
        The G-code file.
    printer : Printer
    history : JournalledPrint

    Raises
    ------
    JobError
        When the file can't be read or the inserts don't fit it.
    """
    return grown_by_journal(load_job(path, printer), history)


def grown_by_journal(job: Job, history: JournalledPrint) -> Job:
    """Return a job that was read from its file with the inserts of its print's journal."""
    if job.sha256 != history.job.get("sha256"):
        return job
    return job.grown_by(history.inserts)


def grown_in(folder: Path, job: Job) -> Job:
    """Return a job with the inserts of the print in ``folder``; as it is without a journal."""
    try:
        return grown_by_journal(job, read_journal(folder / JOURNAL))
    except JournalError:
        return job
