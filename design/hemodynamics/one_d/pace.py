"""Choose the 1D solver's time steps per cycle by wave speed, friction and Windkessel time."""

from __future__ import annotations

from typing import Final

import numpy as np

from design.errors import FlowError
from design.hemodynamics.one_d.grid import Grid
from design.hemodynamics.one_d.nodes import RESISTANCE, Nodes
from design.hemodynamics.one_d.start import LumpedForecast
from kernels.arrays import FloatArray

STABLE: Final = 1.3
"""Cells a wave may run in a step at most; with κ = 1/3 and this Runge-Kutta method 1.5 still
holds for one wave in a uniform tube."""

_RUBBED: Final = 1.0
"""Share of its flow that friction may take in a step; 2.5 is the method's limit."""

_MOST_STEPS: Final = 50_000_000


def foreseen_rate(grid: Grid, seen: LumpedForecast) -> float:
    """Cells a second that the fastest wave will run, by what the lumped model expects."""
    vessel = grid.vessel_of_cell
    outside = grid.external[vessel]
    low = np.maximum(1.0 + (seen.low[vessel] - outside) / grid.stiffness, 0.1)
    velocity = seen.flow[vessel] / (grid.area * low**2)
    return wave_rate(grid, np.maximum(seen.high[vessel] - outside, 0.0), velocity)


def wave_rate(grid: Grid, pressure: FloatArray, velocity: FloatArray) -> float:
    """Cells a second that the fastest wave runs.

    Parameters
    ----------
    grid : Grid
    pressure, velocity : (n,) float64, Pa, mm/s
        Pressure above the one outside.
    """
    vessel = grid.vessel_of_cell
    alpha = grid.alpha[vessel]
    speed = np.sqrt((grid.stiffness + pressure) / (2.0 * grid.density))
    carried = np.sqrt(speed**2 + alpha * (alpha - 1.0) * velocity**2)
    fastest = alpha * np.abs(velocity) + carried
    return float((fastest / grid.cell[vessel]).max())


def steps_for(
    grid: Grid,
    nodes: Nodes,
    period_s: float,
    samples: int,
    courant: float,
    rate: float,
    area: FloatArray,
) -> int:
    """Steps of a cycle, a multiple of ``samples``.

    Limited by waves (``rate``, cells a second), by friction in thin vessels and by Windkessels
    whose time is short.

    Raises
    ------
    FlowError
        When they are absurdly many.
    """
    rubbing = grid.friction / area
    held = (nodes.kind == RESISTANCE) & (nodes.capacitance > 0.0)
    emptying = (1.0 / nodes.proximal[held] + 1.0 / nodes.distal[held]) / nodes.capacitance[held]
    wanted = {
        "waves": rate / courant,
        "friction": float(rubbing.max()) / _RUBBED,
        "a Windkessel's time": float(emptying.max(initial=0.0)),
    }
    cause = max(wanted, key=lambda name: wanted[name])
    steps = samples * int(np.ceil(max(1.0, period_s * wanted[cause] / samples)))
    if steps > _MOST_STEPS:
        where = ""
        if cause != "a Windkessel's time":
            cells = rubbing if cause == "friction" else 1.0 / grid.cell[grid.vessel_of_cell]
            where = f" in vessel {int(grid.vessel_of_cell[np.argmax(cells)])}"
        raise FlowError(
            f"a cycle of {period_s:g} s would take {steps:.3g} steps, above {_MOST_STEPS:.3g}, "
            f"because of {cause}{where}; give longer cells (cell_mm), or solve it lumped: waves "
            "don't matter where friction is so strong"
        )
    return steps
