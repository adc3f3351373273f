"""A held print and its written paths: job, lines done, position, points, widths."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Final, Literal

import numpy as np

from design.geometry.polyline import arc_lengths, places_along
from firmware_profiles import Ink, Needle, Printer, Syringe
from gcode.deposit.written import Layering
from gcode.program.gcode import Program
from gcode.program.modal import MOVE
from gcode.program.read_program import declared_start, read_written
from kernels.arrays import BoolArray, FloatArray, IntArray
from printctl.checks.bead import lag_of
from printctl.errors import PrintctlError
from printctl.machine.job.coordinates import Modal, modal_state, relieved_mm


class MendError(PrintctlError):
    """Refusal to plan a mend; the message says why, and what to do."""


Style = Literal["layered", "embedded"]
WAY_MM: Final = 1e-6
"""Moves shorter than this count as no move."""
_DEFAULT_TRAVEL_MM_S: Final = 10.0
"""Speed of travels where the job has none; lifts take half of it."""


@dataclass(frozen=True)
class HeldPrint:
    """Job held after ``done`` of its lines.

    Attributes
    ----------
    lines : sequence of bytes
        Commands of the (grown) job as the link sends them (`printctl.machine.job.job.Job.lines`).
    done : int
        Lines taken; the needle is where the last of them left it.
    printer : Printer
    syringe : Syringe
    ink : Ink
    needle : Needle
    style : "layered" or "embedded"
        Lines of layers, or filaments in a bath.

    Raises
    ------
    MendError
        For several heads or a pneumatic one, for a job whose place isn't known, or which counts
        places anew on its way.
    """

    lines: Sequence[bytes]
    done: int
    printer: Printer
    syringe: Syringe
    ink: Ink
    needle: Needle
    style: Style

    def __post_init__(self) -> None:
        if self.printer.pneumatic or self.printer.heads:
            raise MendError(
                f"{self.printer.name}: mends are written for one head with a plunger; pause and "
                "mend by hand, or print on"
            )
        if not 0 < self.done <= len(self.lines):
            raise MendError(f"{self.done} lines done of {len(self.lines)}; nothing can be mended")
        at = self.place
        if at.x is None or at.y is None or at.z is None or at.e is None:
            raise MendError("the job hasn't placed needle and plunger yet; go on first")
        native = self.program.target[int(np.searchsorted(self.program.command, self.done)) - 1]
        off = np.abs(native - np.array([at.x, at.y, at.z, at.e])).max()
        if off > WAY_MM:
            raise MendError(
                f"the job counts places anew on its way (G92), {off:.3f} mm apart from the "
                "machine's; a mend might lie there; write the job without"
            )

    @cached_property
    def text(self) -> bytes:
        """The job as a file of one command a line."""
        return b"\n".join(self.lines) + b"\n"

    @cached_property
    def start_mm(self) -> tuple[float, float, float]:
        """Where the job says that the tip begins, mm."""
        return declared_start(self.text, self.printer) or (0.0, 0.0, 0.0)

    @cached_property
    def program(self) -> Program:
        """All rows of the job, those to come included."""
        return read_written(self.text, self.printer, self.start_mm).program

    @cached_property
    def place(self) -> Modal:
        """Needle, plunger and feed where the print is held."""
        return modal_state(self.lines, self.done)

    @property
    def at_mm(self) -> FloatArray:
        """Where the tip is held, (3,), mm."""
        return np.array([self.place.x, self.place.y, self.place.z], dtype=np.float64)

    @property
    def e_mm(self) -> float:
        """Plunger as the job counts it there, mm."""
        return float(self.place.e or 0.0)

    @cached_property
    def way(self) -> FloatArray:
        """Length of each row's move, (n,), mm."""
        program = self.program
        return np.linalg.norm(program.target[:, :3] - program.before[:, :3], axis=1)

    @cached_property
    def writes(self) -> BoolArray:
        """Rows that push ink on their way, (n,), those to come included."""
        program = self.program
        return (program.kind == MOVE) & (program.pushed > 0) & (self.way > WAY_MM)

    @property
    def layered(self) -> bool:
        """Whether lines are laid in layers."""
        return self.style == "layered"

    @property
    def ul_per_e(self) -> float:
        """Ink that comes out for a millimetre of E, µL."""
        return self.syringe.area_mm2 * self.ink.flow_factor

    @cached_property
    def lag_s(self) -> float:
        """Measured lag of the flow; 0 where it isn't known."""
        return lag_of(self.ink, self.syringe, self.needle, None).seconds

    @cached_property
    def relieved_e(self) -> float:
        """How far the job itself has drawn the plunger back where it is held, mm of E."""
        relieved = relieved_mm(self.lines, self.done)
        return self.relief_e if math.isinf(relieved) else relieved

    @property
    def relief_e(self) -> float:
        """Relief at the end of a written path, mm of E."""
        return self.ink.retract_ul / self.ul_per_e

    @property
    def plunger_mm_s(self) -> float:
        """Speed of the plunger while the needle stands, mm/s."""
        return min(self.ink.plunger_ul_s / self.ul_per_e, self.printer.max_speed_mm_s.e)

    @cached_property
    def travel_mm_s(self) -> float:
        """Speed of travels across: the job's own, mm/s."""
        limit = min(self.printer.max_speed_mm_s.x, self.printer.max_speed_mm_s.y)
        return min(self._usual_travel_mm_s(upright=False), limit)

    @cached_property
    def lift_mm_s(self) -> float:
        """Speed of lifts and descents: the job's own, mm/s."""
        return min(self._usual_travel_mm_s(upright=True), self.printer.max_speed_mm_s.z)

    def _usual_travel_mm_s(self, *, upright: bool) -> float:
        """Return the most common feed of the job's travels, mm/s; the slowest of equals."""
        program = self.program
        step = np.abs(program.target[:, :3] - program.before[:, :3])
        flat = np.hypot(step[:, 0], step[:, 1])
        chosen = (program.kind == MOVE) & (program.pushed == 0) & (self.way > WAY_MM)
        chosen &= (flat <= WAY_MM) if upright else (flat > WAY_MM)
        if not chosen.any():
            return _DEFAULT_TRAVEL_MM_S / 2 if upright else _DEFAULT_TRAVEL_MM_S
        feeds, counts = np.unique(program.feed[chosen], return_counts=True)
        return float(feeds[counts.argmax()])


