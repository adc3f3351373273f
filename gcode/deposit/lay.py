"""Compute the ink deposit in voxels from the simulated printer's executed motion.

Modelled
--------
- Dose: plunger travel times plunger area, spread over `smoothing_mm` of written path (across
  travels, not across retractions), because the ink's and syringe's compliance smooths the single
  motor steps of the plunger.
- Layered writing: a line is as high as its level lies above the level below it, hangs *below* the
  tip, and is area / height wide: its mean width, whatever its sides are like, so that its volume is
  kept; seen from above it is a capsule (straight flanks, round ends). Its crest stands farther out
  (`BeadSection`).
- Embedded writing: a round filament around the tip's path, its diameter from the area.
- Which of the two is for the caller to say (`style`): level filaments at two depths move as layers
  do. It is guessed (`writing_style`) only where nothing says it.
- Lines that overlap are united: ink doesn't pile up.

A pneumatic head's ink is laid likewise, by `gcode.deposit.lay`. Faults of the ink
(`gcode.deposit.ink_faults`) act on the lines (`gcode.deposit.lay`).

Not modelled
------------
Flow lag, ooze, die swell, sag, drag of the bath, fusion of neighbours, curing. Primes and
retractions (needle standing, or plunger pulled back) change the pressure in the needle and
deposit nothing; their sum is given as `standing_ul`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final, Literal

import numpy as np
from numpy.typing import NDArray

from firmware_profiles import Printer
from gcode.deposit.ink_faults import NO_FAULTS, InkFaults, Placed, Timeline, faulty_lines
from gcode.deposit.kernels import paint_filaments, paint_layers, stack_layers
from gcode.deposit.written import (
    SMOOTHING_MM,
    Layering,
    Strands,
    Written,
    check_positive,
    united,
    written,
    written_levels,
)
from gcode.errors import DepositError
from gcode.heads import as_plunger, flowing, refuse_unread, with_commands
from gcode.motion.executed import ExecutedMotion
from gcode.program.read_program import read_written
from gcode.program.valve import read_valves
from kernels.arrays import FloatArray

MOST_VOXELS = 2_000_000_000
_ENDS = ("start", "end")


# The simulated scanner and the simulated camera both take it from here, so that they show the same
# ink. Levels and heights of layers are those of the sound lines: a clog doesn't change where the
# next layer is written.
Style = Literal["layered", "embedded"]


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
    smoothing_mm: float = SMOOTHING_MM,
    style: Style | None = None,
    plunger_step_mm: float | None = None,
    faults: InkFaults = NO_FAULTS,
) -> Deposit:
    """Lay the ink of an executed motion into voxels of an edge; parameters as of `laid`.

    Raises
    ------
    DepositError
        When nothing is written or the grid would be too large.
    """
    check_positive(voxel_mm=voxel_mm)
    ink = laid(
        executed,
        faults,
        plunger_area_mm2,
        smoothing_mm=smoothing_mm,
        style=style,
        plunger_step_mm=plunger_step_mm,
    )
    return deposit_of_laid(ink, voxel_mm)


def deposit_of_laid(ink: Laid, voxel_mm: float, box_mm: FloatArray | None = None) -> Deposit:
    """Lay ink into voxels that `gcode.deposit.lay` says to lie there.

    Parameters
    ----------
    box_mm : (2, 3) float64 or None, mm
        Lowest and highest corner of what the grid covers, one voxel more all round, whatever of
        the ink lies there; None for all ink.

    Raises
    ------
    DepositError
        When none does, or the grid would be too large.
    """
    check_positive(voxel_mm=voxel_mm)
    if not len(ink.strands) and box_mm is None:
        raise DepositError("no ink is laid along any way, so nothing was deposited")
    volume, origin = _painted(ink, voxel_mm, _box(ink) if box_mm is None else box_mm)
    return Deposit(volume, origin, voxel_mm, ink.style, ink.written_ul, ink.standing_ul)


def deposit_of_heads(
    executed: Sequence[ExecutedMotion],
    plunger_area_mm2: Sequence[float],
    voxel_mm: float,
    *,
    smoothing_mm: float = SMOOTHING_MM,
    plunger_step_mm: Sequence[float] | None = None,
    faults: Sequence[InkFaults] | None = None,
    style: Style | None = None,
    layer_mm: float | None = None,
) -> tuple[Deposit, ...]:
    """Lay the ink of each head on one grid, so that voxels of two inks can be compared.

    Parameters
    ----------
    executed : sequence of ExecutedMotion
        Each head's own blocks, in its own tip's places (`ExecutedMotion.of_head`). Heads that
        write nothing are left out by the caller.
    plunger_area_mm2, plunger_step_mm, faults : sequence
        Of each.
    voxel_mm : float, mm
        Edge of a voxel.
    smoothing_mm, style, layer_mm
        As of `laid`, for all heads; a guessed style follows from the whole.

    Raises
    ------
    DepositError
        As of `deposit`.
    """
    check_positive(voxel_mm=voxel_mm)
    if not executed:
        raise DepositError("no head wrote anything, so nothing was deposited")
    steps: Sequence[float | None] = plunger_step_mm or [None] * len(executed)
    each = [
        written(motion, area, smoothing_mm, step)
        for motion, area, step in zip(executed, plunger_area_mm2, steps, strict=True)
    ]
    chosen = style or _style_of([one.lines for one in each], layer_mm)
    inks = [
        _laid_of(one, motion, area, wrong, chosen, layer_mm)
        for one, motion, area, wrong in zip(
            each, executed, plunger_area_mm2, faults or [NO_FAULTS] * len(each), strict=True
        )
    ]
    boxes = [_box(ink) for ink in inks if len(ink.strands)]
    if not boxes:
        raise DepositError("no ink is laid along any way, so nothing was deposited")
    box = np.array([np.min([b[0] for b in boxes], axis=0), np.max([b[1] for b in boxes], axis=0)])
    return tuple(deposit_of_laid(ink, voxel_mm, box) for ink in inks)


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
        moved = not np.array_equal(other.origin_mm, first.origin_mm)
        if moved or other.volume.shape != volume.shape:
            raise DepositError("the deposits aren't on one grid; lay them by deposit_of_heads")
        volume = np.maximum(volume, other.volume)
    written_ul = sum(one.written_ul for one in deposits)
    standing_ul = sum(one.standing_ul for one in deposits)
    return replace(first, volume=volume, written_ul=written_ul, standing_ul=standing_ul)


def _box(ink: Laid) -> FloatArray:
    """Lowest and highest place that ink reaches, (2, 3), mm."""
    lines = ink.strands
    low = np.minimum(lines.start, lines.end).min(axis=0)
    high = np.maximum(lines.start, lines.end).max(axis=0)
    if ink.layering is None:
        radius = np.sqrt(lines.area_mm2 / np.pi).max()
        return np.array([low - radius, high + radius])
    levels, height = ink.layering.levels, ink.layering.height_mm
    radius = _half_widths(ink).max()
    low, high = low - radius, high + radius
    low[2], high[2] = (levels - height).min(), levels.max()
    return np.array([low, high])


def _half_widths(ink: Laid) -> FloatArray:
    return ink.strands.area_mm2 / ink.height_mm / 2


def _painted(ink: Laid, voxel: float, box: FloatArray) -> tuple[NDArray[np.uint8], FloatArray]:
    lines, layering = ink.strands, ink.layering
    origin, shape = _grid(box[0], box[1], voxel)
    if layering is None:
        radius = np.sqrt(lines.area_mm2 / np.pi)
        return paint_filaments(lines.start, lines.end, radius, origin, voxel, shape), origin
    levels, height = layering.levels, layering.height_mm
    layer, radius = layering.number(lines.end[:, 2]), _half_widths(ink)
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


@dataclass(frozen=True)
class Laid:
    """Ink in the dish.

    Attributes
    ----------
    strands : Strands
        In the order of writing; without ink that didn't come. Clumps are strands of next to no
        length.
    layering : Layering or None
        Of layered writing; None for filaments in a bath.
    standing_ul : float, µL
        Net of primes and retractions, which deposit nothing.
    """

    strands: Strands
    layering: Layering | None
    standing_ul: float = 0.0

    @property
    def style(self) -> Style:
        """Which model lays the ink."""
        return "embedded" if self.layering is None else "layered"

    @property
    def written_ul(self) -> float:
        """Ink that is laid, µL."""
        return float(self.strands.dose_ul.sum())

    @property
    def height_mm(self) -> FloatArray:
        """Of each strand, (n,), mm: down from the tip in a layer, or the filament's diameter."""
        if self.layering is None:
            return 2 * self.strands.radius
        return self.layering.heights(self.strands.end[:, 2])


