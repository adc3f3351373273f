"""Compute ink deposited in the dish by executed motion, with ink faults.

The simulated scanner and the simulated camera both take it from here, so that they show the same
ink. Levels and heights of layers are those of the sound lines: a clog doesn't change where the
next layer is written.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from kernels.arrays import FloatArray
from sim.gcode.deposit.faulty_lines import Placed, faulty_lines
from sim.gcode.deposit.ink_faults import InkFaults
from sim.gcode.deposit.ink_timeline import Timeline
from sim.gcode.deposit.levels import Layering, written_levels
from sim.gcode.deposit.rewritten import united
from sim.gcode.deposit.strands import Strands
from sim.gcode.deposit.written import Written, written
from sim.gcode.motion.executed import ExecutedMotion

Style = Literal["layered", "embedded"]


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
    smoothing_mm: float = 1.0,
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
    plunger_area_mm2 : float, mm²
    smoothing_mm, style, plunger_step_mm
        As of `sim.gcode.deposit.lay.deposit`.
    layer_mm : float or None, mm
        Height of the lines while there is but one level, which doesn't tell it.

    Raises
    ------
    DepositError
        When nothing is written.
    """
    motion_ink = written(executed, plunger_area_mm2, smoothing_mm, plunger_step_mm)
    chosen = style or writing_style(motion_ink.lines, layer_mm)
    return laid_of_written(motion_ink, executed, plunger_area_mm2, faults, chosen, layer_mm)


def laid_of_written(
    source: Written,
    executed: ExecutedMotion,
    plunger_area_mm2: float,
    faults: InkFaults,
    style: Style,
    layer_mm: float | None = None,
) -> Laid:
    """Return the ink of lines that `written` found in a motion; parameters as of `laid`."""
    ink = laid_as_is(source.lines, style, source.standing_ul, layer_mm)
    if not faults.each:
        return _as_it_lies(ink)
    writes = np.zeros(len(executed), dtype=np.bool_)
    writes[source.block] = True
    line = Timeline.of(
        np.column_stack([executed.time_start, executed.time_end]),
        executed.line,
        np.linalg.norm(executed.end - executed.start, axis=1),
        (executed.plunger_end - executed.plunger_start) * plunger_area_mm2,
        writes,
    )
    return _as_it_lies(with_faults(ink, source.block, line, faults))


def _as_it_lies(ink: Laid) -> Laid:
    """Ink of layers that was written along older ink, with both volumes."""
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


def writing_style(lines: Strands, layer_mm: float | None = None) -> Style:
    """Layered when all is flat, on two levels or more; or on one where `layer_mm` is given."""
    flat = np.abs(lines.end[:, 2] - lines.start[:, 2]).max() < 1e-3
    known = layer_mm is not None or len(written_levels(lines.end[:, 2])) > 1
    return "layered" if flat and known else "embedded"
