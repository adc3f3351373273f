"""Record one cycle of 1D flow: waves at chosen points, and extremes everywhere."""

from __future__ import annotations

import numpy as np

from design.hemodynamics.one_d.grid import Grid
from design.hemodynamics.one_d.kernels.march import MarchScratch, State, all_pressures
from design.hemodynamics.probes import Probes
from kernels.arrays import FloatArray, IntArray


class Lines:
    """Cells of each vessel with its two ends beside them, and places between.

    Parameters
    ----------
    grid : Grid
    places : Probes
        Where waves are kept.
    samples : int
    """

    def __init__(self, grid: Grid, places: Probes, samples: int) -> None:
        vessels = np.arange(len(grid.cell))
        self.grid = grid
        self.begin = grid.offset[:-1] + 2 * vessels
        self.final = grid.offset[1:] + 2 * vessels + 1
        self.inner = np.arange(grid.offset[-1]) + 2 * grid.vessel_of_cell + 1
        self.low, self.high, self.weight = self._between(places)
        size = int(grid.offset[-1]) + 2 * len(vessels)
        self._values = np.empty((3, size))
        self._pressure = np.empty(int(grid.offset[-1]))
        self.ends = np.empty((2, 2, len(vessels), samples))
        self.waves = np.empty((3, len(places.vessel), samples))
        self.least = np.full((3, size), np.inf)
        self.most = np.full((3, size), -np.inf)

    def _between(self, places: Probes) -> tuple[IntArray, IntArray, FloatArray]:
        counts = np.diff(self.grid.offset)[places.vessel]
        along = places.fraction * counts
        cell = np.clip(np.floor(along + 0.5).astype(np.int64), 0, counts)
        low = self.begin[places.vessel] + cell
        # Ends are half a cell from their neighbours' middles.
        start = np.where(cell == 0, 0.0, cell - 0.5)
        stop = np.where(cell == counts, counts, cell + 0.5)
        return low, low + 1, (along - start) / (stop - start)

    def take(self, sample: int, state: State, work: MarchScratch) -> None:
        """Keep a state, after `settle_ends`."""
        all_pressures(self.grid, state, work, self._pressure)
        ends = work.ends[:3].reshape(3, -1, 2)
        inside = (self._pressure, state.flow, state.area)
        for values, cells, at in zip(self._values, inside, (2, 1, 0), strict=True):
            values[self.inner] = cells
            sign = -1.0 if at == 1 else 1.0
            values[self.begin], values[self.final] = sign * ends[at, :, 0], ends[at, :, 1]
        for k in range(2):
            self.ends[k, 0, :, sample] = self._values[k, self.begin]
            self.ends[k, 1, :, sample] = self._values[k, self.final]
        low, high = self._values[:, self.low], self._values[:, self.high]
        self.waves[:, :, sample] = low + self.weight * (high - low)
        np.minimum(self.least, self._values, out=self.least)
        np.maximum(self.most, self._values, out=self.most)

    def extremes(self) -> tuple[FloatArray, FloatArray]:
        """Least and most of pressure, flow and area in each vessel, (3, v) each."""
        return (
            np.minimum.reduceat(self.least, self.begin, axis=1),
            np.maximum.reduceat(self.most, self.begin, axis=1),
        )

    def ranges(self) -> tuple[float, float]:
        """Between least and greatest pressure, and the greatest flow, in the whole network."""
        pressure = float(self.most[0].max() - self.least[0].min())
        return pressure, float(max(self.most[1].max(), -self.least[1].min()))