def laid(
    executed: ExecutedMotion,
    faults: InkFaults,
    plunger_area_mm2: float,
    *,
    smoothing_mm: float = SMOOTHING_MM,
    style: Style | None = None,
    plunger_step_mm: float | None = None,
    layer_mm: float | None = None,
) -> Laid:
    """Return the ink that lies after an executed motion of one head.

    Parameters
    ----------
    executed : ExecutedMotion
        Up to now; what was laid by then is the same in the record of a longer print, where
        `plunger_step_mm` is given.
    faults : InkFaults
        What became of the ink.
    plunger_area_mm2 : float, mm²
        Bore of the syringe.
    smoothing_mm : float, mm
        Length of path over which the plunger's steps are smoothed.
    style : "layered" or "embedded" or None
        None guesses it from the motion (`writing_style`).
    plunger_step_mm : float or None, mm
        One motor step of the plunger; None finds it from the motion. A move shorter than the path
        of 1.5 steps that got no step still writes when it goes straight on and writing goes on
        after it.
    layer_mm : float or None, mm
        Height of the lines while there is but one level, which doesn't tell it.

    Raises
    ------
    DepositError
        When nothing is written.
    """
    motion_ink = written(executed, plunger_area_mm2, smoothing_mm, plunger_step_mm)
    chosen = style or _style_of([motion_ink.lines], layer_mm)
    return _laid_of(motion_ink, executed, plunger_area_mm2, faults, chosen, layer_mm)


