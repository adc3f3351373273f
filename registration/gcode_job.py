"""Record of a G-code job's moves (kind, ink volume, width, speed, layer), with sums by layer."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from kernels.arrays import FloatArray, IntArray

GcodeColour = Literal["width", "kind", "speed", "order", "height", "vessel"]
"""What lines can be coloured by."""


class Act(IntEnum):
    """Kind of a move."""

    TRAVEL = 0
    """Goes on at the height it writes at."""
    LIFTED = 1
    """Goes up, down or above what is written."""
    WRITE = 2
    """Ink comes out on the way."""
    PRIME = 3
    """The plunger goes forward while the needle stands."""
    RETRACT = 4
    """The plunger goes back while the needle stands."""
    WIPE = 5
    """The plunger goes back on the way."""
    JUMP = 6
    """Where the needle comes from isn't known (homing, or before the first full position)."""


@dataclass(frozen=True, eq=False)
class Layers:
    """Levels of a layered job, ascending; or passes of any other, in the order of writing.

    Attributes
    ----------
    passes : bool
        Whether they are passes: written without a break, in three dimensions.
    z_mm : (k,) float64, mm
        Height of the tip; of a pass its highest.
    height_mm : (k,) float64, mm
        Of the lines; NaN where they are round.
    """

    passes: bool
    z_mm: FloatArray
    height_mm: FloatArray

    def __len__(self) -> int:
        return len(self.z_mm)


@dataclass(frozen=True, eq=False)
class GcodeJob:
    """Straight moves in the file's order, G-code's frame.

    Attributes
    ----------
    name : str
    start, end : (n, 3) float64, mm
    act : (n,) uint8
        `Act`.
    dose_ul : (n,) float64, µL
        Pushed out; below 0 where the plunger goes back; NaN where nobody knows (a pneumatic head
        whose flow isn't known).
    width_mm : (n,) float64, mm
        Of the written line; NaN elsewhere, and where the dose isn't known.
    speed_mm_s : (n,) float64, mm/s
        As fed.
    time_s : (n,) float64, s
        From the feeds, with the dwells after the move.
    line : (n,) int64
        Of the file, from 1.
    kind : (n,) int64
        Place in `kinds`; -1 where the file says none.
    kinds : tuple of str
        What the file's comments call its lines.
    vessel : (n,) int64 or None
        Of the design, where a map beside the file says it; -1 for none.
    layer : (n,) int64
        Place in `layers`; a move that doesn't write belongs to the next that does.
    layers : Layers
    text : bytes
        The file, each line ended by a line feed.
    notes : tuple of str
        Sentences for the reader: where widths come from, what isn't known.
    """

    name: str
    start: FloatArray
    end: FloatArray
    act: NDArray[np.uint8]
    dose_ul: FloatArray
    width_mm: FloatArray
    speed_mm_s: FloatArray
    time_s: FloatArray
    line: IntArray
    kind: IntArray
    kinds: tuple[str, ...]
    vessel: IntArray | None
    layer: IntArray
    layers: Layers
    text: bytes
    notes: tuple[str, ...]

    def __len__(self) -> int:
        return len(self.act)

    @property
    def way_mm(self) -> FloatArray:
        """Length of each move, (n,), mm."""
        return np.asarray(np.linalg.norm(self.end - self.start, axis=1))

    @property
    def writes(self) -> NDArray[np.bool_]:
        """Whether each move writes, (n,)."""
        return np.asarray(self.act == Act.WRITE)


def layer_sums(job: GcodeJob) -> dict[str, NDArray[Any]]:
    """Numbers of each layer, (k,) each.

    Returns
    -------
    dict
        ``moves``, ``written`` (moves that write) and ``lines`` (runs of them), ``first_line`` and
        ``last_line`` of the file; ``ul`` written, ``way_mm`` written, ``travel_mm``, ``time_s``.
    """
    count, writes, way = len(job.layers), job.writes, job.way_mm
    way = np.where(job.act == Act.JUMP, 0.0, way)
    begins = writes & ~np.concatenate([[False], writes[:-1] & (np.diff(job.layer) == 0)])
    first, last = np.full(count, np.iinfo(np.int64).max), np.zeros(count, np.int64)
    np.minimum.at(first, job.layer, job.line)
    np.maximum.at(last, job.layer, job.line)

    def total(values: NDArray[Any]) -> NDArray[Any]:
        return np.bincount(job.layer, weights=values, minlength=count)

    return {
        "moves": total(job.act != Act.JUMP).astype(np.int64),
        "written": total(writes).astype(np.int64),
        "lines": total(begins).astype(np.int64),
        "first_line": np.where(last > 0, first, 0),
        "last_line": last,
        "ul": total(np.where(writes, job.dose_ul, 0.0)),
        "way_mm": total(np.where(writes, way, 0.0)),
        "travel_mm": total(np.where(writes, 0.0, way)),
        "time_s": total(job.time_s),
    }
