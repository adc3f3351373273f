"""Hash printctl's own source files, to identify the version behind a result."""

from __future__ import annotations

import hashlib
from functools import cache
from pathlib import Path

_ROOT = Path(__file__).resolve().parents[1]


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
