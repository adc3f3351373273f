"""Own source files: run a module of them in a child process, hash them for a result's version."""

from __future__ import annotations

import hashlib
import sys
from functools import cache
from pathlib import Path

_ROOT = Path(__file__).resolve().parents[1]


def python_command(module: str) -> list[str]:
    """Command that runs one of our modules in a child; all our children are started by it.

    ``-P`` leaves the working folder off the import path: else a ``sim.py`` or ``numpy.py`` that
    lies there would run in place of ours.
    """
    return [sys.executable, "-P", "-m", module]


@cache
def source_digest(packages: tuple[str, ...]) -> str:
    """Hash of the sources (code and data) of some of our packages."""
    return hashlib.sha256(
        b"".join(
            str(path.relative_to(_ROOT)).encode() + path.read_bytes()
            for package in sorted(packages)
            for path in sorted((_ROOT / package).rglob("*"))
            if path.suffix in {".py", ".yaml", ".html", ".css", ".js"}
        )
    ).hexdigest()
