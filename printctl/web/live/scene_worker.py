"""Worker process that builds live-view scenes for requests on standard input.

A `JobSource` in JSON, on a line, comes in, one answer goes out: ``{"scene": PATH}`` or
``{"error": MESSAGE}``. The process ends when its input does, so it never outlives the server. It
steps back behind whatever else runs: a print may go on.

A scene is a binary file, little-endian:

| bytes | what |
|---|---|
| 0 to 7 | ``PRINTVIW`` |
| 8 to 11 | uint32, version of the format: 1 |
| 12 to 15 | uint32, length of the header in bytes, a multiple of 16 |
| 16 ... | header: JSON in UTF-8, filled up with spaces |
| then | points, (n + 1, 8) uint16 |
| then | command, (n,) uint32 |
| then | time, (n,) float32, s |

A point's numbers are x, y, z, layer, vessel, head, width and act, as `LiveScene.points` says; a
place in mm is ``low_mm + step_mm * number``. The header holds ``moves`` (n) and:

- ``name``, ``notes``: the file's name, sentences for the user. Never to be taken as HTML.
- ``low_mm``, ``step_mm``: of each axis.
- ``written_low_mm``, ``written_high_mm``: box of what is written (the centre of the lines).
- ``commands``: in the whole file, as the link counts them.
- ``passes``, ``layers``, ``layer_group``: whether the layers are passes; tip's height of each
  number in mm; how many share a number.
- ``vessels``, ``heads``: how many there are.
- ``duration_s``: from the feeds alone.
- ``outlines``: lines of what stands on the bed: lists of [x, y, z], mm.
"""

from __future__ import annotations

import contextlib
import json
import os
import struct
import sys
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Final

import numpy as np

from design.files import write_bytes
from firmware_profiles import ProfileError
from printctl.checks.gcode_view import read_line_map
from printctl.errors import PrintctlError
from printctl.web.live.scene import LiveScene, make_scene
from printctl.web.live.source import SOURCES, VERSION, JobSource, SceneError, cached_scene
from printctl.web.worker import lower_priority

_HEAD: Final = struct.Struct("<8sII")
_ALIGN: Final = 16
_MILLION_MOVES_BYTES: Final = 400_000_000
_SAMPLE: Final = b"G92 X0 Y0 Z0 E0\nG1 X1 E1 F600\nG2 X2 Y1 I1 J0 E2\nG1 Z1\nG1 X3 E3\n"


def pack_scene(scene: LiveScene) -> bytes:
    """Put a scene into bytes."""
    about = scene.about | {"moves": len(scene.command)}
    header = json.dumps(about, allow_nan=False).encode()
    header += b" " * (-len(header) % _ALIGN)
    return b"".join(
        [
            _HEAD.pack(b"PRINTVIW", VERSION, len(header)),
            header,
            scene.points.astype("<u2").tobytes(),
            scene.command.astype("<u4").tobytes(),
            scene.time_s.astype("<f4").tobytes(),
        ]
    )


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


def _warm_up() -> None:
    """Load what the first job would otherwise wait for; have the system hand out memory.

    Getting memory takes a large job 0.3 to 0.8 s, and this process keeps what it once had
    (`SceneMaker`). At most a sixteenth of what is free is taken.
    """
    with TemporaryDirectory() as folder:
        gcode = Path(folder) / "sample.gcode"
        gcode.write_bytes(_SAMPLE)
        write_scene(JobSource(gcode, Path(folder)))
    with contextlib.suppress(AttributeError, ValueError, OSError):  # no os.sysconf on Windows
        free = os.sysconf("SC_AVPHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
        np.empty(min(_MILLION_MOVES_BYTES, free // 16), np.uint8).fill(0)


def main() -> None:
    """Answer until the input ends."""
    lower_priority()
    _warm_up()
    for line in sys.stdin:
        try:
            answer = {"scene": str(write_scene(SOURCES.validate_json(line)))}
        except SceneError as exc:
            answer = {"error": str(exc)}
        print(json.dumps(answer), flush=True)


if __name__ == "__main__":
    main()
