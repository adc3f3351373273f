"""Choose svZeroDSolver's time stepper (linear, reduced, sparse) and run it; generalised-α method.

Jansen, Whiting & Hulbert 2000, doi 10.1016/S0045-7825(00)00203-6, with ρ the spectral radius at
infinite steps: α_m = (3 - ρ)/(2 (1 + ρ)), α_f = 1/(1 + ρ), γ = ½ + α_m - α_f. Every variable is
stepped so, those without a rate in the equations, too: at t + α_f Δt the equations hold exactly.

Where equations are nonlinear, Newton's method ends at the first residual below the tolerance, as in
svZeroDSolver: what a file's units let slip below it is left as it is there, too.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, Final

import numpy as np

from design.hemodynamics.zero_d.svzerod.generalised_alpha import Pace, State
from design.hemodynamics.zero_d.svzerod.march_linear import LinearMarch
from design.hemodynamics.zero_d.svzerod.march_reduced import ReducedMarch
from design.hemodynamics.zero_d.svzerod.march_sparse import SparseMarch
from design.hemodynamics.zero_d.svzerod.stamps import LumpedSystem
from design.hemodynamics.zero_d.svzerod.tables import Sampler
from design.hemodynamics.zero_d.svzerod.terms import Moments
from kernels.arrays import FloatArray

_FULL: Final = 200
"""Unknowns up to which a nonlinear system is reduced to its nonlinear part."""
_WIDE: Final = 600
"""Unknowns up to which it is where few equations are nonlinear."""
_FEW: Final = 60
"""Of them."""
_BLOCK: Final = 256
"""Steps whose tables are sampled at once, at most."""
_NUMBERS: Final = 1_000_000
"""Samples and variables of a block."""


class Stepper:
    """System with a fixed step.

    Parameters
    ----------
    sampler : Sampler or FloatArray
        Tables, or their values where they don't change, (tables,).
    period : float
        Of a cycle.

    Raises
    ------
    FlowError
        For a system that is singular in its linear part.
    """

    def __init__(
        self, system: LumpedSystem, sampler: Sampler | FloatArray, period: float, pace: Pace
    ) -> None:
        self._sampler, self._period, self._pace = sampler, period, pace
        size = len(system.constant)
        self._block = max(1, min(_BLOCK, _NUMBERS // (size + system.drive.shape[1])))
        few = sum(g.rows.size for g in system.terms) <= _FEW
        way: Any = ReducedMarch if size <= (_WIDE if few else _FULL) else SparseMarch
        self._way: LinearMarch | ReducedMarch | SparseMarch = (
            way(system, pace) if system.terms else LinearMarch(system, pace)
        )

    def march(self, state: State, first: int, count: int) -> Iterator[State]:
        """Yield the states behind each of ``count`` steps from the step number ``first`` on.

        A later step may write into a state.

        Raises
        ------
        FlowError
            For a singular system, or when Newton's method doesn't settle.
        """
        for begin in range(first, first + count, self._block):
            numbers = np.arange(begin, min(begin + self._block, first + count))
            times = self._pace.step * numbers + self._pace.alpha_f * self._pace.step
            for new in self._way.march(state, self._moments(times)):
                yield new
            state = new

    def _moments(self, times: FloatArray) -> Moments:
        if isinstance(self._sampler, Sampler):
            return Moments(times, self._period, self._sampler.at(times))
        shape = (len(times), len(self._sampler))
        return Moments(times, self._period, np.broadcast_to(self._sampler, shape))
