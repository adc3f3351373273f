"""Reach 1D flow's periodic state in fewer cycles, by Anderson acceleration of cycle starts.

A cycle is a map x → G(x) of the state at its begin to that at its end, and the periodic state its
fixed point. Left to itself the error falls by exp(-period/RC) a cycle. Anderson's acceleration
(1965, doi 10.1145/321296.321305; Walker & Ni 2011, doi 10.1137/10078356X) takes, of the last few
cycles, the mixture whose change G(x) - x is least: exact where what is left is a handful of slow
modes. Whether a state is periodic is judged by the cycle that follows, never by the mixture.
"""

from __future__ import annotations

import numpy as np

from design.hemodynamics.one_d.grid import Grid
from design.hemodynamics.one_d.kernels.march import State
from kernels.arrays import FloatArray

_MEMORY = 3
_FIRST = 2
"""Cycles left to themselves: waves of the start die out."""


class Acceleration:
    """Begins of cycles and what they ended in.

    Parameters
    ----------
    grid : Grid
    """

    def __init__(self, grid: Grid) -> None:
        self._grid = grid
        self._ends: list[FloatArray] = []
        self._changes: list[FloatArray] = []
        self._cycles = 0

    def improve(self, begun: State, state: State, swing: float, greatest: float) -> None:
        """Put a better begin of the next cycle into ``state``, a cycle's end.

        Parameters
        ----------
        begun, state : State
        swing, greatest : float, Pa, µL/s
            What pressures and flows are measured by.
        """
        self._cycles += 1
        if self._cycles <= _FIRST:
            return
        scale = np.concatenate(
            [np.full(len(state.area), swing), np.full(len(state.flow), greatest),
             np.full(len(state.stored), swing)]
        ) + 1e-300  # fmt: skip
        end = self._packed(state)
        change = (end - self._packed(begun)) / scale
        if self._changes and np.abs(change).max() > 2.0 * np.abs(self._changes[-1]).max():
            self._ends, self._changes = [], []
        self._ends = [*self._ends, end][-_MEMORY - 1 :]
        self._changes = [*self._changes, change][-_MEMORY - 1 :]
        if len(self._ends) > 1:
            self._unpack(self._mixed(), state)

    def _mixed(self) -> FloatArray:
        """The mixture of the ends kept whose changes' mixture is least."""
        last = self._changes[-1]
        apart = np.array([last - other for other in self._changes[:-1]]).T
        share = np.linalg.lstsq(apart, last, rcond=1e-6)[0]
        end = self._ends[-1]
        back = [part * (end - other) for part, other in zip(share, self._ends[:-1], strict=True)]
        return np.asarray(end - np.sum(back, axis=0))

    def _packed(self, state: State) -> FloatArray:
        """Pressure, flow and what outlets store."""
        grid = self._grid
        pressure = grid.stiffness * (np.sqrt(state.area) * grid.root - 1.0)
        return np.concatenate([pressure, state.flow, state.stored])

    def _unpack(self, packed: FloatArray, state: State) -> None:
        count = len(state.area)
        width = 1.0 + packed[:count] / self._grid.stiffness
        if width.min() <= 0.1:
            return
        state.area[:] = self._grid.area * width**2
        state.flow[:] = packed[count : 2 * count]
        state.stored[:] = packed[2 * count :]