def _laid_of(
    source: Written,
    executed: ExecutedMotion,
    plunger_area_mm2: float,
    faults: InkFaults,
    style: Style,
    layer_mm: float | None = None,
) -> Laid:
    """Return the ink of the lines that a motion writes."""
    ink = laid_as_is(source.lines, style, source.standing_ul, layer_mm)
    if faults.each:
        writes = np.zeros(len(executed), dtype=np.bool_)
        writes[source.block] = True
        line = Timeline.of(
            np.column_stack([executed.time_start, executed.time_end]),
            executed.line,
            np.linalg.norm(executed.end - executed.start, axis=1),
            (executed.plunger_end - executed.plunger_start) * plunger_area_mm2,
            writes,
        )
        ink = with_faults(ink, source.block, line, faults)
    # Ink of layers that was written along older ink holds both volumes.
    return ink if ink.layering is None else replace(ink, strands=united(ink.strands))


def with_faults(ink: Laid, block: NDArray[np.int64], line: Timeline, faults: InkFaults) -> Laid:
    """Return what faults leave of ink, whose strands are whole blocks of a timeline."""
    if not faults.each:
        return ink
    first = block.astype(np.float64)
    placed = Placed(ink.strands, first, np.asarray(first + 1.0, np.float64))
    lines = faulty_lines(placed, line, faults, ink.layering)
    return Laid(lines, ink.layering, ink.standing_ul)


