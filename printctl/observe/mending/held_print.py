"""Data class of a held print: job, lines done, mounted profiles; position and modes there."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Final, Literal

import numpy as np

from firmware_profiles import Ink, Needle, Printer, Syringe
from kernels.arrays import BoolArray, FloatArray
from printctl.checks.bead import lag_of
from printctl.machine.link.modal import Modal, modal_state, relieved_mm
from printctl.observe.mending.errors import MendError
from sim.gcode.deposit.written import written_levels
from sim.gcode.program.gcode import Program
from sim.gcode.program.modal import MOVE
from sim.gcode.program.read_program import read_written
from sim.gcode.reading.comments import declared_start

Style = Literal["layered", "embedded"]

WAY_MM: Final = 1e-6
"""A shorter way is none."""
_LEVEL_MM: Final = 1e-3
_TRAVEL_MM_S: Final = 10.0
"""Of travels, and below it of lifts, where the job has none to follow."""


@dataclass(frozen=True)
class HeldPrint:
    """Job that stands still after ``done`` of its lines.

    Attributes
    ----------
    lines : sequence of bytes
        Commands of the (grown) job as the link sends them (`printctl.machine.link.job.Job.lines`).
    done : int
        Lines taken; the needle is where the last of them left it.
    printer : Printer
    syringe : Syringe
    ink : Ink
    needle : Needle
    style_given : "layered", "embedded" or None
        None decides by the job's moves, as `sim.gcode.deposit.lay` does.

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
    style_given: Style | None = None

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
            raise MendError("the job hasn't said yet where needle and plunger stand; go on first")
        row = self._last_row
        native = self.program.target[row]
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

    @property
    def _last_row(self) -> int:
        return int(np.searchsorted(self.program.command, self.done)) - 1

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

    @cached_property
    def style(self) -> Style:
        """Whether lines are laid in layers or filaments into a bath."""
        if self.style_given is not None:
            return self.style_given
        program, rows = self.program, self.writes
        if not rows.any():
            return "embedded"
        ends = program.target[rows, 2]
        level = np.abs(ends - program.before[rows, 2]).max() < _LEVEL_MM
        return "layered" if level and len(written_levels(ends)) > 1 else "embedded"

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
        return min(self._travelled(upright=False), limit)

    @cached_property
    def lift_mm_s(self) -> float:
        """Speed of lifts and descents: the job's own, mm/s."""
        return min(self._travelled(upright=True), self.printer.max_speed_mm_s.z)

    def _travelled(self, *, upright: bool) -> float:
        """Usual feed of the job's travels; of several equally usual ones the slowest."""
        program = self.program
        step = np.abs(program.target[:, :3] - program.before[:, :3])
        flat = np.hypot(step[:, 0], step[:, 1])
        chosen = (program.kind == MOVE) & (program.pushed == 0) & (self.way > WAY_MM)
        chosen &= (flat <= WAY_MM) if upright else (flat > WAY_MM)
        if not chosen.any():
            return _TRAVEL_MM_S / 2 if upright else _TRAVEL_MM_S
        feeds, counts = np.unique(program.feed[chosen], return_counts=True)
        return float(feeds[counts.argmax()])

    @cached_property
    def top_mm(self) -> float:
        """Highest that the job itself takes the tip, mm: above dish and part."""
        return float(self.program.target[self.program.kind == MOVE, 2].max())
