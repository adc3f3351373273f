"""Step linear lumped equations of svZeroDSolver, with one factorisation for all steps."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.sparse import csc_array

from design.hemodynamics.zero_d.svzerod.factors import LARGE, Factors, by_rank, step_linear
from design.hemodynamics.zero_d.svzerod.generalised_alpha import Pace, State
from design.hemodynamics.zero_d.svzerod.stamps import LumpedSystem
from design.hemodynamics.zero_d.svzerod.terms import Moments
from kernels.arrays import FloatArray, IntArray


@dataclass(frozen=True)
class _Passes:
    """What `step_linear` goes over, rows at their ``place`` in L."""

    place: IntArray
    constant: FloatArray
    entries: tuple[Any, ...]
    triangles: tuple[Any, ...]


class LinearMarch:
    """Linear system with a fixed step.

    Raises
    ------
    FlowError
        For a singular system.
    """

    def __init__(self, system: LumpedSystem, pace: Pace) -> None:
        self._system, self._pace = system, pace
        self._factors = Factors(csc_array(pace.weighted(system.e, system.f)))
        self._predicted = system.e * (1.0 - pace.alpha_m / pace.gamma)
        self._large = len(system.constant) >= LARGE
        if self._large:
            # Memory of this size comes from the system, page by page, each time it is asked for.
            count = len(system.constant)
            self._next, self._spare = (State(*np.empty((2, count))) for _ in range(2))
            self._work = np.empty(count)
            self._driven = np.flatnonzero(np.diff(system.drive.indptr))
            self._drive = system.drive[self._driven]
            self._passes = self._prepared()

    def march(self, state: State, moments: Moments) -> Iterator[State]:
        """Yield the state behind each step; the next but one is written into it."""
        step = self._in_one_pass if self._large else self._plain
        for sampled in moments.sampled:
            state = step(state, sampled)
            yield state

    def _plain(self, old: State, sampled: FloatArray) -> State:
        change = self._predicted @ old.rate
        change += self._system.f @ old.value
        change += self._system.constant + self._system.drive @ sampled
        if float(np.abs(change).max()) < self._pace.tolerance:
            return self._pace.changed(old, np.zeros_like(change))
        return self._pace.changed(old, -self._factors.solve(change))

    def _in_one_pass(self, old: State, sampled: FloatArray) -> State:
        """A step of a large system."""
        new, passes, driven, pace = self._next, self._passes, self._driven, self._pace
        constant = self._system.constant[driven] + self._drive @ sampled
        passes.constant[passes.place[driven]] = constant
        arguments: tuple[Any, ...] = (
            old.value, old.rate, passes.constant, *passes.entries, pace.tolerance,
            1.0 - 1.0 / pace.gamma, pace.gamma * pace.step, *passes.triangles,
            new.value, new.rate, self._work,
        )  # fmt: skip
        step_linear(*arguments)
        self._next, self._spare = self._spare, new
        return new

    def _prepared(self) -> _Passes:
        triangles = self._factors.triangles()
        place = triangles[-2]
        constant = np.empty_like(self._system.constant)
        constant[place] = self._system.constant
        entries = (*by_rank(self._predicted, place), *by_rank(self._system.f, place))
        return _Passes(place, constant, entries, triangles)
