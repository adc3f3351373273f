"""Layout of a binary STL file, and a check that all its triangles are there."""

from __future__ import annotations

from pathlib import Path
from typing import Final

import numpy as np

START_BYTES: Final = 84
"""Header, and how many triangles follow."""

TRIANGLE: Final = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])


def cut_short(path: Path) -> str:
    """Say what is missing of a binary STL whose header counts more than it holds; else empty.

    Raises
    ------
    OSError
        When the file can't be opened.
    """
    with path.open("rb") as file:
        start = file.read(START_BYTES)
    held = (path.stat().st_size - START_BYTES) // TRIANGLE.itemsize
    count = int.from_bytes(start[80:84], "little")
    if len(start) < START_BYTES or start.lstrip().startswith(b"solid") or held >= count:
        return ""
    return f"the file is cut short: its header counts {count} triangles, and it holds {held}"
