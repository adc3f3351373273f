"""Worker process that builds live-view scenes for requests on standard input.

A line with `NOW` or `BEHIND` and a `JobSource` in JSON comes in, one answer goes out:
``{"scene": PATH}`` or ``{"error": MESSAGE}``. The process ends when its input does, so it never
outlives the server.
"""

from __future__ import annotations

import contextlib
import json
import os
import sys
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Final

import numpy as np

from design.files import write_bytes
from firmware_profiles import ProfileError
from printctl.checks.gcode_view import read_line_map
from printctl.errors import PrintctlError
from printctl.web.live.errors import SceneError
from printctl.web.live.pack import pack_scene
from printctl.web.live.scene import make_scene
from printctl.web.live.scene_store import cached_scene
from printctl.web.live.source import JobSource
from printctl.web.low_priority import BEHIND, run_at_low_priority

_MILLION_MOVES_BYTES: Final = 400_000_000
_SAMPLE: Final = b"G92 X0 Y0 Z0 E0\nG1 X1 E1 F600\nG2 X2 Y1 I1 J0 E2\nG1 Z1\nG1 X3 E3\n"


def write_scene(source: JobSource) -> Path:
    """Make a job's scene unless it is there.

    Raises
    ------
    SceneError
        When the job can't be shown, or the scene not be kept.
    """
    path = cached_scene(source)
    if path.is_file():
        return path
    try:
        gcode = source.gcode.read_bytes()
        lines = gcode.count(b"\n") + (not gcode.endswith(b"\n"))
        line_map, notes = read_line_map(source.gcode, lines)
        scene = make_scene(source, gcode, line_map)
        scene.about["notes"] += notes
        write_bytes(path, pack_scene(scene))
    except (PrintctlError, ProfileError) as exc:
        raise SceneError(str(exc)) from exc
    except OSError as exc:
        raise SceneError(
            f"the view of {source.gcode.name}: {exc.strerror}: {exc.filename}"
        ) from exc
    return path


def warm() -> None:
    """Load what the first job would otherwise wait for."""
    with TemporaryDirectory() as folder:
        gcode = Path(folder) / "sample.gcode"
        gcode.write_bytes(_SAMPLE)
        write_scene(JobSource(gcode, Path(folder)))


def hold_memory() -> None:
    """Have the system hand out now what the first large job would wait for, 0.3 to 0.8 s.

    This process keeps what it once had (`maker`). At most a sixteenth of what is free is taken.
    """
    with contextlib.suppress(AttributeError, ValueError, OSError):  # no os.sysconf on Windows
        free = os.sysconf("SC_AVPHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
        np.empty(min(_MILLION_MOVES_BYTES, free // 16), np.uint8).fill(0)


def main() -> None:
    """Answer until the input ends."""
    run_at_low_priority(warm)
    hold_memory()
    for line in sys.stdin:
        when, _, source = line.partition(" ")
        work = partial(answer, JobSource.from_json(source))
        print(json.dumps(run_at_low_priority(work) if when == BEHIND else work()), flush=True)


def answer(source: JobSource) -> dict[str, str]:
    """What a question is answered."""
    try:
        return {"scene": str(write_scene(source))}
    except SceneError as exc:
        return {"error": str(exc)}
