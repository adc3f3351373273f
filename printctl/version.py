"""Version of this program: that of the package, and the build or commit it was made from."""

from __future__ import annotations

import subprocess
from functools import cache
from importlib import metadata
from pathlib import Path
from typing import Final

_PACKAGE: Final = Path(__file__).resolve().parent
BUILD: Final = "build.txt"
"""File beside this one in which a wheel keeps its commit (setup.py writes it)."""
_GIT: Final = ("git", "-C", str(_PACKAGE), "describe", "--always", "--dirty", "--exclude=*")


@cache
def version() -> str:
    """Return the version as PEP 440 has it, like ``0.1.0+g1a2b3c4d5``; ``.dirty`` where edited.

    Without the local part where neither a wheel nor a checkout tells a commit.
    """
    try:
        base = metadata.version("printctl")
    except metadata.PackageNotFoundError:  # run from its sources, not installed
        base = "unknown"
    commit = _commit()
    return f"{base}+g{commit.replace('-', '.')}" if commit else base


def _commit() -> str:
    """Commit of a wheel, or of the checkout that these sources lie in; else ""."""
    if (_PACKAGE / BUILD).is_file():
        return (_PACKAGE / BUILD).read_text(encoding="utf-8").strip()
    if not (_PACKAGE.parent / ".git").exists():
        return ""
    try:
        done = subprocess.run(_GIT, capture_output=True, text=True, timeout=5, check=True)
    except (OSError, subprocess.SubprocessError):
        return ""
    return done.stdout.strip()