def laid_as_is(
    lines: Strands, style: Style, standing_ul: float = 0.0, layer_mm: float | None = None
) -> Laid:
    """Return sound lines as ink that lies."""
    layering = Layering.of(lines, layer_mm) if style == "layered" else None
    return Laid(lines, layering, standing_ul)


def nothing_laid() -> Laid:
    """Return the ink of a print that hasn't begun."""
    none, places, number = np.zeros(0), np.zeros((0, 3)), np.zeros(0, np.int64)
    return Laid(Strands(places, places, none, none, number, number), None)


def _style_of(lines: Sequence[Strands], layer_mm: float | None = None) -> Style:
    start, end = (np.concatenate([getattr(one, at)[:, 2] for one in lines]) for at in _ENDS)
    return writing_style(start, end, layer_mm)


def writing_style(
    start_z_mm: FloatArray, end_z_mm: FloatArray, layer_mm: float | None = None
) -> Style:
    """Guess how a job of unknown origin writes: layered when level, on two levels or more.

    On one level only where `layer_mm` is given. Level filaments are mistaken for layers: a recipe
    or a map of lines that tells the style goes before this.
    """
    flat = np.abs(end_z_mm - start_z_mm).max() < 1e-3
    known = layer_mm is not None or len(written_levels(end_z_mm)) > 1
    return "layered" if flat and known else "embedded"


# The flow is steady while the valve stands open, so a block gets flow times its time: a corner at
# which the head slows down gets more. Within one block ink is spread evenly, though the head slows
# down at its ends. What flows while the head stands (a valve that opens early or closes late) would
# make a drop; the deposit model lays none, and tells its volume as `standing_ul`.
EXACT_MM: Final = 1e-6
"""Smoothing and plunger step of such a motion: what flows is known at every moment."""
_KNOWN: Final = 0.9


def valves_as_plungers(
    executed: ExecutedMotion, gcode: bytes, printer: Printer, flow_ul_s: Sequence[float]
) -> tuple[ExecutedMotion, ...]:
    """What each pneumatic head did, in its own tip's places, as a plunger of 1 mm² bore would.

    Parameters
    ----------
    executed : ExecutedMotion
        What the printer did, from the first move on.
    gcode : bytes
        The file, for when the valves stood open.
    flow_ul_s : sequence of float, µL/s
        Of each head while its valve does.

    Raises
    ------
    DepositError
        When the printer has no pneumatic head, or the motion isn't the file's.
    """
    heads = printer.airs
    if not heads:
        raise DepositError(f"{printer.name} has no pneumatic head (dispenser); use deposit")
    if not all(math.isfinite(flow) and flow > 0 for flow in flow_ul_s):
        raise DepositError(f"flow_ul_s is {list(flow_ul_s)}; each must be a number above 0")
    if not len(executed):
        raise DepositError("nothing moved, so nothing was deposited")
    x, y, z = executed.start[0].tolist()
    read = read_written(gcode, printer, (x, y, z))
    refuse_unread(read.file.refused)
    commanded = with_commands(executed, read.program)
    known = float((commanded.line >= 0).mean())  # a host puts in a pause's lift, say
    if known < _KNOWN:
        raise DepositError(
            f"only {known:.0%} of the motion is in the G-code, below {_KNOWN:.0%}; they aren't of "
            "the same print: give the file that was printed"
        )
    valves = read_valves(read.program, read.file.others, printer)
    offsets = [head.offset_mm.mm for head in printer.heads or ()] or [(0.0, 0.0, 0.0)]
    motions = []
    for number, (head, valve, flow) in enumerate(zip(heads, valves, flow_ul_s, strict=True)):
        spans = flowing(commanded, read.program, valve, head)
        motion = as_plunger(executed, spans, flow)
        motion = replace(motion, tool=np.full(len(motion), number))
        motions.append(motion.of_head(number, offsets[number]))
    return tuple(motions)
