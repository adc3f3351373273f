"""Build a `Toolpath` from writing, travel, plunger and dwell moves laid end to end."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from design.errors import ToolpathError
from design.toolpath.toolpath import MoveKind, Toolpath
from kernels.arrays import FloatArray


@dataclass(frozen=True)
class _Run:
    """Moves of one kind and source, by their end points."""

    end: FloatArray
    volume_ul: FloatArray
    speed_mm_s: FloatArray
    duration_s: float
    kind: MoveKind
    source: int
    tool: int


class MoveBuilder:
    """Append runs of moves; the tip is always where the last one ended.

    Parameters
    ----------
    tip : (3,) array, mm
        Where the needle's tip is when the toolpath begins.
    source_kind : "layer" or "vessel"
        What the sources count.
    layer_height_mm : float, mm
        0 for embedded writing.

    Attributes
    ----------
    tip : (3,) float64, mm
    tool : int
        The head that makes the moves appended from now on; 0 until another is set.
    """

    def __init__(
        self, tip: ArrayLike, source_kind: Literal["layer", "vessel"], layer_height_mm: float = 0.0
    ) -> None:
        self._first = np.array(tip, dtype=np.float64)
        self._source_kind: Literal["layer", "vessel"] = source_kind
        self._layer_height_mm = layer_height_mm
        self._runs: list[_Run] = []
        self.tip: FloatArray = self._first
        self.tool = 0

    def write(
        self, points: FloatArray, volume_ul: FloatArray, speed_mm_s: ArrayLike, source: int
    ) -> None:
        """Write through ``points`` (k, 3); volume (k,) and speed, scalar or (k,), per move."""
        self._move(MoveKind.WRITE, points, volume_ul, speed_mm_s, source)

    def travel(self, points: FloatArray, speed_mm_s: ArrayLike, source: int) -> None:
        """Travel through ``points`` (k, 3) without ink."""
        self._move(MoveKind.TRAVEL, points, np.zeros(len(points)), speed_mm_s, source)

    def plunge(self, volume_ul: float, flow_ul_s: float, source: int) -> None:
        """Prime (volume above 0) or retract (below 0) at ``flow_ul_s``; nothing at 0."""
        if volume_ul != 0:
            kind = MoveKind.PRIME if volume_ul > 0 else MoveKind.RETRACT
            self._stand(kind, volume_ul, abs(volume_ul) / flow_ul_s, source)

    def dwell(self, duration_s: float, source: int) -> None:
        """Stand still; nothing at 0 s."""
        if duration_s > 0:
            self._stand(MoveKind.DWELL, 0.0, duration_s, source)

    def look(self, source: int) -> None:
        """Name a place within a pass to look at what was written; nothing moves."""
        self._stand(MoveKind.LOOK, 0.0, 0.0, source)

    def build(self, *, must_write: bool = True) -> Toolpath:
        """Return everything so far as one value.

        Raises
        ------
        ToolpathError
            When nothing is written, unless that may be (a calibration); or nothing is done.
        """
        runs = self._runs
        if not runs or (must_write and not any(run.kind is MoveKind.WRITE for run in runs)):
            raise ToolpathError("toolpath writes nothing; check the part's size and the options")
        count = np.array([len(run.end) for run in runs])
        end = np.concatenate([run.end for run in runs])
        return Toolpath(
            start=np.concatenate([self._first[None], end[:-1]]),
            end=end,
            volume_ul=np.concatenate([run.volume_ul for run in runs]),
            speed_mm_s=np.concatenate([run.speed_mm_s for run in runs]),
            duration_s=np.repeat([run.duration_s for run in runs], count),
            tool=np.repeat(np.array([run.tool for run in runs], dtype=np.int64), count),
            kind=np.repeat(np.array([run.kind for run in runs], dtype=np.int64), count),
            source=np.repeat(np.array([run.source for run in runs], dtype=np.int64), count),
            source_kind=self._source_kind,
            layer_height_mm=self._layer_height_mm,
        )

    def _move(
        self,
        kind: MoveKind,
        points: FloatArray,
        volume_ul: FloatArray,
        speed_mm_s: ArrayLike,
        source: int,
    ) -> None:
        if len(points):
            speed = np.broadcast_to(np.asarray(speed_mm_s, dtype=np.float64), len(points))
            self._runs.append(_Run(points, volume_ul, speed, 0.0, kind, source, self.tool))
            self.tip = points[-1]

    def _stand(self, kind: MoveKind, volume_ul: float, duration_s: float, source: int) -> None:
        volume, still = np.array([volume_ul]), np.zeros(1)
        self._runs.append(_Run(self.tip[None], volume, still, duration_s, kind, source, self.tool))
