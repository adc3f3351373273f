"""Read a print's job again, with what its journal added to it.

--- the print's job ---------------------------------------------------------------------------
"""

from __future__ import annotations

from pathlib import Path

from firmware_profiles import Printer
from printctl.machine.job.job import Job, load_job
from printctl.machine.records.record import JOURNAL
from printctl.machine.records.replay import JournalledPrint, read_journal_if_any


def load_printed_job(path: Path, printer: Printer, history: JournalledPrint) -> Job:
    """Read a job's G-code file as it stood when its journal was written last.

    Inserts are left out of a file that isn't the print's any more; its hash tells. Raises
    `JobError` when the file can't be read or the inserts don't fit it.
    """
    return grown_by_journal(load_job(path, printer), history)


def grown_by_journal(job: Job, history: JournalledPrint) -> Job:
    """Return a job that was read from its file with the inserts of its print's journal."""
    if job.sha256 != history.job.get("sha256"):
        return job
    return job.grown_by(history.inserts)


def grown_in(folder: Path, job: Job) -> Job:
    """Return a job with the inserts of the print in ``folder``; as it is without a journal."""
    return grown_by_journal(job, read_journal_if_any(folder / JOURNAL))
