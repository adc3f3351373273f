"""Where a job itself says that it starts."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path
from typing import Final

from printctl.link.errors import LinkError
from printctl.link.job import load_job
from printctl.link.recovering import declared_start
from printctl.web.job.to_start import Place

_LONGEST_LINE: Final = 10_000


def declared_of(path: Path) -> Place | None:
    """Where the job tells the firmware that the tip stands; None where it doesn't, or can't.

    The file is read once; again when its size or time of change is another.
    """
    stat = path.stat()
    return _declared(path, stat.st_size, stat.st_mtime_ns)


@lru_cache(maxsize=256)
def _declared(path: Path, size: int, changed_ns: int) -> Place | None:
    try:
        job = load_job(path, _LONGEST_LINE)
        return declared_start(job, len(job))
    except LinkError:
        return None
