"""Compute the ink deposit in voxels from the simulated printer's executed motion.

Modelled
--------
- Dose: plunger travel times plunger area, spread over `smoothing_mm` of written path (across
  travels, not across retractions), because the ink's and syringe's compliance smooths the single
  motor steps of the plunger.
- Layered writing (all extruding moves horizontal, on at least two levels): a line is as high as
  its level lies above the level below it, hangs *below* the tip, and is area / height wide: its
  mean width, whatever its sides are like, so that its volume is kept; seen from above it is a
  capsule (straight flanks, round ends). Its crest stands farther out (`BeadSection`).
- Embedded writing (anything else): a round filament around the tip's path, its diameter from the
  area.
- Lines that overlap are united: ink doesn't pile up.

A pneumatic head's ink is laid likewise, by `sim.deposit.pneumatic`.

Not modelled
------------
Flow lag, ooze, die swell, sag, drag of the bath, fusion of neighbours, curing. Primes and
retractions (needle standing, or plunger pulled back) change the pressure in the needle and
deposit nothing; their sum is given as `standing_ul`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from sim.deposit.kernels import paint_filaments, paint_layers, stack_layers, writing_runs
from sim.deposit.levels import level_areas, level_heights, written_levels
from sim.deposit.strands import Strands
from sim.errors import DepositError
from sim.motion.executed import ExecutedMotion

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

Style = Literal["layered", "embedded"]

MOST_VOXELS = 2_000_000_000


@dataclass(frozen=True)
class Deposit:
    """Ink in voxels, in the printer's frame.

    Attributes
    ----------
    volume : (nz, ny, nx) uint8
        Share of the voxel filled with ink, 0..255.
    origin_mm : (3,) float64, mm
        Centre of voxel (0, 0, 0), as x, y, z.
    voxel_mm : float, mm
        Edge of the cubic voxels.
    style : "layered" or "embedded"
        Which model laid the ink.
    written_ul, standing_ul : float, µL
        Dosed while writing; net of primes and retractions, which deposit nothing.
    """

    volume: NDArray[np.uint8]
    origin_mm: FloatArray
    voxel_mm: float
    style: Style
    written_ul: float
    standing_ul: float

    @property
    def volume_mm3(self) -> float:
        """Volume filled with ink, mm³."""
        return float(self.volume.sum(dtype=np.int64)) / 255.0 * self.voxel_mm**3

    @property
    def bounds_mm(self) -> FloatArray:
        """Lowest and highest corner of the grid, (2, 3), mm."""
        size = np.array(self.volume.shape[::-1]) * self.voxel_mm
        low = self.origin_mm - self.voxel_mm / 2
        return np.array([low, low + size])

    def within(self, box_mm: FloatArray) -> Deposit:
        """What lies in a box (2, 3), mm, by whole voxels: a scanner's field.

        Raises
        ------
        DepositError
            When the box holds none of it.
        """
        size = self.volume.shape[::-1]
        low, high = np.round((box_mm - self.bounds_mm[0]) / self.voxel_mm).astype(np.int64)
        low, high = np.maximum(low, 0), np.minimum(high, size)
        if np.any(low >= high):
            raise DepositError("no ink was deposited in the scanner's field")
        (i0, j0, k0), (i1, j1, k1) = low.tolist(), high.tolist()
        volume = np.ascontiguousarray(self.volume[k0:k1, j0:j1, i0:i1])
        return replace(self, volume=volume, origin_mm=self.origin_mm + low * self.voxel_mm)


def deposit(
    executed: ExecutedMotion,
    plunger_area_mm2: float,
    voxel_mm: float,
    *,
    smoothing_mm: float = 1.0,
    style: Style | None = None,
    plunger_step_mm: float | None = None,
) -> Deposit:
    """Lay the ink of an executed motion into voxels.

    Parameters
    ----------
    executed : ExecutedMotion
        What the printer did.
    plunger_area_mm2 : float, mm²
        Bore of the syringe.
    voxel_mm : float, mm
        Edge of a voxel.
    smoothing_mm : float, mm
        Length of path over which the plunger's steps are smoothed.
    style : "layered" or "embedded" or None
        None decides from the motion, see the module.
    plunger_step_mm : float or None, mm
        One motor step of the plunger; None finds it from the motion. A move shorter than the
        path of 1.5 steps that got no step still writes when it goes straight on and writing goes
        on after it.

    Raises
    ------
    DepositError
        When nothing is written or the grid would be too large.
    """
    _check_positive(plunger_area_mm2=plunger_area_mm2, voxel_mm=voxel_mm, smoothing_mm=smoothing_mm)
    plunger = executed.plunger_end - executed.plunger_start
    length = np.linalg.norm(executed.end - executed.start, axis=1)
    lines, written = _dosed_lines(
        executed, length, plunger, plunger_area_mm2, smoothing_mm, plunger_step_mm
    )
    standing = float(plunger.sum()) * plunger_area_mm2 - written
    chosen = style or _style(lines)
    box = _box(lines, chosen)
    volume, origin = _painted(lines, chosen, voxel_mm, box)
    return Deposit(volume, origin, voxel_mm, chosen, written, standing)


def deposit_of_heads(
    executed: Sequence[ExecutedMotion],
    plunger_area_mm2: Sequence[float],
    voxel_mm: float,
    *,
    smoothing_mm: float = 1.0,
    style: Style | None = None,
    plunger_step_mm: Sequence[float] | None = None,
) -> tuple[Deposit, ...]:
    """Lay the ink of each head on one grid, so that voxels of two inks can be compared.

    Parameters
    ----------
    executed : sequence of ExecutedMotion
        Each head's own blocks, in its own tip's places (`ExecutedMotion.of_head`). Heads that
        write nothing are left out by the caller.
    plunger_area_mm2, plunger_step_mm : sequence of float
        Of each.
    voxel_mm, smoothing_mm, style
        As of `deposit`; the style of all follows from the whole.

    Raises
    ------
    DepositError
        As of `deposit`.
    """
    steps: Sequence[float | None] = plunger_step_mm or [None] * len(executed)
    all_lines, doses, standing = [], [], []
    for motion, area, step in zip(executed, plunger_area_mm2, steps, strict=True):
        _check_positive(plunger_area_mm2=area, voxel_mm=voxel_mm, smoothing_mm=smoothing_mm)
        plunger = motion.plunger_end - motion.plunger_start
        length = np.linalg.norm(motion.end - motion.start, axis=1)
        lines, written = _dosed_lines(motion, length, plunger, area, smoothing_mm, step)
        all_lines.append(lines)
        doses.append(written)
        standing.append(float(plunger.sum()) * area - written)
    chosen = style or _style(Strands.joined(all_lines))
    boxes = [_box(lines, chosen) for lines in all_lines]
    box = np.array([np.min([b[0] for b in boxes], axis=0), np.max([b[1] for b in boxes], axis=0)])
    found = []
    for lines, written, left in zip(all_lines, doses, standing, strict=True):
        volume, origin = _painted(lines, chosen, voxel_mm, box)
        found.append(Deposit(volume, origin, voxel_mm, chosen, written, left))
    return tuple(found)


def unite_deposits(deposits: Sequence[Deposit]) -> Deposit:
    """All inks as one, of deposits on one grid: where two meet, the fuller voxel holds.

    Raises
    ------
    DepositError
        When they aren't on one grid.
    """
    first = deposits[0]
    volume = first.volume
    for other in deposits[1:]:
        same = other.volume.shape == volume.shape and np.array_equal(
            other.origin_mm, first.origin_mm
        )
        if not same:
            raise DepositError("the deposits aren't on one grid; lay them by deposit_of_heads")
        volume = np.maximum(volume, other.volume)
    return Deposit(
        volume,
        first.origin_mm,
        first.voxel_mm,
        first.style,
        sum(one.written_ul for one in deposits),
        sum(one.standing_ul for one in deposits),
    )


def deposit_of_areas(
    lines: Strands,
    voxel_mm: float,
    style: Style,
    standing_ul: float = 0.0,
) -> Deposit:
    """Lay lines whose cross-section is known already (`sim.bead`).

    Parameters
    ----------
    lines : Strands
    voxel_mm : float, mm
    style : "layered" or "embedded"
    standing_ul : float, µL
        What isn't laid along a way; told on.

    Raises
    ------
    DepositError
        When there are no lines, or the grid would be too large.
    """
    _check_positive(voxel_mm=voxel_mm)
    if not len(lines):
        raise DepositError("no ink is laid along any way, so nothing was deposited")
    written = float((lines.length * lines.area_mm2).sum())
    volume, origin = _painted(lines, style, voxel_mm, _box(lines, style))
    return Deposit(volume, origin, voxel_mm, style, written, standing_ul)


def _check_positive(**values: float) -> None:
    for name, value in values.items():
        if not (np.isfinite(value) and value > 0):
            raise DepositError(f"{name} is {value:g}; it must be a number above 0")


def _dosed_lines(
    executed: ExecutedMotion,
    length: FloatArray,
    plunger: FloatArray,
    plunger_area: float,
    smoothing: float,
    step: float | None,
) -> tuple[Strands, float]:
    """Lines of the blocks that write, and what they dose, µL."""
    pushed = plunger[(plunger > 0) & (length > 1e-9)].sum()
    if pushed <= 0:
        raise DepositError(
            "no block moves the needle while the plunger advances, so nothing was deposited; "
            "check that the job extrudes and that the extruder was hot enough to be allowed to"
        )
    move = executed.end - executed.start
    # Bridging freely first, to learn how much path one step of the plunger makes.
    run = writing_runs(length, plunger, move, smoothing / 2)
    quantum = _plunger_quantum(plunger) if step is None else step
    path_of_step = quantum * length[run >= 0].sum() / plunger[run >= 0].sum()
    run = writing_runs(length, plunger, move, min(1.5 * path_of_step, smoothing / 2))
    chosen = np.flatnonzero(run >= 0)
    # Pressure lives through a short travel, but not through a retraction.
    stretch = np.cumsum(plunger < 0, dtype=np.int64)[chosen]
    area = _smoothed_area(stretch, length[chosen], plunger[chosen] * plunger_area, smoothing)
    kept = area > 0
    chosen = chosen[kept]
    lines = Strands(
        executed.start[chosen],
        executed.end[chosen],
        plunger[chosen] * plunger_area,
        area[kept],
        run[chosen],
        executed.line[chosen],
    )
    return lines, float(plunger[chosen].sum()) * plunger_area


def _plunger_quantum(plunger: FloatArray) -> float:
    """Smallest difference between plunger travels: one motor step, if the motion is varied."""
    sizes = np.unique(np.round(np.abs(plunger), 7))
    steps = np.diff(np.concatenate([[0.0], sizes]))
    return float(steps[steps > 1e-6].min())


def _smoothed_area(
    stretch: IntArray, length: FloatArray, volume: FloatArray, smoothing: float
) -> FloatArray:
    """Cross-section (n,), mm²: volume per length over a window around each block's middle.

    The window is `smoothing` or the block itself, whichever is longer, and ends where the
    stretch between two retractions does.
    """
    path = np.concatenate([[0.0], np.cumsum(length)])
    dosed = np.concatenate([[0.0], np.cumsum(volume)])
    first = np.searchsorted(stretch, stretch, side="left")
    last = np.searchsorted(stretch, stretch, side="right")
    middle = (path[:-1] + path[1:]) / 2
    half = np.maximum(smoothing, length) / 2
    low = np.maximum(middle - half, path[first])
    high = np.minimum(middle + half, path[last])
    taken = np.interp(high, path, dosed) - np.interp(low, path, dosed)
    return np.asarray(taken / (high - low))


def _style(lines: Strands) -> Style:
    flat = np.abs(lines.end[:, 2] - lines.start[:, 2]).max() < 1e-3
    return "layered" if flat and len(written_levels(lines.end[:, 2])) > 1 else "embedded"


def _in_levels(lines: Strands) -> tuple[FloatArray, FloatArray, IntArray, FloatArray]:
    """Levels, their lines' heights, the level of each line, and its half width."""
    levels = written_levels(lines.end[:, 2])
    area = level_areas(levels, lines.end[:, 2], lines.area_mm2)
    height = level_heights(levels, area)
    layer = np.clip(np.searchsorted(levels, lines.end[:, 2] + 1e-6, side="right") - 1, 0, None)
    return levels, height, layer, lines.area_mm2 / height[layer] / 2


