"""Reduce a small nonlinear svZeroDSolver system, then yield its state after each time step."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from design.errors import FlowError
from design.hemodynamics.zero_d.svzerod.factors import Factors
from design.hemodynamics.zero_d.svzerod.generalised_alpha import Pace, State
from design.hemodynamics.zero_d.svzerod.march_sparse import unsettled
from design.hemodynamics.zero_d.svzerod.newton_steps import (
    DONE,
    SINGULAR,
    march_reduced,
)
from design.hemodynamics.zero_d.svzerod.reduction import reduced_system
from design.hemodynamics.zero_d.svzerod.stamps import LumpedSystem
from design.hemodynamics.zero_d.svzerod.terms import Moments, joined_terms, timed_coefficients


class ReducedMarch:
    """Small nonlinear system with a fixed step.

    Raises
    ------
    FlowError
        As `reduced_system`.
    """

    def __init__(self, system: LumpedSystem, pace: Pace) -> None:
        self._system, self._pace = system, pace
        self._terms = joined_terms(system.terms)
        self._reduced = reduced_system(system.e, system.f, self._terms, pace)

    def march(self, state: State, moments: Moments) -> Iterator[State]:
        """Yield the state behind each step.

        Raises
        ------
        FlowError
            For a singular system, or when Newton's method doesn't settle.
        """
        constants = self._system.constant + (self._system.drive @ moments.sampled.T).T
        timed = timed_coefficients(self._system.terms, moments)
        values, rates = np.empty((2, *constants.shape))
        status, at, left = march_reduced(
            self._reduced, self._terms, np.ascontiguousarray(constants), timed, state.value,
            state.rate, values, rates,
        )  # fmt: skip
        if status == SINGULAR:
            raise FlowError(Factors.SINGULAR)
        if status != DONE:
            raise unsettled(self._pace, float(moments.times[at]), left)
        for value, rate in zip(values, rates, strict=True):
            yield State(value, rate)
