"""Leave out older filaments clearly below the fresh ones of a volume.

A picture of filaments (`own_depth`) shows each column at the depth of the fresh one next to it:
older ink further down doesn't show there, and hides nothing. Older ink further up casts a shadow.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from scipy.spatial import cKDTree

from kernels.arrays import BoolArray, FloatArray, IntArray
from printctl.inspection.findings import LayerFindings
from printctl.inspection.pictures.heights.height import HeightFrame
from printctl.inspection.values import ExpectedLines

_CUT_MM: Final = 0.1
"""Length of the pieces that older lines are cut into."""
_MIN_BATH_MM: Final = 0.1
"""Least bath between two filaments for the lower one to be hidden: blur and frame errors."""


@dataclass(frozen=True)
class VisibleLines:
    """Fresh lines and the older ones that show at their depths.

    Attributes
    ----------
    lines : ExpectedLines
        Older ones are cut finely.
    row : (n,) int64
        Row of the line that each was cut from.
    """

    lines: ExpectedLines
    row: IntArray

    @staticmethod
    def of(lines: ExpectedLines, frame: HeightFrame, depth_down: bool) -> VisibleLines:
        """Cut older lines, and leave out pieces clearly below the nearest fresh line.

        Strokes of which a part is fresh are kept whole.

        Parameters
        ----------
        lines : ExpectedLines
        frame : HeightFrame
        depth_down : bool
            Whether depth grows away from the scanner (`Scan.depth_down`).
        """
        old = ~np.isin(lines.stroke, lines.stroke[lines.fresh])
        length = np.linalg.norm(lines.end - lines.start, axis=1)
        count = np.where(old, np.maximum(1, np.ceil(length / _CUT_MM)), 1).astype(np.int64)
        row = np.repeat(np.arange(len(lines)), count)
        number = np.arange(len(row)) - np.repeat(np.cumsum(count) - count, count)
        cut = _parts(lines, row, number / count[row], (number + 1) / count[row])
        shown = ~(old[row] & _below(cut, lines, frame, depth_down))
        return VisibleLines(_some(cut, shown), row[shown])

    def with_given_rows(self, findings: LayerFindings) -> LayerFindings:
        """Return findings with the given lines' rows."""
        stations = replace(findings.stations, piece=self.row[findings.stations.piece])
        return replace(findings, stations=stations)


def _below(
    cut: ExpectedLines, lines: ExpectedLines, frame: HeightFrame, depth_down: bool
) -> BoolArray:
    """Return which lines have bath between themselves and the fresh one above, (n,)."""
    fresh = np.flatnonzero(lines.fresh)
    length = np.linalg.norm((lines.end - lines.start)[fresh], axis=1)
    count = np.maximum(1, np.ceil(length / _CUT_MM)).astype(np.int64)
    own = np.repeat(fresh, count)
    number = np.arange(len(own)) - np.repeat(np.cumsum(count) - count, count)
    share = (number + 0.5) / np.repeat(count, count)
    above = frame.to_voxels(_at(lines, own, share))
    here = frame.to_voxels(0.5 * (cut.start + cut.end))
    near = cKDTree(above[:, :2]).query(here[:, :2])[1]
    sign = 1.0 if depth_down else -1.0
    deeper_mm = sign * (here[:, 2] - above[near, 2]) / abs(float(frame.matrix[2, 2]))
    apart_mm = 0.5 * (cut.width_mm + lines.width_mm[own[near]])
    return np.asarray(deeper_mm > apart_mm + _MIN_BATH_MM)


def _at(lines: ExpectedLines, row: IntArray, share: FloatArray) -> FloatArray:
    """Return points (n, 3), mm, at a share of the way along lines."""
    part = share[:, None]
    return np.asarray(lines.start[row] * (1.0 - part) + lines.end[row] * part)


def _parts(
    lines: ExpectedLines, row: IntArray, begin: FloatArray, end: FloatArray
) -> ExpectedLines:
    """Cut lines ``row`` from one share of their way to another."""
    return replace(_some(lines, row), start=_at(lines, row, begin), end=_at(lines, row, end))


def _some(lines: ExpectedLines, which: IntArray | BoolArray) -> ExpectedLines:
    return ExpectedLines(**{name: value[which] for name, value in vars(lines).items()})
