"""Save a print job: stream its G-code to a file, and the map of its lines to design parts."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from design.files import atomic_replacement
from design.toolpath.gcode.job import Gcode


def save_gcode(
    path: Path,
    map_path: Path,
    parts: Iterable[Gcode],
    beside: Mapping[str, NDArray[Any]] | None = None,
) -> int:
    """Write the parts of a job to ``path`` one by one, then their map; return the command count.

    The map (NPZ) has ``source``, ``move`` and ``kind`` of each line, as in `Gcode`,
    ``source_kind``, and what is given as ``beside``. Neither file takes its name before all parts
    are written.

    Raises
    ------
    OSError
        When the disk is full or the folder can't be written.
    """
    lines = 0
    source, move, kind, counts = [], [], [], "layer"
    with atomic_replacement(path) as draft, atomic_replacement(map_path) as map_draft:
        with draft.open("wb") as handle:
            for part in parts:
                handle.write(part.data)
                lines += part.line_count
                source.append(part.line_source.astype(np.int32))
                move.append(part.line_move.astype(np.int32))
                kind.append(part.line_kind.astype(np.int8))
                counts = part.source_kind
        with map_draft.open("wb") as handle:
            arrays: dict[str, Any] = {
                "source": np.concatenate(source),
                "move": np.concatenate(move),
                "kind": np.concatenate(kind),
                "source_kind": np.array(counts),
                **(beside or {}),
            }
            np.savez(handle, **arrays)
    return lines
