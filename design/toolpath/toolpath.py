"""Data class of a toolpath: the needle's moves as arrays in the part's frame."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from enum import IntEnum
from pathlib import Path
from typing import Any, ClassVar, Final, Literal, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from design.errors import ToolpathError
from design.files import atomic_replacement
from design.notebook import NotebookView, draw_lines, span
from kernels.arrays import FloatArray, IntArray


class MoveKind(IntEnum):
    """Purpose of a move."""

    WRITE = 0
    """Needle moves and ink flows."""
    TRAVEL = 1
    """Needle moves, no ink."""
    PRIME = 2
    """Needle stands, plunger pushes (volume above 0)."""
    RETRACT = 3
    """Needle stands, plunger relieves (volume below 0)."""
    DWELL = 4
    """Needle and plunger stand for `duration_s`."""
    RELOAD = 5
    """A safe point to change the syringe; nothing moves."""
    LOOK = 6
    """Within a pass: what follows would bar a mend of what is written; nothing moves."""


@dataclass(frozen=True, repr=False)
class Toolpath(NotebookView):
    """Moves as arrays, in the part's frame.

    Attributes
    ----------
    start, end : (n, 3) float64, mm
        Needle tip; ``start[i] == end[i - 1]``. Equal where the needle stands.
    volume_ul : (n,) float64, µL
        Ink pushed out by the move (below 0: taken back).
    speed_mm_s : (n,) float64, mm/s
        Along the path; 0 where the needle stands.
    duration_s : (n,) float64, s
        Of a move in which the needle stands (prime, retract, dwell); 0 elsewhere.
    tool : (n,) int64
        Which head.
    kind : (n,) int64
        A `MoveKind` each.
    source : (n,) int64
        The layer or vessel the move was made for; -1 for none.
    source_kind : "layer" or "vessel"
        What `source` counts.
    layer_height_mm : float, mm
        Height of a layer, of the first one where they differ; 0 for embedded writing.
    heights_mm : mapping of int to float, mm
        Height of each layer, where they differ; else empty.
    """

    start: FloatArray
    end: FloatArray
    volume_ul: FloatArray
    speed_mm_s: FloatArray
    duration_s: FloatArray
    tool: IntArray
    kind: IntArray
    source: IntArray
    source_kind: Literal["layer", "vessel"]
    layer_height_mm: float = 0.0
    heights_mm: Mapping[int, float] = field(default_factory=dict)

    projection: ClassVar[str | None] = "3d"

    def _facts(self) -> Mapping[str, str]:
        writes = self.kind == MoveKind.WRITE
        named = self.source[writes & (self.source >= 0)]
        return {
            "moves": f"{len(self)}",
            f"{self.source_kind}s": f"{len(np.unique(named))}",
            "written": f"{self.lengths[writes].sum():.4g} mm, {self.written_ul:.4g} µL",
            "writing speed": span(self.speed_mm_s[writes], "mm/s"),
        }

    def _columns(self) -> Mapping[str, Any]:
        places = {
            f"{name}{axis}_mm": ends[:, k]
            for name, ends in (("from_", self.start), ("to_", self.end))
            for k, axis in enumerate("xyz")
        }
        names = np.array([kind.name.lower() for kind in MoveKind])
        return places | {
            "kind": names[self.kind],
            "volume_ul": self.volume_ul,
            "speed_mm_s": self.speed_mm_s,
            "duration_s": self.duration_s,
            "tool": self.tool,
            self.source_kind: self.source,
        }

    def _draw(self, axes: Any) -> None:
        rows = self.kind == MoveKind.WRITE
        lines = np.stack([self.start[rows], self.end[rows]], axis=1)
        draw_lines(axes, lines, self.source[rows].astype(np.float64), self.source_kind)

    def __len__(self) -> int:
        return len(self.kind)

    def where(self, rows: IntArray | NDArray[np.bool_]) -> Toolpath:
        """The moves of a mask or of row numbers; they may have gaps between them."""
        return replace(self, **{name: getattr(self, name)[rows] for name in ARRAYS})

    @property
    def lengths(self) -> FloatArray:
        """Length of each move, (n,), mm."""
        return np.linalg.norm(self.end - self.start, axis=1)

    @property
    def top_mm(self) -> float:
        """Highest that the tip goes, mm."""
        return max(float(self.end[:, 2].max()), float(self.start[0, 2]))

    @property
    def written_ul(self) -> float:
        """Ink written into the part, µL (retractions and their primes cancel)."""
        return float(self.volume_ul.sum())


def join_toolpaths(parts: Sequence[Toolpath]) -> Toolpath:
    """One toolpath of its parts (at least one), each of which begins where the last one ended."""
    heights = {layer: mm for part in parts for layer, mm in part.heights_mm.items()}
    arrays: dict[str, Any] = {
        name: np.concatenate([getattr(one, name) for one in parts]) for name in ARRAYS
    }
    return replace(parts[0], **arrays, heights_mm=heights)


_OTHERS: Final = ("source_kind", "layer_height_mm", "heights_mm")
ARRAYS: Final = tuple(field.name for field in fields(Toolpath) if field.name not in _OTHERS)
"""Fields of `Toolpath` with an entry for each move."""


def save_toolpath(path: Path, toolpath: Toolpath) -> None:
    """Write as ``.npz``; the name is taken only by a whole file."""
    arrays: dict[str, Any] = {name: getattr(toolpath, name) for name in ARRAYS}
    arrays["source_kind"] = np.array(toolpath.source_kind)
    arrays["layer_height_mm"] = np.array(toolpath.layer_height_mm)
    arrays["heights_mm"] = np.array(sorted(toolpath.heights_mm.items())).reshape(-1, 2)
    with atomic_replacement(path) as draft, draft.open("wb") as handle:
        np.savez(handle, **arrays)


def load_toolpath(path: Path) -> Toolpath:
    """Read what `save_toolpath` wrote."""
    with np.load(path, allow_pickle=False) as data:
        arrays = {name: data[name] for name in ARRAYS}
        kind = cast(Literal["layer", "vessel"], str(data["source_kind"]))
        return Toolpath(
            **arrays,
            source_kind=kind,
            layer_height_mm=float(data["layer_height_mm"]),
            heights_mm={int(layer): mm for layer, mm in data["heights_mm"].tolist()},
        )


def require_positive(where: str, **values: float) -> None:
    """Raise `ToolpathError` for the first value that isn't finite and above 0."""
    for name, value in values.items():
        if not (math.isfinite(value) and value > 0):
            raise ToolpathError(f"{name} is {value:g} ({where}); it must be finite and above 0")


def check_fields(where: str, options: object, positive: str, not_negative: str = "") -> None:
    """Raise `ToolpathError` for the first of the fields named that is out of its range.

    Both lists are names with spaces between: of fields above 0, and of fields of at least 0.
    """
    require_positive(where, **{name: getattr(options, name) for name in positive.split()})
    for name in not_negative.split():
        value = getattr(options, name)
        if not (math.isfinite(value) and value >= 0):
            raise ToolpathError(f"{name} is {value:g} ({where}); it must be finite and at least 0")


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
