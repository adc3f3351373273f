"""Build and time-step small 1D flow networks without the periodic solver."""

from collections.abc import Callable

import numpy as np

from design.hemodynamics import OneDOptions, PulsatileConditions
from design.hemodynamics.one_d.grid import Grid, Nodes
from design.hemodynamics.one_d.kernels import State, make_work
from design.hemodynamics.one_d.march import advance
from design.hemodynamics.one_d.solve import OneDProblem, set_up_problem
from design.network import VesselNetwork
from kernels.arrays import FloatArray

Drive = Callable[[FloatArray], FloatArray]


def posed(
    network: VesselNetwork, conditions: PulsatileConditions, options: OneDOptions
) -> OneDProblem:
    """At rest, whatever the lumped model would begin with, and nothing limited that is small."""
    problem = set_up_problem(network, conditions, options)
    grid = problem.grid
    problem.state.area[:] = grid.area
    problem.state.flow[:] = 0.0
    problem.state.stored[:] = problem.nodes.back
    return problem


def with_scale(grid: Grid, pressure: float, flow: float) -> Grid:
    """The grid for pulses of this size."""
    return grid._replace(
        small_pressure=np.full(len(grid.cell), (0.3 * pressure) ** 2),
        small_flow=np.full(len(grid.cell), (0.3 * flow) ** 2),
    )


def march(
    grid: Grid, nodes: Nodes, state: State, until: float, steps: int, drive: Drive | None = None
) -> None:
    """Step to ``until``; ``drive`` gives the first wave, the others rest at 0."""
    times = np.linspace(0.0, until, 2 * steps + 1)
    waves = np.zeros((len(times), int(nodes.wave.max()) + 1))
    if drive is not None:
        waves[:, 0] = drive(times)
    assert advance(grid, nodes, state, waves, until / steps, make_work(grid, nodes)) == -1


def pressures(grid: Grid, state: State) -> FloatArray:
    return np.asarray(grid.stiffness * (np.sqrt(state.area / grid.area) - 1.0))
