"""Periodic flow and pressure tables of svZeroDSolver's input, interpolated as that program does.

Linear between samples. A time is taken modulo the period, last time less first; what then lies
outside the samples is extrapolated from the nearest two.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from design.errors import FlowError
from kernels.arrays import FloatArray

_SAME_PERIOD = 1e-12


@dataclass
class Tables:
    """Tables of one file; a table is known by its number.

    Attributes
    ----------
    period : float or None
        Common to all tables that change; None where none does.
    """

    period: float | None = None
    _grids: list[FloatArray] = field(default_factory=list)
    _values: list[list[FloatArray]] = field(default_factory=list)
    _slots: list[tuple[int, int]] = field(default_factory=list)
    _known: dict[bytes, int] = field(default_factory=dict)

    def add(self, time: FloatArray, value: FloatArray, place: str) -> int:
        """Add a table of times and values, (k,) each; return its number.

        Raises
        ------
        FlowError
            For different lengths, times that fall, another period than that of other tables.
        """
        if len(time) != len(value) and len(value) > 1:
            raise FlowError(f"{place} has {len(time)} times for {len(value)} values")
        if len(value) == 1:
            time = np.zeros(1)
        elif (np.diff(time) < 0.0).any() or time[-1] <= time[0]:
            raise FlowError(f"{place} has times t that don't rise")
        else:
            self.agree(float(time[-1] - time[0]), place)
        grid = self._known.setdefault(time.tobytes(), len(self._grids))
        if grid == len(self._grids):
            self._grids.append(time)
            self._values.append([])
        self._values[grid].append(value)
        self._slots.append((grid, len(self._values[grid]) - 1))
        return len(self._slots) - 1

    def sampler(self) -> Sampler:
        """Return what samples all tables at once."""
        numbers = [
            np.array([k for k, slot in enumerate(self._slots) if slot[0] == grid])
            for grid in range(len(self._grids))
        ]
        return Sampler(len(self._slots), self._grids, [np.array(v) for v in self._values], numbers)

    def agree(self, period: float, place: str) -> None:
        """Take a period as that of all tables.

        Raises
        ------
        FlowError
            When another one is known.
        """
        if self.period is None:
            self.period = period
        elif abs(period - self.period) > _SAME_PERIOD * self.period:
            raise FlowError(
                f"{place} has a period of {period:.12g} (last time t less first); another table, "
                f"cardiac_period or cardiac_cycle_period has {self.period:.12g}"
            )


@dataclass(frozen=True)
class Sampler:
    """All tables of a file, sampled together.

    Attributes
    ----------
    count : int
    grids : list of (k,) float64
        Times that several tables share.
    values : list of (m, k) float64
    numbers : list of (m,) int64
        Numbers of the tables on each grid.
    """

    count: int
    grids: list[FloatArray]
    values: list[FloatArray]
    numbers: list[np.ndarray[tuple[int], np.dtype[np.int64]]]

    def at(self, times: FloatArray) -> FloatArray:
        """Return the value of each table at times (s,), (s, count)."""
        sampled = np.empty((len(times), self.count))
        for grid, values, numbers in zip(self.grids, self.values, self.numbers, strict=True):
            if len(grid) == 1:
                sampled[:, numbers] = values[:, 0]
                continue
            here = np.fmod(times, grid[-1] - grid[0])
            high = np.clip(np.searchsorted(grid, here), 1, len(grid) - 1)
            rise = values[:, high] - values[:, high - 1]
            share = (here - grid[high - 1]) / (grid[high] - grid[high - 1])
            sampled[:, numbers] = (values[:, high - 1] + share * rise).T
        return sampled

    def mean(self) -> FloatArray:
        """Return the plain mean of each table's samples, (count,)."""
        means = np.empty(self.count)
        for values, numbers in zip(self.values, self.numbers, strict=True):
            means[numbers] = values.mean(axis=1)
        return means
