"""Oxygen equations on one tissue grid: residual of each cell, its derivative, preconditioner."""

from __future__ import annotations

import numpy as np

from design.hemodynamics.oxygen.conditions import OxygenConditions
from design.hemodynamics.oxygen.elements import Elements, cut_vessels, lumen_share
from design.hemodynamics.oxygen.levels import (
    apply,
    bath_conductance,
    coarser,
    finest_level,
    restrict_losses,
)
from design.hemodynamics.oxygen.multigrid import VCycle
from design.hemodynamics.oxygen.tissue_grid import TissueGrid
from design.hemodynamics.oxygen.transport import gather, scatter, sweep, transport_of
from design.hemodynamics.oxygen.wall import exchange
from design.hemodynamics.zero_d.flow import FlowSolution
from design.network import VesselNetwork
from kernels.arrays import FloatArray


class OxygenProblem:
    """Diffusion and uptake in cells, coupled to vessels; all fields are flat, (cells,).

    A cell loses Σ D h (c - c') + g (c - c_bath) + φ V M c/(K + c) - (flux from vessels). Below 0,
    where only an iterate can be, uptake goes on with its slope there, M/K: the loss stays concave
    and smooth, and Newton's steps climb to the solution from below.
    """

    def __init__(
        self,
        network: VesselNetwork,
        flow: FlowSolution,
        grid: TissueGrid,
        conditions: OxygenConditions,
    ) -> None:
        self.grid, self.conditions = grid, conditions
        self.elements: Elements = cut_vessels(network, grid)
        self.transport = transport_of(network, flow, self.elements)
        one = self.elements
        bound = np.add.reduceat(one.weight, one.start[:-1]) > 0.0
        self.conductance = np.where(
            bound, exchange(one.radius, one.length, grid.spacing_mm, conditions), 0.0
        )
        self.share = np.where(grid.inside, 1.0 - lumen_share(network, grid), 0.0)
        self.uptake = (self.share * grid.cell_ul * conditions.uptake_millimolar_s).ravel()
        self.levels = coarser(finest_level(grid, conditions.tissue_diffusivity_mm2_s))
        self.bath = np.zeros(grid.inside.size)
        if conditions.bath_millimolar is not None:
            self.bath = bath_conductance(grid, conditions.tissue_diffusivity_mm2_s).ravel()
        self._lumped = np.zeros(grid.inside.size)
        self._scatter(self.conductance, self._lumped)

    def around(self, c: FloatArray) -> FloatArray:
        """What the grid holds at each element, (n,), mM."""
        return gather(self.elements.start, self.elements.cell, self.elements.weight, c)

    def _scatter(self, value: FloatArray, field: FloatArray) -> None:
        scatter(self.elements.start, self.elements.cell, self.elements.weight, value, field)

    def taken_up(self, c: FloatArray) -> FloatArray:
        """By each cell, nmol/s."""
        half = self.conditions.half_millimolar
        return self.uptake * c / (half + np.maximum(c, 0.0))

    def loss(self, c: FloatArray) -> FloatArray:
        """What each cell loses and isn't given, nmol/s; 0 for the solution."""
        bath = self.conditions.bath_millimolar or 0.0
        flux = sweep(
            self.transport, self.conductance, self.around(c), self.conditions.inlet_millimolar
        )[0]
        loss = self._spread(c, self.bath) + self.taken_up(c) - self.bath * bath
        self._scatter(-flux, loss)
        return loss

    def _spread(self, c: FloatArray, own: FloatArray) -> FloatArray:
        level, shape = self.levels[0], self.grid.inside.shape
        spread = np.zeros(shape)
        apply(level.east, level.north, level.up, own.reshape(shape), c.reshape(shape), spread)
        return spread.ravel()

    def slope(self, c: FloatArray) -> FloatArray:
        """Loss per concentration by uptake and bath, of each cell, µL/s."""
        half = self.conditions.half_millimolar
        return self.uptake * half / (half + np.maximum(c, 0.0)) ** 2 + self.bath

    def change(self, step: FloatArray, slope: FloatArray) -> FloatArray:
        """By how much `loss` changes with a small step, exactly: what is upstream included."""
        flux = sweep(self.transport, self.conductance, self.around(step), 0.0)[0]
        change = self._spread(step, slope)
        self._scatter(-flux, change)
        return change

    def approximate_inverse(self, slope: FloatArray) -> VCycle:
        """Of `change`, with each vessel's exchange counted at the cells themselves."""
        self.levels[0].own.ravel()[:] = slope + self._lumped
        restrict_losses(self.levels)
        return VCycle(self.levels)
