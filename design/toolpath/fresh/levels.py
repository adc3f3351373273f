"""Compute the z boundaries of a part's layers: equally thick, or thinner at slanted walls.

A slanted wall becomes a stair. Measured across the wall a stair of layers h high is h |n_z| deep,
n_z the vertical part of the wall's unit normal (Dolenc and Mäkelä 1994, "Slicing procedures for
layered manufacturing techniques", doi:10.1016/0010-4485(94)90032-9, eq. 4). So upright walls take
layers of any height, and the floors and ceilings of lumens the thinnest. Level faces make no stair
but an error of height, so a layer ends at each of them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from design.errors import ToolpathError
from design.solids.solid import Solid
from design.toolpath.toolpath import require_positive
from kernels.arrays import FloatArray, IntArray

_LEVEL: Final = 0.9995
"""Faces with a larger |n_z| (within 2° of level) are floors or ceilings, not slants."""
_LEAST_FLOOR_MM2: Final = 0.01
"""Smaller level faces end no layer."""


@dataclass(frozen=True)
class Adaptive:
    """Layers thinner than `FreshOptions.layer_height_mm` where walls are slanted.

    Attributes
    ----------
    thinnest_mm : float, mm
        Lowest layer.
    stair_mm : float, mm
        Depth of a stair on a slanted wall, across the wall, above which layers become thinner.
    step_mm : float, mm
        Heights are whole multiples of it: of the vertical motor's step.
    """

    thinnest_mm: float
    stair_mm: float = 0.02
    step_mm: float = 2.5e-3

    def __post_init__(self) -> None:
        require_positive(
            "adaptive layers",
            thinnest_mm=self.thinnest_mm,
            stair_mm=self.stair_mm,
            step_mm=self.step_mm,
        )


def even_levels(low_mm: float, high_mm: float, layer_height_mm: float) -> FloatArray:
    """Borders of layers all alike, (n + 1,), mm: as many as come nearest to the part's height."""
    count = int(np.floor((high_mm - low_mm) / layer_height_mm + 0.5 - 1e-6))
    return np.asarray(low_mm + np.arange(max(count, 0) + 1) * layer_height_mm)


def adaptive_levels(
    solids: Sequence[Solid], layer_height_mm: float, adaptive: Adaptive
) -> FloatArray:
    """Borders of layers no higher than the slopes beside them bear, (n + 1,), mm.

    Each layer is as high as it may be, and no lower than the thinnest; a layer ends at each level
    face, for which the last ones before it may be one step higher.

    Raises
    ------
    ToolpathError
        When the thinnest layer isn't thinner than the others, or no whole step.
    """
    step = adaptive.step_mm
    most = int(np.floor(layer_height_mm / step + 1e-6))
    least = int(np.ceil(adaptive.thinnest_mm / step - 1e-6))
    if not 1 <= least < most:
        raise ToolpathError(
            f"thinnest layer is {1e3 * adaptive.thinnest_mm:g} µm, others {1e3 * layer_height_mm:g}"
            f" µm, in steps of {1e3 * step:g} µm (adaptive layers); the thinnest must be at least "
            "a step lower: give a lower one or higher layers"
        )
    low = min(float(solid.bounds[0, 2]) for solid in solids)
    high = max(float(solid.bounds[1, 2]) for solid in solids)
    count = int(np.rint((high - low) / step))
    allowed, floors = _slopes(solids, low, count, (least, most), adaptive)
    borders = [0]
    for end in _ends(floors, count, least):
        heights = _filled(borders[-1], end, allowed, least)
        borders += np.cumsum([borders[-1], *heights])[1:].tolist()
    return low + step * np.array(borders)


def _slopes(
    solids: Sequence[Solid], low: float, count: int, span: tuple[int, int], adaptive: Adaptive
) -> tuple[IntArray, IntArray]:
    """Highest layer that each step of height bears, (count,), and level faces, in steps."""
    least, most = span
    allowed = np.full(count, most)
    layers = []
    for solid in solids:
        corners = solid.vertices[solid.faces]
        normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        twice = np.linalg.norm(normal, axis=1)
        slope = np.abs(normal[:, 2]) / np.maximum(twice, 1e-300)
        heights = (corners[:, :, 2] - low) / adaptive.step_mm
        first = np.clip(np.floor(heights.min(axis=1) + 1e-6), 0, count).astype(np.int64)
        last = np.clip(np.ceil(heights.max(axis=1) - 1e-6), 0, count).astype(np.int64)
        level = slope > _LEVEL
        layers.append(_floors(np.rint(heights.mean(axis=1))[level], twice[level] / 2))
        with np.errstate(divide="ignore"):
            bears = np.floor(adaptive.stair_mm / slope / adaptive.step_mm + 1e-6)
        bears = np.clip(bears, least, most)
        for value in np.unique(bears[~level & (bears < most)]):
            rows = ~level & (bears == value)
            ends = np.bincount(first[rows], minlength=count + 1)
            ends -= np.bincount(last[rows], minlength=count + 1)
            here = np.cumsum(ends)[:count] > 0
            allowed[here] = np.minimum(allowed[here], int(value))
    return allowed, np.unique(np.concatenate(layers))


def _floors(height: FloatArray, area: FloatArray) -> IntArray:
    """Heights, in steps, that level faces of enough area stand at."""
    at, which = np.unique(height.astype(np.int64), return_inverse=True)
    return at[np.bincount(which, weights=area, minlength=len(at)) >= _LEAST_FLOOR_MM2]


def _ends(floors: IntArray, count: int, least: int) -> list[int]:
    """Where a layer ends, ascending, none nearer to the next than the thinnest layer."""
    ends: list[int] = []
    for at in floors.tolist():
        if at - (ends[-1] if ends else 0) >= least and count - at >= least:
            ends.append(at)
    return [*ends, count]


def _filled(at: int, end: int, allowed: IntArray, least: int) -> list[int]:
    """Heights of the layers from a step to another, all of them of steps."""
    heights: list[int] = []
    while at < end:
        heights.append(min(_highest(allowed[at:end], least), end - at))
        at += heights[-1]
    return _shared(heights, least)


def _shared(heights: list[int], least: int) -> list[int]:
    """The same without a last layer that is too thin.

    Those before it give what it lacks, the nearest first. Where none is thicker than the thinnest,
    its steps are shared among them.
    """
    *before, last = heights
    if last >= least or not before:
        return heights
    if sum(before) + last >= len(heights) * least:
        for k in reversed(range(len(before))):
            given = min(least - last, before[k] - least)
            before[k], last = before[k] - given, last + given
        return [*before, last]
    for k in range(last):
        before[-1 - k % len(before)] += 1
    return before


def _highest(allowed: IntArray, least: int) -> int:
    """Highest layer that all steps of height in it bear."""
    bears = np.minimum.accumulate(allowed) >= np.arange(1, len(allowed) + 1)
    return max(int(np.argmin(bears)) if not bears.all() else len(allowed), least)
