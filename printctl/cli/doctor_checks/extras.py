"""List printctl's optional installs: present, or missing packages and the pip command."""

from __future__ import annotations

import re
from importlib import metadata
from typing import Final

DEVELOPMENT: Final = {"test", "release", "docs"}
"""Extras for those who work on printctl."""

_NAME: Final = re.compile(r"^[A-Za-z0-9._-]+")
_EXTRA: Final = re.compile(r"extra *== *['\"]([^'\"]+)['\"]")


def extras() -> dict[str, str]:
    """Each extra: "present", or what is missing and the command that installs it."""
    try:
        wanted = metadata.requires("printctl") or []
    except metadata.PackageNotFoundError:
        return {}
    parts: dict[str, list[str]] = {}
    for line in wanted:
        name, extra = _NAME.match(line), _EXTRA.search(line)
        if name and extra and extra[1] not in DEVELOPMENT:
            parts.setdefault(extra[1], []).append(name[0])
    return {extra: _said(extra, names) for extra, names in sorted(parts.items())}


def _said(extra: str, names: list[str]) -> str:
    missing = sorted(name for name in names if not _is_there(name))
    if not missing:
        return "present"
    return f"missing {', '.join(missing)}; pip install 'printctl[{extra}]'"


def _is_there(name: str) -> bool:
    try:
        metadata.version(name)
    except metadata.PackageNotFoundError:
        return False
    return True
