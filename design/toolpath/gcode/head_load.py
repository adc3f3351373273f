"""Syringe and ink of each print head; its plunger relief while idle."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from design.toolpath.gcode.commands import plunger_mm_per_ul
from design.toolpath.gcode.table import JobPosition
from design.toolpath.toolpath import require_not_negative, require_positive
from firmware_profiles import Head, Printer, Syringe
from kernels.arrays import FloatArray

_E = 3


@dataclass(frozen=True)
class HeadLoad:
    """Syringe and ink of one head.

    Attributes
    ----------
    syringe : Syringe
    flow_factor : float
        As in `GcodeOptions`, of this head's ink.
    relieve_ul, plunger_ul_s : float, µL, µL/s
        As in `GcodeOptions`: relief before the head is left, where the toolpath has none.
    """

    syringe: Syringe
    flow_factor: float = 1.0
    relieve_ul: float = 0.02
    plunger_ul_s: float = 0.4

    def __post_init__(self) -> None:
        where = "head's load"
        require_positive(where, flow_factor=self.flow_factor, plunger_ul_s=self.plunger_ul_s)
        require_not_negative(where, relieve_ul=self.relieve_ul)


@dataclass
class IdleHead:
    """One head between two runs of its moves.

    Attributes
    ----------
    number : int
    head : Head
    printer : Printer
        As if it were the only one (`Printer.of_head`).
    load : HeadLoad
    pushed_ul : float, µL
        What its toolpath has pushed.
    quantum, base : int
        Its plunger's travel as written, and what E's counting anew has taken off it.
    relieved : bool
        Whether nothing presses: it has pushed nothing yet, or was relieved since.
    owed_ul : float, µL
        Relief that the writer put in itself, to be primed when the head comes back.
    """

    number: int
    head: Head
    printer: Printer
    load: HeadLoad
    pushed_ul: float = 0.0
    quantum: int = 0
    base: int = 0
    relieved: bool = True
    owed_ul: float = 0.0

    @property
    def offset(self) -> FloatArray:
        """Of its tip from the first head's, (3,), mm."""
        return np.array(self.head.offset_mm.mm)

    @property
    def per_ul(self) -> float:
        """Plunger travel per volume, mm/µL."""
        return plunger_mm_per_ul(self.printer, self.load.syringe)

    @property
    def plunger_mm(self) -> float:
        """Where its plunger stands, from the job's begin."""
        return self.pushed_ul * self.per_ul / self.load.flow_factor - self.owed_ul * self.per_ul

    def reached(self, at: JobPosition) -> JobPosition:
        """``at``, with this head's plunger in place of another's."""
        quanta = at.quanta.copy()
        quanta[_E] = self.quantum
        return replace(at, quanta=quanta, base=self.base)

    def remember(self, at: JobPosition) -> None:
        """Keep how far this head's plunger has come in the text."""
        self.quantum, self.base = int(at.quanta[_E]), at.base
