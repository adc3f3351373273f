"""SHA-256 of a file, cached until its size or modification time changes."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path

from printctl.run_folder.manifest import digest_file


def file_hash(path: Path) -> str:
    """SHA-256 of a file, 64 hex digits; read again when its size or time of change is another.

    Raises
    ------
    OSError
        When the file can't be read.
    """
    stat = path.stat()
    return _hash(path, stat.st_size, stat.st_mtime_ns)


@lru_cache(maxsize=256)
def _hash(path: Path, size: int, changed_ns: int) -> str:
    return digest_file(path)
