"""Load the live view's scripts and styles for serving, with modules shared with the report.

A page of the server may have an import map of its own, so the modules that the report shares name
each other here by where they lie instead of by bare names.
"""

from __future__ import annotations

import hashlib
import re
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Final

_STATIC: Final = Path(__file__).parent / "static"
_TYPES: Final = {".js": "text/javascript; charset=utf-8", ".css": "text/css; charset=utf-8"}
_BARE: Final = re.compile(rb'"(?:viewer|live)/(\w+)"')
_VIEWER: Final = ("flat.js", "lines.js", "page.js", "scale.js", "stage.js")
"""Modules of the reports' viewer that the live view needs."""


@dataclass(frozen=True)
class StaticFile:
    """A file as it is sent.

    Attributes
    ----------
    data : bytes
    media_type : str
    tag : str
        Changes with the file.
    """

    data: bytes
    media_type: str
    tag: str


@cache
def static_files() -> dict[str, StaticFile]:
    """All of them, by name."""
    report = Path(__file__).parents[3] / "registration" / "report"
    paths = {path.name: path for path in sorted(_STATIC.iterdir()) if path.suffix in _TYPES}
    paths |= {name: report / "viewer" / name for name in _VIEWER}
    paths["three.js"] = report / "vendor" / "three.module.min.js"
    paths["orbit.js"] = report / "vendor" / "OrbitControls.js"
    return {name: _read(name, path) for name, path in paths.items()}


def _read(name: str, path: Path) -> StaticFile:
    data = path.read_bytes()
    if path.suffix == ".js" and name != "three.js":
        data = _BARE.sub(rb'"./\1.js"', data)
        for bare, url in ((b"three", b"./three.js"), (b"three/orbit", b"./orbit.js")):
            data = re.sub(rb"""from ['"]%b['"]""" % bare, b'from "%b"' % url, data)
    tag = f'"{hashlib.sha256(data).hexdigest()[:16]}"'
    return StaticFile(data, _TYPES[path.suffix], tag)
