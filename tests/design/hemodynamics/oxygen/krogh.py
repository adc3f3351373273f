"""Krogh's cylinder: one vessel on the axis of a cylinder of tissue, by the formulas."""

from dataclasses import dataclass

import numpy as np

from design.hemodynamics import FlowConditions, solve_flow
from design.hemodynamics.oxygen import OxygenConditions, OxygenSolution, TissueGrid, solve_oxygen
from design.network import VesselNetwork
from kernels.arrays import FloatArray
from tests.design.hemodynamics.networks import network_of

OUTER, LENGTH, FLOW = 0.3, 3.0, 0.05
FILLED = OxygenConditions(cells_per_ml=3e7, half_millimolar=1e-7)
"""Uptake that doesn't ask how much there is."""


def tissue_cylinder(cells: int) -> TissueGrid:
    """A cylinder about z from 0 to `LENGTH`, so many cells in its radius."""
    h = OUTER / cells
    across = h * (np.arange(2 * cells + 2) - cells - 0.5)
    along = h * (np.arange(round(LENGTH / h) + 2) - 0.5)
    deep = OUTER - np.hypot(across[:, None], across)
    depth = np.minimum(deep[:, :, None], np.minimum(along, LENGTH - along)).astype(np.float32)
    return TissueGrid(np.array([across[0], across[0], along[0]]), h, depth > 0.0, depth)


def vessel(radius: float, turned: bool = False) -> VesselNetwork:
    ends = [(1, 0)] if turned else [(0, 1)]
    return network_of([[0, 0, 0], [0, 0, LENGTH]], ends, radius)


@dataclass(frozen=True)
class Compared:
    """Solved against the formulas, away from the ends and the wall.

    ``worst`` and ``rms`` are of the fall of concentration in the tissue.
    """

    solution: OxygenSolution
    leaves: float
    worst: float
    rms: float


def compare(radius: float, cells: int, conditions: OxygenConditions = FILLED) -> Compared:
    grid, network = tissue_cylinder(cells), vessel(radius)
    flow = solve_flow(network, FlowConditions(1e-3, inlet_flow_ul_s=FLOW))
    found = solve_oxygen(network, flow, grid, conditions)
    h, shape = grid.spacing_mm, grid.inside.shape
    x, y, z = (grid.origin_mm[k] + h * np.arange(shape[k]) for k in range(3))
    r = np.hypot(x[:, None], y)[:, :, None] + 0.0 * z
    volume = float(found.tissue_share.sum()) * grid.cell_ul
    exact, leaves = formulas(radius, volume, r, z, conditions)
    far = grid.inside & (r > radius + 2.0 * h) & (z > 0.8) & (z < LENGTH - 0.8)
    off = (found.concentration - exact)[far]
    fall = conditions.inlet_millimolar - exact[far].min()
    return Compared(found, leaves, np.abs(off).max() / fall, np.sqrt((off**2).mean()) / fall)


def formulas(
    a: float, volume: float, r: FloatArray, z: FloatArray, given: OxygenConditions
) -> tuple[FloatArray, float]:
    """Krogh & Erlang's radial fall, the stream's own resistance, and the decline along it.

    The cylinder is as wide as its staircase of cells holds tissue.
    """
    uptake = given.cells_per_ml * given.mol_per_cell_s * 1e6
    outer = np.sqrt(volume / (np.pi * LENGTH) + a * a)
    per_length = uptake * np.pi * (outer**2 - a**2)
    stream = given.inlet_millimolar - per_length * z / FLOW
    wall = stream - per_length / (np.pi * given.medium_diffusivity_mm2_s * given.sherwood)
    r = np.maximum(r, a)
    fall = 2.0 * outer**2 * np.log(r / a) - r**2 + a**2
    exact = wall - uptake / (4.0 * given.tissue_diffusivity_mm2_s) * fall
    return exact, given.inlet_millimolar - per_length * LENGTH / FLOW
