"""Nonlinear or time-dependent equation terms of svZeroDSolver blocks, by the blocks' own state."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np

from design.hemodynamics.zero_d.svzerod.nonlinear import Added, Moment
from design.hemodynamics.zero_d.svzerod.stamps import Group
from design.network import FloatArray, IntArray

Places = Mapping[tuple[int, int], FloatArray]


@dataclass(frozen=True)
class Local:
    """State of blocks of one kind.

    Attributes
    ----------
    time, period : float
    y, rate : (k, m) float64
        Of each of a block's variables, in `Group`'s order.
    activation : (m,) float64
        Of chambers; empty for other kinds.
    """

    time: float
    period: float
    y: FloatArray
    rate: FloatArray
    activation: FloatArray


@dataclass(frozen=True)
class Response:
    """What a law adds, each (m,).

    Attributes
    ----------
    values : mapping of int
        By equation.
    by_state, by_rate : mapping of (int, int)
        Derivatives, by equation and variable.
    """

    values: Mapping[int, FloatArray]
    by_state: Places
    by_rate: Places = field(default_factory=dict)


class Law:
    """Term of the equations that follows from the blocks' own variables.

    Parameters
    ----------
    response : function
        Its answer has the same equations and derivatives every time.
    """

    smooth: ClassVar[bool] = False

    def __init__(self, group: Group, response: Callable[[Local], Response]) -> None:
        self.group, self.response = group, response
        self._none = np.zeros(len(group.values))
        self._keys: list[tuple[int, int]] = []
        self._rows = self._row = self._column = np.zeros(0, dtype=np.int64)

    def at(self, moment: Moment) -> Added:
        """Return value and derivatives."""
        own = self.group.variables.T
        active = np.array([a(moment.time) for a in self.group.activations])
        found = self.response(
            Local(moment.time, moment.period, moment.state[own], moment.rates[own], active)
        )
        if not self._keys:
            self._place(found)
        return Added(
            rows=self._rows,
            value=np.concatenate(list(found.values.values())),
            entries=(self._row, self._column),
            by_state=np.concatenate([found.by_state.get(k, self._none) for k in self._keys]),
            by_rate=np.concatenate([found.by_rate.get(k, self._none) for k in self._keys]),
        )

    def _place(self, found: Response) -> None:
        equations, own = self.group.equations.T, self.group.variables.T
        self._keys = list(dict.fromkeys((*found.by_state, *found.by_rate)))
        self._rows = equations[list(found.values)].ravel()
        self._row = equations[[row for row, _ in self._keys]].ravel()
        self._column = own[[variable for _, variable in self._keys]].ravel()


@dataclass(frozen=True)
class Coupled:
    """A variable of another block, times a factor, in an equation: -factor P.

    The derivative is left out, as in svZeroDSolver: iterations go the same way.
    """

    smooth: ClassVar[bool] = False
    rows: IntArray
    factor: FloatArray
    variable: int

    def at(self, moment: Moment) -> Added:
        """Return the value."""
        none = np.zeros(0, dtype=np.int64)
        value = -self.factor * moment.state[self.variable]
        return Added(self.rows, value, (none, none), np.zeros(0), np.zeros(0))
