"""Solve steady 0D flow by Newton's method for non-Newtonian fluids or inertial losses.

Newton's method on the vessels' laws Δp = f(Q): each step is a linear network in which a vessel has
the resistance f'(Q) and a source of pressure f(Q) - f'(Q) Q, solved as steady flow is. Every law
here rises with Q, so there is one solution (it is the least of a convex function, Millar's content)
and a step that is halved until it helps finds it. Mass is conserved in each step to rounding.

Fixed-point iteration on the resistance f(Q)/Q converges for shear-thinning fluids only linearly,
by a factor of 1 - n, and hardly where losses rule; two such steps begin, to leave the start.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

import numpy as np

from design.errors import FlowError
from design.hemodynamics.pressure_drops import Drop, Drops
from design.hemodynamics.zero_d.nodal.conductance import Structure
from kernels.arrays import FloatArray

SETTLED: Final = 1e-11
"""Largest pressure left over in a vessel, of the largest in the network."""

_STEPS: Final = 60
_HALVINGS: Final = 12
_FIRST: Final = 2
_START_RATE: Final = 100.0


def solve_drops(
    structure: Structure,
    drops: Drops,
    injected: FloatArray,
    given: FloatArray,
    ground: FloatArray | None,
) -> tuple[FloatArray, FloatArray, Drop]:
    """Pressures (s,), flows (v,) and what they take, for what is given at unknowns (s,).

    Raises
    ------
    FlowError
        When the iteration doesn't settle, with how far it came.
    """

    def linear(resistance: FloatArray, source: FloatArray) -> tuple[FloatArray, FloatArray]:
        return _step(structure, 1.0 / resistance, source, injected, given, ground)

    pressure, flow = _begin(drops, linear)
    for _ in range(_STEPS):
        drop = drops.at(flow)
        left = _left_over(structure, pressure, drop.whole(flow))
        if float(np.abs(left).max()) <= SETTLED * _scale(drop, flow, pressure):
            return pressure, flow, drop
        next_pressure, next_flow = linear(drop.slope, drop.whole(flow) - drop.slope * flow)
        share = _damped(structure, drops, (pressure, next_pressure), (flow, next_flow), drop, left)
        pressure = pressure + share * (next_pressure - pressure)
        flow = flow + share * (next_flow - flow)
    worst = int(np.abs(left).argmax())
    raise FlowError(
        f"the flow didn't settle in {_STEPS} steps: {abs(left[worst]):.3g} Pa of "
        f"{_scale(drop, flow, pressure):.3g} Pa are left over in vessel {worst} at "
        f"{flow[worst]:.3g} µL/s; check the fluid's numbers, the losses and the network's unit"
    )


def _begin(
    drops: Drops, linear: Callable[[FloatArray, FloatArray], tuple[FloatArray, FloatArray]]
) -> tuple[FloatArray, FloatArray]:
    none = np.zeros(len(drops.pipes.radius))
    pressure, flow = linear(drops.at(_START_RATE * np.pi / 4.0 * drops.pipes.radius**3).resistance,
                            none)  # fmt: skip
    for _ in range(_FIRST):
        drop = drops.at(flow)
        secant = drop.resistance + np.abs(drop.loss) / np.maximum(np.abs(flow), 1e-300)
        pressure, flow = linear(secant, none)
    return pressure, flow


def _step(
    structure: Structure,
    conductance: FloatArray,
    source: FloatArray,
    injected: FloatArray,
    given: FloatArray,
    ground: FloatArray | None,
) -> tuple[FloatArray, FloatArray]:
    """Q = g (p₀ - p₁ - e) with Σ Q as injected."""
    driven = conductance * source
    count = len(injected)
    entering = injected + np.bincount(structure.first, weights=driven, minlength=count)
    entering -= np.bincount(structure.last, weights=driven, minlength=count)
    system = structure.factorise(conductance, ground)
    pressure, flow = system.balanced(np.where(structure.fixed, 0.0, entering), given)
    flow -= driven
    # What the difference leaves over, relative to flows that may be smaller than its terms.
    excess, _ = system.excess(np.where(structure.fixed, 0.0, injected), pressure, flow)
    more_pressure, more_flow = system.solve(excess, np.zeros(count))
    return pressure + more_pressure, flow + more_flow


def _left_over(structure: Structure, pressure: FloatArray, whole: FloatArray) -> FloatArray:
    return pressure[structure.first] - pressure[structure.last] - whole


def _scale(drop: Drop, flow: FloatArray, pressure: FloatArray) -> float:
    return max(float(np.abs(drop.whole(flow)).max()), float(np.ptp(pressure)), 1e-300)


def _damped(
    structure: Structure,
    drops: Drops,
    pressures: tuple[FloatArray, FloatArray],
    flows: tuple[FloatArray, FloatArray],
    drop: Drop,
    left: FloatArray,
) -> float:
    """Part of the step after which less is left over, by its power."""
    before, share = float((left**2 / drop.slope).sum()), 1.0
    for _ in range(_HALVINGS):
        flow = flows[0] + share * (flows[1] - flows[0])
        pressure = pressures[0] + share * (pressures[1] - pressures[0])
        after = _left_over(structure, pressure, drops.at(flow).whole(flow))
        if float((after**2 / drop.slope).sum()) <= (1.0 - 0.1 * share) * before:
            break
        share *= 0.5
    return share
