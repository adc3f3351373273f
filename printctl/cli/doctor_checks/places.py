"""Checks of `printctl doctor`: folders, disk space, network port and clock."""

from __future__ import annotations

import shutil
import socket
import tempfile
from datetime import UTC, datetime
from pathlib import Path
from typing import Final

from printctl.cli.doctor_checks.finding import Finding

LOW_GB: Final = 5.0
"""A scan and its report take some; below this the user is told."""
FULL_GB: Final = 0.2
"""Below this a print's journal may not find room, and nothing is started."""
PAGE_PORT: Final = 8080
OLDEST_CLOCK: Final = datetime(2025, 1, 1, tzinfo=UTC)
"""A clock before this has lost its battery."""


def nearest(folder: Path) -> Path:
    """The folder, or the first above it that is there."""
    return next(place for place in (folder, *folder.parents) if place.is_dir())


def free_gb(folder: Path) -> float:
    """What is free on the folder's disk, GB, whether or not the folder is there yet."""
    return shutil.disk_usage(nearest(folder)).free / 1e9


def disk_findings(name: str, folder: Path, free: float) -> list[Finding]:
    """Whether ``free`` GB will do."""
    if free < FULL_GB:
        return [Finding(f"the disk of {folder} ({name}) has {free:.2f} GB left; free some", True)]
    if free < LOW_GB:
        return [Finding(f"the disk of {folder} ({name}) has {free:.1f} GB left")]
    return []


def is_writable(folder: Path) -> bool:
    """Whether a file can be made in the folder, or in the first above it that is there."""
    try:
        with tempfile.TemporaryFile(dir=nearest(folder)):
            return True
    except OSError:
        return False


def is_port_free(port: int) -> bool:
    """Whether a server could listen at the port on this machine's own address."""
    with socket.socket(socket.AF_INET, socket.SOCK_STREAM) as trial:
        trial.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            trial.bind(("127.0.0.1", port))
        except OSError:
            return False
    return True


def clock_findings(now: datetime) -> list[Finding]:
    """Whether the clock can be right: journals and viability count by it."""
    if now >= OLDEST_CLOCK:
        return []
    return [Finding(f"the clock says {now:%Y-%m-%d}; set it: records of prints bear its time")]
