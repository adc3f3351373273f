"""Data classes of the print playback: predicted moves and ink over time, dry-run warnings."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kernels.arrays import FloatArray, IntArray


@dataclass(frozen=True, eq=False)
class PlayRows:
    """Stretches of time in their order; none overlap.

    Attributes
    ----------
    start, end : (n, 3) float64, mm
        Of the tip of the needle that is in use.
    begin_s, end_s : (n,) float64, s
        From the job's first motion.
    act : (n,) uint8
        `report.gcode.Act`: WRITE, TRAVEL, or PRIME where ink comes out while the
        needle stands.
    laid_ul : (n,) float64, µL
        All that lies in the bath as the stretch ends.
    width_mm : (n,) float64, mm
        Predicted, also of a thread along a travel; NaN where nothing is laid along the way.
    wanted_mm : (n,) float64, mm
        What it is to be; NaN where nobody says it.
    line : (n,) int64
        Of the file, from 1.
    vessel : (n,) int64
        Of the design; -1 for none.
    head : (n,) int64
    layer : (n,) int64
        Ascending: layers in the order of writing, or passes.
    """

    start: FloatArray
    end: FloatArray
    begin_s: FloatArray
    end_s: FloatArray
    act: NDArray[np.uint8]
    laid_ul: FloatArray
    width_mm: FloatArray
    wanted_mm: FloatArray
    line: IntArray
    vessel: IntArray
    head: IntArray
    layer: IntArray

    def __len__(self) -> int:
        return len(self.act)

    def taken(self, rows: NDArray[Any]) -> PlayRows:
        """Some of them: by number, or by a mask."""
        return replace(self, **{one.name: getattr(self, one.name)[rows] for one in fields(self)})

    @property
    def way_mm(self) -> FloatArray:
        """Length of each, (n,), mm."""
        return np.asarray(np.linalg.norm(self.end - self.start, axis=1))


@dataclass(frozen=True)
class PlayNote:
    """A warning of the dry run.

    Attributes
    ----------
    text : str
    line : int
        Of the file; 0 where the whole job is meant.
    time_s : float or None, s
        When that line is run; None where it isn't known.
    """

    text: str
    line: int = 0
    time_s: float | None = None


@dataclass(frozen=True, eq=False)
class Playback:
    """Playback data of a predicted print.

    Attributes
    ----------
    rows : PlayRows
    passes : bool
        Whether `rows.layer` counts passes, written in space; else flat layers.
    layer_z_mm : (k,) float64, mm
        Height of each layer; highest of each pass.
    inks : tuple of str
        What each head holds.
    wanted : str
        What `wanted_mm` is: words after "against".
    warnings : tuple of PlayNote
    notes : tuple of str
        Sentences for the reader.
    """

    rows: PlayRows
    passes: bool
    layer_z_mm: FloatArray
    inks: tuple[str, ...]
    wanted: str
    warnings: tuple[PlayNote, ...] = ()
    notes: tuple[str, ...] = ()

    @property
    def duration_s(self) -> float:
        """From the first motion to the last."""
        return float(self.rows.end_s[-1])

    @property
    def compared(self) -> FloatArray:
        """Predicted width over what it is to be, less 1, (n,); NaN where that isn't known."""
        rows = self.rows
        wanted = np.where(rows.wanted_mm > 0, rows.wanted_mm, np.nan)
        return np.asarray(rows.width_mm / wanted - 1.0)
