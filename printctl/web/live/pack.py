"""Pack a live-view scene into its binary file format, version 1, little-endian.

| bytes | what |
|---|---|
| 0 to 7 | ``PRINTVIW`` |
| 8 to 11 | uint32, version of the form: 1 |
| 12 to 15 | uint32, length of the header in bytes, a multiple of 16 |
| 16 ... | header: JSON in UTF-8, filled up with spaces |
| then | points, (n + 1, 8) uint16 |
| then | command, (n,) uint32 |
| then | time, (n,) float32, s |

A point's numbers are x, y, z, layer, vessel, head, width and act, as `LiveScene.points` says; a
place in mm is ``low_mm + step_mm * number``. The header holds:

``moves``
    n.
``name``, ``notes``
    The file's name, and sentences for the user. Text from outside: never to be taken as HTML.
``low_mm``, ``step_mm``
    Of each axis.
``written_low_mm``, ``written_high_mm``
    Box of what is written (the centre of the lines).
``commands``
    In the whole file, as the link counts them.
``passes``, ``layers``, ``layer_group``
    Whether the layers are passes; tip's height of each number in mm; how many share a number.
``vessels``, ``heads``
    How many there are.
``duration_s``
    From the feeds alone.
``outlines``
    Lines of what stands on the bed: lists of [x, y, z], mm.
"""

from __future__ import annotations

import json
import struct
from typing import Final

from printctl.web.live.scene import LiveScene
from printctl.web.live.scene_store import VERSION

MAGIC: Final = b"PRINTVIW"
_HEAD: Final = struct.Struct("<8sII")
_ALIGN: Final = 16


def pack_scene(scene: LiveScene) -> bytes:
    """Put a scene into bytes."""
    header = json.dumps(scene.about | {"moves": len(scene)}, allow_nan=False).encode()
    header += b" " * (-len(header) % _ALIGN)
    return b"".join(
        [
            _HEAD.pack(MAGIC, VERSION, len(header)),
            header,
            scene.points.astype("<u2").tobytes(),
            scene.command.astype("<u4").tobytes(),
            scene.time_s.astype("<f4").tobytes(),
        ]
    )
