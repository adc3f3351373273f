"""Inputs of a live-view scene and its cache key: G-code file, profiles, rims of dish and wells."""

from __future__ import annotations

import hashlib
import json
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Final

from firmware_profiles import Printer, Syringe, load
from printctl.checks.gcode_view import Pushing
from printctl.errors import UsageError
from printctl.web.workspace import file_hash


class SceneError(UsageError):
    """A job can't be shown; the message says why."""


Outline = tuple[tuple[float, float, float], ...]
"""Corners of a line, mm, the printer's frame; closed where the last is the first."""


@dataclass(frozen=True)
class JobSource:
    """A job to be shown.

    Attributes
    ----------
    gcode : Path
        The file that is printed; its map (``.map.npz``) is taken from beside it.
    cache : Path
        Folder for the scene that is made of it, best the one that the job lies in.
    printer, syringe : str
        Profiles, by name or path.
    flow_ul_s : float or None, µL/s
        Of a pneumatic head; None takes the profile's.
    outlines : tuple of Outline
        What stands on the bed: a dish's rim, a plate's wells.
    """

    gcode: Path
    cache: Path
    printer: str = "generic_marlin"
    syringe: str = "hamilton_1ml"
    flow_ul_s: float | None = None
    outlines: tuple[Outline, ...] = ()

    def pushing(self) -> Pushing:
        """How E becomes a volume.

        Raises
        ------
        firmware_profiles.ProfileError
            When a profile isn't there or isn't valid.
        """
        syringe = load(Syringe, self.syringe)
        return Pushing(
            printer=load(Printer, self.printer),
            bore_mm=None,
            bore_said="",
            syringe_mm=syringe.inner_mm,
            syringe_said=syringe.name,
            flow_ul_s=self.flow_ul_s,
        )

    def to_json(self) -> str:
        """One line of text that `from_json` reads."""
        values = asdict(self) | {"gcode": str(self.gcode), "cache": str(self.cache)}
        return json.dumps(values)

    @staticmethod
    def from_json(text: str) -> JobSource:
        """Read `to_json`."""
        values: dict[str, Any] = json.loads(text)
        outlines = tuple(tuple(tuple(at) for at in line) for line in values["outlines"])
        paths = {name: Path(values[name]) for name in ("gcode", "cache")}
        return JobSource(**{**values, **paths, "outlines": outlines})

    def key(self, version: int) -> str:
        """Hash of the file, its map, what is mounted and the scene's version; 32 hex digits.

        Raises
        ------
        OSError
            When the file can't be read.
        """
        digest = hashlib.sha256()
        for path in (self.gcode, self.gcode.with_suffix(".map.npz")):
            if path == self.gcode or path.is_file():
                digest.update(file_hash(path).encode())
        parts = (version, self.printer, self.syringe, self.flow_ul_s, self.outlines)
        digest.update(repr(parts).encode())
        return digest.hexdigest()[:32]


VERSION: Final = 1
"""Of the scenes' format (`printctl.web.live.scene_worker`)."""


def cached_scene(source: JobSource) -> Path:
    """Path of a job's scene, whether it exists or not.

    Raises
    ------
    SceneError
        When the job can't be read.
    """
    try:
        return source.cache / f"{source.key(VERSION)}.scene"
    except OSError as exc:
        raise SceneError(f"{source.gcode} can't be read: {exc.strerror}") from exc
