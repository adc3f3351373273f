"""Load the live view's scripts and styles for serving, with modules shared with the report.

A page of the server may have an import map of its own, so the modules that the report shares name
each other here by where they lie instead of by bare names.
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Final

_STATIC: Final = Path(__file__).parent / "static"
_TYPES: Final = {".js": "text/javascript; charset=utf-8", ".css": "text/css; charset=utf-8"}
_BARE: Final = {b'"three"': b'"./three.js"', b"'three'": b'"./three.js"',
                b'"three/orbit"': b'"./orbit.js"', b'"gcode/soon"': b'"./soon.js"'}  # fmt: skip
_CANVAS: Final = ("camera.js", "canvas_view.js", "soon.js", "strokes.js")
"""Modules of the G-code page that draw without WebGL, too."""


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
    paths["stage.js"] = report / "static" / "stage.js"
    paths["three.js"] = report / "vendor" / "three.module.min.js"
    paths["orbit.js"] = report / "vendor" / "OrbitControls.js"
    paths |= {name: report / "gcode" / "static" / name for name in _CANVAS}
    return {name: _read(name, path) for name, path in paths.items()}


def _read(name: str, path: Path) -> StaticFile:
    data = path.read_bytes()
    if name in ("stage.js", "orbit.js", *_CANVAS):
        for bare, url in _BARE.items():
            data = data.replace(b"from " + bare, b"from " + url)
    tag = f'"{hashlib.sha256(data).hexdigest()[:16]}"'
    return StaticFile(data, _TYPES[path.suffix], tag)
