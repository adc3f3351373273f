"""Read a G-code file's map (`FILE.map.npz`): the design's layer or vessel of each line."""

from __future__ import annotations

import zipfile
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

import numpy as np

from design.toolpath import MoveKind
from gcode.deposit.lay import Style
from kernels.arrays import IntArray


@dataclass(frozen=True, eq=False)
class LineMap:
    """Design layer or vessel of each G-code line.

    Attributes
    ----------
    source : (n,) int64
        Of each line of the file; -1 for none.
    of_vessels : bool
        Whether it counts vessels; else layers.
    kind : (n,) int64 or None
        Why each line is there, a `MoveKind`; -1 for none. None where the map doesn't say it.
    lag_s : float, s
        Lag of the ink's flow that the plunger is driven ahead of; 0 for none.
    strand : (n,) int64 or None
        Of vessels written as several strands, which one; None where each is one filament.
    """

    source: IntArray
    of_vessels: bool
    kind: IntArray | None = None
    lag_s: float = 0.0
    strand: IntArray | None = None

    def at_rows(self, rows: Sequence[int]) -> LineMap:
        """Return the map of a text whose rows are these of the file, from 0; -1 for others."""
        at = np.asarray(rows, np.int64)

        def of(values: IntArray | None) -> IntArray | None:
            return None if values is None else np.where(at < 0, -1, values[at])

        source = np.where(at < 0, -1, self.source[at])
        return replace(self, source=source, kind=of(self.kind), strand=of(self.strand))


def mapped_style(path: Path) -> Style | None:
    """Return how a job writes, as its map says it; None without a map that can be read."""
    if not path.is_file():
        return None
    try:
        with np.load(path, allow_pickle=False) as arrays_file:
            return "embedded" if str(arrays_file["source_kind"]) == "vessel" else "layered"
    except (OSError, ValueError, KeyError, zipfile.BadZipFile):
        return None


KINDS: Final = tuple(kind.name.lower() for kind in MoveKind)
"""Names of `LineMap.kind`."""


def read_line_map(gcode: Path, lines: int) -> tuple[LineMap | None, tuple[str, ...]]:
    """Read the map beside a file of so many lines, and what the reader should know of it.

    Returns
    -------
    LineMap or None
        None where there is none, or where it belongs to another file.
    notes : tuple of str
    """
    path = gcode.with_suffix(".map.npz")
    if not path.is_file():
        return None, ()
    try:
        with np.load(path, allow_pickle=False) as arrays_file:
            source, counts = arrays_file["source"].astype(np.int64), str(arrays_file["source_kind"])
            kind = arrays_file["kind"].astype(np.int64) if "kind" in arrays_file else None
            lag_s = float(arrays_file["lag_s"]) if "lag_s" in arrays_file else 0.0
            strand = arrays_file["strand"].astype(np.int64) if "strand" in arrays_file else None
    except (OSError, ValueError, KeyError, zipfile.BadZipFile):
        return None, (f"{path.name} beside the file can't be read and is left out.",)
    if source.shape != (lines,):
        return None, (
            f"{path.name} is of a file of {source.size} lines, not of these {lines}, and is left "
            "out.",
        )
    if kind is not None and (kind.shape != source.shape or kind.max(initial=-1) >= len(KINDS)):
        kind = None
    return LineMap(source, counts == "vessel", kind, lag_s, strand), ()
