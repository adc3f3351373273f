"""Read a user's G-code file as bytes; refuse folders, pipes and devices."""

from __future__ import annotations

import errno
import os
import stat
from pathlib import Path


def read_gcode_path(path: Path) -> bytes:
    """Read a regular file whole.

    Raises
    ------
    OSError
        When it can't be read, or is a folder, a pipe or a device, which may have no end; its
        ``strerror`` says which.
    """
    mode = path.stat().st_mode  # before it is opened: a pipe's opening waits for a writer
    if not stat.S_ISREG(mode):
        raise OSError(errno.EINVAL, f"it is {_kind(mode)} and no regular file", os.fspath(path))
    return path.read_bytes()


def _kind(mode: int) -> str:
    if stat.S_ISDIR(mode):
        return "a folder"
    return "a pipe" if stat.S_ISFIFO(mode) else "a device"
