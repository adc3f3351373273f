"""Record one cycle of pulsatile 3D flow (ports, sections, fields); time-stepping options."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from design.errors import FlowError
from design.hemodynamics.three_d.balance import port_pressures
from design.hemodynamics.three_d.lumen_mesh import LumenMesh
from design.hemodynamics.three_d.sample import field_of
from design.hemodynamics.three_d.sections import Section
from design.hemodynamics.three_d.solution import Field, ThreeDWaves
from design.hemodynamics.three_d.stokes import Spaces
from kernels.arrays import FloatArray


@dataclass(frozen=True)
class Stepping:
    """Time stepping options of pulsatile 3D flow.

    Attributes
    ----------
    steps : int
        In a cycle.
    cycles : int
        At most.
    tolerance : float
        Change from a cycle's begin to its end, of the largest value, of a periodic state.
    frames : int
        Fields kept of the last cycle, evenly apart; flows and pressures are kept at every step.
    """

    steps: int = 50
    cycles: int = 20
    tolerance: float = 1e-4
    frames: int = 4

    def __post_init__(self) -> None:
        if self.steps < 8 or self.cycles < 1 or not 0 <= self.frames <= self.steps:
            raise FlowError(
                f"{self.steps} steps in each of {self.cycles} cycles, {self.frames} kept; take 8 "
                "steps, 1 cycle or more, and no more frames than steps"
            )


class Record:
    """One cycle of what a user asks for."""

    def __init__(
        self, room: Spaces, mesh: LumenMesh, clock: Stepping, sections: Sequence[Section]
    ) -> None:
        self.room, self.mesh, self.sections = room, mesh, sections
        ports, steps = len(mesh.ports), clock.steps
        self.flow, self.pressure = np.empty((ports, steps)), np.empty((ports, steps))
        self.through = np.empty((2, len(sections), steps))
        self.kept = (np.arange(clock.frames) * steps) // max(clock.frames, 1)
        self.frames: dict[int, Field] = {}

    def keep(self, k: int, unknowns: FloatArray) -> None:
        """Take unknowns (n,) as those of step k."""
        room = self.room
        self.flow[:, k] = room.outward @ unknowns
        self.pressure[:, k] = port_pressures(room, unknowns)
        if k not in self.kept and not self.sections:
            return
        field = field_of(room, self.mesh, unknowns)
        for s, section in enumerate(self.sections):
            self.through[:, s, k] = section.flow(field), section.mean_pressure(field)
        if k in self.kept:
            self.frames[k] = field

    def waves(self, times: FloatArray, change: FloatArray) -> ThreeDWaves:
        """As it stands."""
        fields = tuple(self.frames[int(k)] for k in self.kept)
        flow, pressure = self.through
        return ThreeDWaves(
            times, self.flow, self.pressure, flow, pressure, self.kept, fields, change
        )