LEAST_MM: Final = 0.1
"""Shorter moves at a patch's ends aren't made: firmware adds them to the next one."""
_ROUNDING_MM: Final = 1e-9
"""A corner as far away as `LEAST_MM`, but for rounding, isn't nearer."""
_NO_SPARE_MM: Final = (0.0, 0.0)


@dataclass(frozen=True, eq=False)
class WrittenPath:
    """Path that is written without a travel in between.

    Attributes
    ----------
    number : int
        From 0, in the job's order.
    points : (k + 1, 3) float64, mm
    e_per_mm : (k,) float64
        Plunger over way of each piece, as the job's text counts E.
    feed_mm_s : (k,) float64, mm/s
    command : (k,) int64
        Of the job, from 0.
    width_mm : (k,) float64, mm
        Width of a line in a layer, or diameter of a filament.
    height_mm : (k,) float64, mm
        Of the line, which hangs below the tip; or the diameter.
    """

    number: int
    points: FloatArray
    e_per_mm: FloatArray
    feed_mm_s: FloatArray
    command: IntArray
    width_mm: FloatArray
    height_mm: FloatArray

    @cached_property
    def arc(self) -> FloatArray:
        """Arc length to each point, (k + 1,), mm."""
        return arc_lengths(self.points)

    @property
    def length_mm(self) -> float:
        """Length of the whole path, mm."""
        return float(self.arc[-1])

    def at(self, along: FloatArray) -> FloatArray:
        """Return the places (m, 3), mm, at ways along the path (m,), mm."""
        return places_along(self.points, self.arc, along)

    def piece(self, along: FloatArray) -> IntArray:
        """Return the piece at ways along the path, (m,); at a corner the one behind it."""
        piece = np.searchsorted(self.arc, along, side="right") - 1
        return np.clip(piece, 0, len(self.command) - 1)

    def usual_width(self, from_mm: float, to_mm: float) -> float:
        """Return the mean width between two places along the path, mm."""
        middle = np.linspace(from_mm, to_mm, 9)
        return float(self.width_mm[self.piece(middle)].mean())

    def cuts(
        self,
        from_mm: float,
        to_mm: float,
        least_mm: float = 0.0,
        spare: tuple[float, float] = _NO_SPARE_MM,
    ) -> FloatArray:
        """Return ways at which a stretch begins, turns and ends, (m + 1,), mm.

        Where a corner within the stretch is nearer than ``least_mm`` to an end, that end is moved
        to it by up to ``spare`` (mm at the begin, at the end); else the corner is left out.
        """
        corners = self.arc[(self.arc > from_mm) & (self.arc < to_mm)]
        near = least_mm - _ROUNDING_MM
        inner = corners[(corners > from_mm + near) & (corners < to_mm - near)]
        first = corners[corners <= from_mm + min(least_mm, spare[0])].max(initial=from_mm)
        last = corners[corners >= to_mm - min(least_mm, spare[1])].min(initial=to_mm)
        if first >= last:
            return np.array([from_mm, to_mm])
        return np.concatenate([[first], inner[(inner > first) & (inner < last)], [last]])

    def clear_of_corners(self, from_mm: float, to_mm: float) -> tuple[float, float]:
        """Make a stretch longer where its ends are nearer than `LEAST_MM` to a corner within it."""
        corners = self.arc[(self.arc > from_mm) & (self.arc < to_mm)]
        first = corners[corners < from_mm + LEAST_MM] - LEAST_MM
        last = corners[corners > to_mm - LEAST_MM] + LEAST_MM
        low, high = first.min(initial=from_mm), last.max(initial=to_mm)
        return max(0.0, float(low)), min(self.length_mm, float(high))

    def nearest_mm(self, place: FloatArray) -> tuple[float, float]:
        """Return the way along the path of the point nearest to a place, and its distance, mm."""
        begin, step = self.points[:-1], np.diff(self.points, axis=0)
        square = (step**2).sum(axis=1)
        share = np.clip(((place - begin) * step).sum(axis=1) / square, 0.0, 1.0)
        away = np.linalg.norm(begin + share[:, None] * step - place, axis=1)
        k = int(away.argmin())
        return float(self.arc[k] + share[k] * np.sqrt(square[k])), float(away[k])


