"""Cache path of a job's live-view scene, named by a hash of file, set-up and format version."""

from __future__ import annotations

from pathlib import Path
from typing import Final

from printctl.web.live.errors import SceneError
from printctl.web.live.source import JobSource

VERSION: Final = 1
"""Of the scenes' format (`printctl.web.live.pack`)."""


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
