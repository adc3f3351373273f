"""Turn file libraries' exceptions on broken scan files into one error with a remedy."""

from __future__ import annotations

import errno
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from registration.errors import RegistrationError, ScanFileError


@contextmanager
def scan_file_errors(path: Path, kind: str) -> Iterator[None]:
    """Turn whatever a library trips over into a `ScanFileError` that names file and format.

    What the disk or the memory fails with goes through: the file isn't to blame. Libraries
    raise OSError for broken content too, without a number, and the system itself does (EINVAL)
    when broken content makes one seek before a file's beginning.

    Raises
    ------
    ScanFileError
        When reading failed for another reason.
    """
    try:
        yield
    except (RegistrationError, MemoryError):
        raise
    except Exception as exc:
        if isinstance(exc, OSError) and exc.errno not in (None, errno.EINVAL):
            raise
        raise ScanFileError(f"{path}: broken {kind} ({exc}); copy or export it again") from exc
