"""Data classes of a layer's expected lines and of its findings."""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import IntEnum
from typing import Any, Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from kernels.arrays import BoolArray, FloatArray, IntArray

FloatImage = NDArray[np.float32]
Image = NDArray[Any]


class Frame(Protocol):
    """Mapping from the printer's coordinates to pixels of a picture."""

    def to_pixels(self, points_mm: FloatArray) -> FloatArray:
        """Return pixels (n, 2) of places (n, 3), mm; the middle of the first pixel is 0, 0."""


@dataclass(frozen=True)
class ExpectedLines:
    """Straight pieces of ink that should lie there; printer's frame.

    Attributes
    ----------
    start, end : (n, 3) float64, mm
    width_mm : (n,) float64, mm
    line : (n,) int64
        Command line of the job.
    stroke : (n,) int64
        Unbroken path of each; the pieces of one follow each other.
    fresh : (n,) bool
        Of the layer that is judged; False: written before. Old ink that isn't
        listed is found as ink where none is expected.
    """

    start: FloatArray
    end: FloatArray
    width_mm: FloatArray
    line: IntArray
    stroke: IntArray
    fresh: BoolArray

    def __len__(self) -> int:
        return len(self.width_mm)


@dataclass(frozen=True)
class Lumen:
    """Area of the layer that must stay free of ink.

    Attributes
    ----------
    name : str
    outline : (k, 3) float64, mm
        Closed polygon.
    width_mm : float, mm
        Expected, across.
    """

    name: str
    outline: FloatArray
    width_mm: float

    @staticmethod
    def capsule(name: str, start: FloatArray, end: FloatArray, width_mm: float) -> Lumen:
        """Return a capsule around a straight piece; a disc where start equals end."""
        start, end = np.asarray(start, dtype=np.float64), np.asarray(end, dtype=np.float64)
        turn = math.atan2(*(end - start)[1::-1].tolist())
        half = np.linspace(-np.pi / 2, np.pi / 2, 17)
        angles = turn + np.concatenate([half, half + np.pi])
        middles = np.repeat([end, start], 17, axis=0)
        out = np.column_stack([np.cos(angles), np.sin(angles), np.zeros(len(angles))])
        return Lumen(name, middles + 0.5 * width_mm * out, width_mm)


class Unseen(IntEnum):
    """Reasons why a station wasn't seen."""

    SEEN = 0
    OUTSIDE = 1
    """Out of the picture."""
    HIDDEN = 2
    """Behind what the caller named (needle), or a large unmodelled object."""
    GLARE = 3
    """Saturated, or neither ink nor bath: glare, shadow, bubble, debris."""
    FAINT = 4
    """Too little contrast against the noise."""
    OLD_INK = 5
    """Over older ink from which it can't be distinguished."""
    UNCLEAR = 6
    """The line's surroundings contradict it: light or bath changes there."""
    COVERED = 7
    """Over or under another fresh line, which shows in any case."""


@dataclass(frozen=True)
class Stations:
    """Places along the fresh lines, in the order of writing.

    Attributes
    ----------
    at_mm : (m, 2) float64, mm
        On the expected line (without the layer's shift).
    z_mm : (m,) float64, mm
    normal : (m, 2) float64
        To the left of the way.
    piece : (m,) int64
        Row of `ExpectedLines`.
    stroke : (m,) int64
    along_mm : (m,) float64, mm
        From the stroke's begin.
    length_mm : (m,) float64, mm
        Of the station along the line.
    expected_mm : (m,) float64, mm
        Expected width.
    width_mm, u_width_mm : (m,) float64, mm
        Measured width and its standard uncertainty, common part included; NaN where unknown (not
        seen, absent, or a side touches other ink).
    offset_mm : (m,) float64, mm
        Of the line's middle, to the left, the layer's shift taken off; NaN as the width.
    present : (m,) float64
        Ink seen over the usual, 0 to 1.
    seen : (m,) bool
    why : (m,) int64
        `Unseen`.
    seam_share : (m,) float64 or None
        Ink over sound ink between seams, where lines touch; NaN elsewhere; None if not measured.
    """

    at_mm: FloatArray
    z_mm: FloatArray
    normal: FloatArray
    piece: IntArray
    stroke: IntArray
    along_mm: FloatArray
    length_mm: FloatArray
    expected_mm: FloatArray
    width_mm: FloatArray
    u_width_mm: FloatArray
    offset_mm: FloatArray
    present: FloatArray
    seen: BoolArray
    why: IntArray
    seam_share: FloatArray | None = None

    def within(self, gap: Gap) -> BoolArray:
        """Return the stations within a stretch, (m,) bool."""
        along = self.along_mm
        own = (self.stroke == gap.stroke) & (along >= gap.from_mm) & (along <= gap.to_mm)
        return np.asarray(own)

    def shows_half_of(self, gap: Gap) -> bool:
        """Return whether at least half of a stretch is seen."""
        return 2.0 * float(self.length_mm[self.within(gap) & self.seen].sum()) >= gap.length_mm


