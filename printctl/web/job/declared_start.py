"""Read the start position that a job's first lines declare (G92), cached per file and printer."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path

from firmware_profiles import Printer, ProfileError, load
from printctl.machine.link.errors import LinkError
from printctl.machine.link.job import load_job
from printctl.machine.link.job_start import declared_start
from printctl.web.job.to_start import Place


def declared_of(path: Path, printer: str) -> Place | None:
    """Tip position that the job declares to the firmware; None where it doesn't, or can't.

    The file is read once for each printer profile; again when its size or time of change is
    another.
    """
    stat = path.stat()
    return _declared(path, printer, stat.st_size, stat.st_mtime_ns)


@lru_cache(maxsize=256)
def _declared(path: Path, printer: str, size: int, changed_ns: int) -> Place | None:
    try:
        job = load_job(path, load(Printer, printer))
        return declared_start(job)
    except (LinkError, ProfileError):
        return None