def _box(lines: Strands, style: Style) -> FloatArray:
    """Lowest and highest place that ink reaches, (2, 3), mm."""
    low = np.minimum(lines.start, lines.end).min(axis=0)
    high = np.maximum(lines.start, lines.end).max(axis=0)
    if style == "embedded":
        radius = np.sqrt(lines.area_mm2 / np.pi).max()
        return np.array([low - radius, high + radius])
    levels, height, _, radius = _in_levels(lines)
    low, high = low - radius.max(), high + radius.max()
    low[2], high[2] = (levels - height).min(), levels.max()
    return np.array([low, high])


def _painted(
    lines: Strands, style: Style, voxel: float, box: FloatArray
) -> tuple[NDArray[np.uint8], FloatArray]:
    origin, shape = _grid(box[0], box[1], voxel)
    if style == "embedded":
        radius = np.sqrt(lines.area_mm2 / np.pi)
        return paint_filaments(lines.start, lines.end, radius, origin, voxel, shape), origin
    levels, height, layer, radius = _in_levels(lines)
    order = np.argsort(layer, kind="stable")
    first = np.searchsorted(layer[order], np.arange(len(levels) + 1))
    segments = np.column_stack([lines.start[order, :2], lines.end[order, :2]])
    plan = paint_layers(segments, radius[order], first, origin, voxel, (shape[1], shape[2]))
    volume = stack_layers(plan, levels - height, levels, origin[2], voxel, shape[0])
    return volume, origin


def _grid(
    low: FloatArray, high: FloatArray, voxel: float
) -> tuple[FloatArray, tuple[int, int, int]]:
    """Voxel grid over a box with one empty voxel all round: origin (x, y, z), shape (z, y, x)."""
    count = np.ceil((high - low) / voxel - 1e-9).astype(int) + 2
    if np.prod(count.astype(float)) > MOST_VOXELS:
        raise DepositError(
            f"deposit of {' x '.join(f'{v:.0f}' for v in high - low)} mm needs {count.prod():.2g} "
            f"voxels of {voxel:g} mm, above {MOST_VOXELS:.2g}; use a larger voxel_mm"
        )
    return low - voxel / 2, (int(count[2]), int(count[1]), int(count[0]))