@dataclass(frozen=True)
class Gap:
    """Stretch of a stroke where no ink is seen.

    Attributes
    ----------
    stroke : int
    from_mm, to_mm : float, mm
        Along the stroke, on the line's middle: from the tip of the ink before to the tip of that
        behind, round or square. Where ink shows by neither its level in light nor a profiler's
        heights (rims, slopes, older ink): where presence falls below one half.
    start_mm, end_mm : (float, float), mm
        Places of both ends on the expected line.
    u_tip_mm, u_shift_mm : float, mm
        Standard uncertainty of either end in the picture, and of the layer's place along the line.
    p_value : float
        Chance of so little ink or less, here, by the picture's noise, where the line is as
        expected. Many places are tested: `LayerFindings.places`.
    """

    stroke: int
    from_mm: float
    to_mm: float
    start_mm: tuple[float, float]
    end_mm: tuple[float, float]
    u_tip_mm: float
    p_value: float
    u_shift_mm: float = 0.0

    @property
    def u_mm(self) -> float:
        """Standard uncertainty of either end along the designed line, mm."""
        return math.hypot(self.u_tip_mm, self.u_shift_mm)

    @property
    def length_mm(self) -> float:
        """Bare stretch along the line's middle, mm."""
        return self.to_mm - self.from_mm

    @property
    def u_length_mm(self) -> float:
        """Standard uncertainty of the length, mm."""
        return math.sqrt(2.0) * self.u_tip_mm

    def overlaps(self, other: Gap, apart_mm: float = 0.0) -> bool:
        """Return whether another stretch of the stroke lies nearer than ``apart_mm``."""
        low, high = other.from_mm - apart_mm, other.to_mm + apart_mm
        return self.stroke == other.stroke and self.from_mm < high and low < self.to_mm


@dataclass(frozen=True)
class Stretch:
    """Stretch of a stroke that is thinner or thicker than tolerated.

    Attributes
    ----------
    kind : "thin" or "thick"
    stroke : int
    from_mm, to_mm : float, mm
    ratio, u_ratio : float
        Width seen over expected.
    p_value : float
        Chance of it by noise, where the line is as wide as expected.
    """

    kind: Literal["thin", "thick"]
    stroke: int
    from_mm: float
    to_mm: float
    ratio: float
    u_ratio: float
    p_value: float


@dataclass(frozen=True)
class Blob:
    """Ink where none is expected.

    Attributes
    ----------
    kind : "blob", "drag" or "object"
        Round; drawn out; far too big for one line's ink (a needle, a hand, a spill).
    at_mm : (float, float), mm
        Its middle.
    outline_mm : (k, 2) float64, mm
    area_mm2 : float, mm²
    touches_line : bool
    p_value : float
    height_mm : float, mm
        Over the ink around, in a height map; NaN of others.
    """

    kind: Literal["blob", "drag", "object"]
    at_mm: tuple[float, float]
    outline_mm: FloatArray
    area_mm2: float
    touches_line: bool
    p_value: float
    height_mm: float = math.nan

    @property
    def width_mm(self) -> float:
        """Diameter of a disc of its area, mm."""
        return math.sqrt(4.0 / math.pi * self.area_mm2)


@dataclass(frozen=True)
class LumenFinding:
    """Measured openness of a lumen.

    Attributes
    ----------
    name : str
    expected_mm : float, mm
    width_mm, u_width_mm : float, mm
        Narrowest free width and its standard uncertainty; NaN where not seen.
    open_share : float
        Share of the area without ink; NaN where not seen.
    seen : bool
    p_value : float
        Chance of so narrow a lumen, by noise, where it is as expected; 1 where not seen.
    """

    name: str
    expected_mm: float
    width_mm: float
    u_width_mm: float
    open_share: float
    seen: bool
    p_value: float


@dataclass(frozen=True)
class Shift:
    """Offset of the fresh layer from its design; printer's frame.

    Attributes
    ----------
    dx_mm, dy_mm : float, mm
    covariance_mm2 : (2, 2) float64, mm²
        Of both; large in directions that lines don't constrain (along parallel lines).
    """

    dx_mm: float
    dy_mm: float
    covariance_mm2: FloatArray

    @property
    def u_mm(self) -> tuple[float, float]:
        """Standard uncertainties of dx and dy, mm."""
        u_x, u_y = np.sqrt(np.diag(self.covariance_mm2)).tolist()
        return u_x, u_y


@dataclass(frozen=True)
class LineShapes:
    """Fit of line-shape candidates over looks in the same light.

    Attributes
    ----------
    misfits : (k,) float64
        Misfit of each shape of `line_width`, mean of all looks.
    log_ratio : (k,) float64
        Logarithm of measured over expected width by each shape, in the last look.
    looks : int
    """

    misfits: FloatArray
    log_ratio: FloatArray
    looks: int


@dataclass(frozen=True)
class Appearance:
    """Ink's profile in a layer's look, passed on to the next look.

    Attributes
    ----------
    profile : (3, 5, 16, c) float64
        Of `ink_model.InkModel`, in the picture's own channels: logarithms, or values.
    shapes : LineShapes or None
        None where no look gave a width.
    """

    profile: FloatArray
    shapes: LineShapes | None = None
