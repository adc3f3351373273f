"""Predict the deposited ink from executed motion and needle flow: position, time, line width.

Modelled
--------
- Flow out of the needle from the plunger's executed motion: its whole steps, primes, retractions,
  dwells, the firmware's advance, the first-order lag of what gives way, the pressure that a yield
  stress holds (`sim.gcode.bead.flow`).
- Ink that flows while the needle travels is laid along the travel; what flows while it stands, as a
  drop there.
- Cross-section = laid volume over way. Embedded: a round filament, d = √(4A/π). In layers: as wide
  as the ink's bead (`BeadSection`) of the height down to the level below (`sim.gcode.deposit.lay`).
- Without a lag single motor steps of the plunger are smoothed over `smoothing_mm` of written way,
  as `sim.gcode.deposit.lay` does; with one the lag itself smooths them.

Not modelled: speed within one block (its mean counts), die swell by elasticity, necking and
breaking of thin threads, fusion. Bath: `sim.gcode.bead.bath`, `sim.gcode.bead.bath`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from firmware_profiles.bead import BeadSection
from kernels.arrays import BoolArray, FloatArray, IntArray
from sim.errors import DepositError
from sim.gcode.bead.flow import Nozzle, NozzleFlow, Pieces, nozzle_flow
from sim.gcode.deposit.ink_faults import NO_FAULTS, InkFaults, Timeline
from sim.gcode.deposit.lay import Deposit, Laid, Style, deposit_of_laid, laid_as_is, with_faults
from sim.gcode.deposit.strands import Strands
from sim.gcode.deposit.written import level_areas, level_heights, written_levels

ROUNDED: Final = BeadSection()
WAY_MM = 1e-9
"""A shorter way is none."""
LEAST_UL = 1e-7
"""Less ink in a piece is rounding (a tenth of a picolitre)."""


@dataclass(frozen=True)
class Bead:
    """Pieces of time with the ink that each lays.

    Attributes
    ----------
    pieces : Pieces
    flow : NozzleFlow
    nozzle : Nozzle
    line : (n,) int64
        Of the file, from 1; while all stands, the one before.
    writes : (n,) bool
        Pieces of moves that are to write: the file pushes ink there on its way.
    area_mm2 : (n,) float64, mm²
        Cross-section of what is laid along the way; 0 where the needle stands.
    style : "layered" or "embedded"
    width_mm : (n,) float64, mm
        Diameter of a filament, or width of a line in a layer.
    stroke : (n,) int64
        Ascending: which unbroken written path each piece belongs to, or follows.
    """

    pieces: Pieces
    flow: NozzleFlow
    nozzle: Nozzle
    line: IntArray
    writes: BoolArray
    area_mm2: FloatArray
    style: Style
    width_mm: FloatArray
    stroke: IntArray

    def __len__(self) -> int:
        return len(self.pieces)

    @property
    def lays(self) -> BoolArray:
        """Pieces that lay ink along their way, (n,)."""
        return (self.area_mm2 > 0) & (self.area_mm2 * self.pieces.length > LEAST_UL)

    @property
    def written_ul(self) -> float:
        """Laid where the file writes, µL."""
        return float(self.flow.laid_ul[self.writes].sum())

    @property
    def oozed_ul(self) -> float:
        """Laid along travels, µL."""
        return float(self.flow.laid_ul[~self.writes & (self.pieces.length > WAY_MM)].sum())

    @property
    def dropped_ul(self) -> float:
        """Laid while the needle stands, µL."""
        return float(self.flow.laid_ul[self.pieces.length <= WAY_MM].sum())

    @property
    def nozzle_flow_ul_s(self) -> FloatArray:
        """Mean flow out of the needle in each piece, (n,), µL/s."""
        return _rate(self.flow.out_ul, self.pieces.duration)

    @property
    def pressure_pa(self) -> FloatArray:
        """Behind the needle, mean of each piece, (n,), Pa; NaN where the needle isn't known."""
        nozzle = self.nozzle
        if nozzle.resistance_pa_s_ul == 0:
            return np.full(len(self), np.nan)
        flow = self.nozzle_flow_ul_s
        if nozzle.lag_s == 0:
            return np.where(flow > 0, nozzle.held_pa, 0.0) + nozzle.resistance_pa_s_ul * flow
        held = self.flow.held_ul
        before = np.concatenate([[self.flow.start_ul], held[:-1]]) + self.pieces.jump_ul
        return (before + held) / 2 * nozzle.resistance_pa_s_ul / nozzle.lag_s


def _rate(volume: FloatArray, duration: FloatArray) -> FloatArray:
    out: FloatArray = np.divide(volume, duration, out=np.zeros_like(volume), where=duration > 0)
    return out