def written_paths(held_print: HeldPrint, until: int | None = None) -> tuple[WrittenPath, ...]:
    """Return the paths that the job has written where it is held.

    Parameters
    ----------
    held_print : HeldPrint
    until : int or None
        Lines to read; those done if None. Later paths are cut there.
    """
    program = held_print.program
    taken = program.command < (held_print.done if until is None else until)
    chosen = np.flatnonzero(held_print.writes & taken)
    if not len(chosen):
        return ()
    breaks = (program.kind == MOVE) & ~held_print.writes & (held_print.way > WAY_MM)
    number = np.cumsum(breaks)[chosen]
    width, height = _sections(held_print, chosen)
    e_per_mm = program.pushed[chosen] / held_print.way[chosen]
    paths: list[WrittenPath] = []
    for own in np.split(np.arange(len(chosen)), np.flatnonzero(np.diff(number)) + 1):
        row = chosen[own]
        points = np.vstack([program.before[row[:1], :3], program.target[row, :3]])
        paths.append(
            WrittenPath(
                len(paths),
                points,
                e_per_mm[own],
                program.feed[row],
                program.command[row],
                width[own],
                height[own],
            )
        )
    return tuple(paths)


def _sections(held_print: HeldPrint, rows: IntArray) -> tuple[FloatArray, FloatArray]:
    """Return width and height of written rows, (n,) each, mm."""
    every = np.flatnonzero(held_print.writes)
    area = held_print.program.pushed[every] / held_print.way[every] * held_print.ul_per_e
    if held_print.style == "embedded":
        swell = held_print.ink.swell_factor or 1.0
        wide = np.sqrt(4 / np.pi * area)[np.searchsorted(every, rows)] * swell
        return wide, wide
    height = layer_heights(held_print, every, area)
    width = held_print.ink.bead_section.width(area, height)
    own = np.searchsorted(every, rows)
    return width[own], height[own]


def layer_heights(held_print: HeldPrint, rows: IntArray, area_mm2: FloatArray) -> FloatArray:
    """Return each written row's layer height, (n,), mm; a single layer has round lines."""
    from_z = held_print.program.target[rows, 2]
    round_mm = float(np.median(np.sqrt(4 / np.pi * area_mm2)))
    return Layering.at(from_z, area_mm2, round_mm).heights(from_z)
