"""Inputs of a live-view scene and its cache file: G-code, profiles, rims of dish and wells."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from pydantic import TypeAdapter

from firmware_profiles import Printer, Syringe, load
from printctl.checks.gcode_view import Pushing
from printctl.errors import UsageError
from printctl.web.workspace import file_hash

VERSION: Final = 1
"""Of the scenes' format (`printctl.web.live.scene_worker`)."""


class SceneError(UsageError):
    """A job can't be shown; the message says why."""


Outline = tuple[tuple[float, float, float], ...]
"""Corners of a line, mm, the printer's frame; closed where the last is the first."""


@dataclass(frozen=True)
class JobSource:
    """A job to be shown: its G-code, with the map (``.map.npz``) beside it.

    ``cache`` is the folder for the scene, best the one that the job lies in; ``printer`` and
    ``syringe`` are profiles by name or path; ``outlines`` stand on the bed: a dish's rim, wells.
    """

    gcode: Path
    cache: Path
    printer: str = "generic_marlin"
    syringe: str = "hamilton_1ml"
    outlines: tuple[Outline, ...] = ()

    def pushing(self) -> Pushing:
        """Return how E becomes a volume, by the profiles."""
        syringe = load(Syringe, self.syringe)
        return Pushing(load(Printer, self.printer), None, "", syringe.inner_mm, syringe.name)


SOURCES: Final = TypeAdapter(JobSource)
"""Writes and reads a source as JSON."""


def cached_scene(source: JobSource) -> Path:
    """Return the path of a job's scene, whether it exists or not.

    Its name is a hash of the file, its map, what is mounted and the format's version.

    Raises
    ------
    SceneError
        When the job can't be read.
    """
    digest, line_map = hashlib.sha256(), source.gcode.with_suffix(".map.npz")
    try:
        digest.update(file_hash(source.gcode).encode())
        if line_map.is_file():
            digest.update(file_hash(line_map).encode())
    except OSError as exc:
        raise SceneError(f"{source.gcode} can't be read: {exc.strerror}") from exc
    parts = (VERSION, source.printer, source.syringe, source.outlines)
    digest.update(repr(parts).encode())
    return source.cache / f"{digest.hexdigest()[:32]}.scene"