def predict_bead(
    pieces: Pieces,
    nozzle: Nozzle,
    line: IntArray,
    writes: BoolArray,
    *,
    smoothing_mm: float = 1.0,
    style: Style | None = None,
    section: BeadSection = ROUNDED,
) -> Bead:
    """Predict what each piece lays.

    Parameters
    ----------
    pieces : Pieces
        `sim.gcode.bead.flow.cut` makes them.
    nozzle : Nozzle
    line : (m,) int64
        Line of the file of each executed block.
    writes : (m,) bool
        Whether that line is to write.
    smoothing_mm : float, mm
        Way over which the plunger's steps are smoothed where there is no lag.
    style : "layered" or "embedded" or None
        None decides from the motion, as `sim.gcode.deposit.lay` does.
    section : BeadSection
        Of the ink's lines in layers.
    """
    known = pieces.block >= 0
    # Standing belongs to the line before.
    at = np.maximum.accumulate(np.where(known, pieces.block, 0))
    lines = line[at] if len(line) else np.zeros(len(pieces), np.int64)
    length = pieces.length
    to_write = known & (length > WAY_MM)
    to_write &= writes[at] if len(writes) else False
    flow = nozzle_flow(pieces, nozzle)
    stroke = _strokes(pieces, to_write)
    area = np.where(length > WAY_MM, flow.laid_ul / np.maximum(length, WAY_MM), 0.0)
    if nozzle.lag_s == 0:
        area[to_write] = _smoothed(
            stroke[to_write], length[to_write], flow.laid_ul[to_write], smoothing_mm
        )
    chosen = style or _style(pieces, to_write)
    width = _widths(pieces, area, to_write, chosen, section)
    return Bead(pieces, flow, nozzle, lines, to_write, area, chosen, width, stroke)


def _strokes(pieces: Pieces, writes: BoolArray) -> IntArray:
    """Number of the unbroken path: a new one begins with each writing after something else."""
    standing = (pieces.length <= WAY_MM) & (pieces.push_ul >= 0)
    # A short stand within a path breaks nothing.
    matters = ~standing
    kind = writes[matters]
    begins = kind & ~np.concatenate([[False], kind[:-1]])
    number = np.zeros(len(pieces), dtype=np.int64)
    number[matters] = begins
    return np.cumsum(number)


def _smoothed(
    stroke: IntArray, length: FloatArray, volume: FloatArray, smoothing: float
) -> FloatArray:
    """Volume over way in a window around each piece's middle, within its stroke, (n,), mm²."""
    if not len(stroke):
        return np.zeros(0)
    path = np.concatenate([[0.0], np.cumsum(length)])
    laid = np.concatenate([[0.0], np.cumsum(volume)])
    first = np.searchsorted(stroke, stroke, side="left")
    last = np.searchsorted(stroke, stroke, side="right")
    middle = (path[:-1] + path[1:]) / 2
    half = np.maximum(smoothing, length) / 2
    low, high = np.maximum(middle - half, path[first]), np.minimum(middle + half, path[last])
    return (np.interp(high, path, laid) - np.interp(low, path, laid)) / (high - low)


def _style(pieces: Pieces, writes: BoolArray) -> Style:
    if not writes.any():
        return "embedded"
    flat = np.abs(pieces.end[writes, 2] - pieces.start[writes, 2]).max() < 1e-3
    return "layered" if flat and len(written_levels(pieces.end[writes, 2])) > 1 else "embedded"


def _widths(
    pieces: Pieces, area: FloatArray, writes: BoolArray, style: Style, section: BeadSection
) -> FloatArray:
    if style == "embedded" or not writes.any():
        return np.sqrt(4 / np.pi * area)
    levels = written_levels(pieces.end[writes, 2])
    areas = level_areas(levels, pieces.end[writes, 2], area[writes])
    height = level_heights(levels, areas)
    at = np.searchsorted(levels, pieces.end[:, 2] + 1e-6, side="right") - 1
    return section.width(area, height[np.clip(at, 0, None)])


# Render a predicted bead as voxels, by the kernels of `sim.gcode.deposit.lay`.


def bead_deposit(
    bead: Bead, voxel_mm: float, swell: float = 1.0, faults: InkFaults = NO_FAULTS
) -> Deposit:
    """Lay a predicted bead into voxels, oozed threads included; drops aren't.

    Parameters
    ----------
    bead : Bead
    voxel_mm : float, mm
    swell : float
        Of diameters; an embedded filament's area grows by its square, a line's in a layer, whose
        height stays, by itself.
    faults : InkFaults
        What became of the ink.

    Raises
    ------
    DepositError
        When nothing is laid or the grid would be too large.
    """
    return deposit_of_laid(laid_bead(bead, swell, faults), voxel_mm)


def laid_bead(bead: Bead, swell: float = 1.0, faults: InkFaults = NO_FAULTS) -> Laid:
    """Return the ink of a predicted bead that lies; parameters as of `bead_deposit`.

    Raises
    ------
    DepositError
        When nothing is laid.
    """
    chosen = np.flatnonzero(bead.lays)
    if not len(chosen):
        raise DepositError("no ink is laid along any way, so nothing was deposited")
    grown = swell**2 if bead.style == "embedded" else swell
    area = bead.area_mm2[chosen] * grown
    pieces = bead.pieces
    lines = Strands(
        pieces.start[chosen],
        pieces.end[chosen],
        area * pieces.length[chosen],
        area,
        bead.stroke[chosen],
        bead.line[chosen],
    )
    ink = laid_as_is(lines, bead.style, bead.dropped_ul)
    time = np.column_stack([pieces.time[:-1], pieces.time[1:]])
    line = Timeline.of(
        time, bead.line - 1, pieces.length, pieces.push_ul + pieces.jump_ul, bead.writes
    )
    return with_faults(ink, chosen, line, faults)
