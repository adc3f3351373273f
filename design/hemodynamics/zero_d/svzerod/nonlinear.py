"""Terms of svZeroDSolver's equations that depend on flow or time: stenoses, coronaries."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import ClassVar, Protocol

import numpy as np

from design.network import FloatArray, IntArray


@dataclass(frozen=True)
class Moment:
    """What terms depend on, at the time that a step is balanced at.

    Attributes
    ----------
    time, period : float
    state, rates : (n,) float64
    sampled : (tables,) float64
    """

    time: float
    period: float
    state: FloatArray
    rates: FloatArray
    sampled: FloatArray


@dataclass(frozen=True)
class Added:
    """Contribution of a term to the equations, and its derivatives.

    Attributes
    ----------
    rows : (m,) int64
        Equations.
    value : (m,) float64
    entries : pair of (k,) int64
        Equations and variables of the derivatives.
    by_state, by_rate : (k,) float64
    shut : (j,) int64
        Flows that a closed valve sets to 0 once a step's correction is found.
    """

    rows: IntArray
    value: FloatArray
    entries: tuple[IntArray, IntArray]
    by_state: FloatArray
    by_rate: FloatArray
    shut: IntArray = field(default_factory=lambda: np.zeros(0, dtype=np.int64))


class Term(Protocol):
    """Term of the equations that isn't linear with fixed coefficients.

    Attributes
    ----------
    smooth : bool
        Whether it has no jumps.
    """

    smooth: ClassVar[bool]

    def at(self, moment: Moment) -> Added:
        """Return value and derivatives."""
        ...


class _OfOne(Protocol):
    """Term with one variable in each of its equations."""

    @property
    def rows(self) -> IntArray: ...

    @property
    def columns(self) -> IntArray: ...


def _single(term: _OfOne, value: FloatArray, by_state: FloatArray, by_rate: FloatArray) -> Added:
    return Added(term.rows, value, (term.rows, term.columns), by_state, by_rate)


@dataclass(frozen=True)
class Loss:
    """-K |Q| Q: the pressure that a stenosis takes."""

    smooth: ClassVar[bool] = True
    rows: IntArray
    columns: IntArray
    factor: FloatArray

    def at(self, moment: Moment) -> Added:
        """Return value and derivatives."""
        flow = moment.state[self.columns]
        slope = -self.factor * np.abs(flow)
        return _single(self, slope * flow, 2.0 * slope, np.zeros_like(flow))


@dataclass(frozen=True)
class StoredLoss:
    """2 C K |Q| Q̇: what a stenosis takes from the pressure at the compliance behind it."""

    smooth: ClassVar[bool] = True
    rows: IntArray
    columns: IntArray
    factor: FloatArray

    def at(self, moment: Moment) -> Added:
        """Return value and derivatives."""
        flow, rate = moment.state[self.columns], moment.rates[self.columns]
        slope = 2.0 * self.factor * np.abs(flow)
        return _single(self, slope * rate, 2.0 * self.factor * np.sign(flow) * rate, slope)


@dataclass(frozen=True)
class Contraction:
    """-R(t) (V + C Rv V̇ + C (Pim - P)): a coronary's resistance in the contracting muscle.

    √R goes from √least to √most along half a cosine in the time of contraction, and back in the
    time of relaxation.

    Attributes
    ----------
    rows, columns, tables : (m,) int64
        ``columns`` are the volumes, ``tables`` the intramyocardial pressures.
    values : (m, 7) float64
        C, Rv, P, least and most R, time of contraction and of relaxation.
    """

    smooth: ClassVar[bool] = True
    rows: IntArray
    columns: IntArray
    tables: IntArray
    values: FloatArray

    def at(self, moment: Moment) -> Added:
        """Return value and derivatives."""
        muscle, vein, behind = self.values.T[:3]
        resistance = self._resistance(float(np.fmod(moment.time, moment.period)))
        volume, rate = moment.state[self.columns], moment.rates[self.columns]
        across = moment.sampled[self.tables] - behind
        held = volume + muscle * (vein * rate + across)
        return _single(self, -resistance * held, -resistance, -resistance * muscle * vein)

    def _resistance(self, time: float) -> FloatArray:
        least, most, rise, fall = self.values.T[3:]
        with np.errstate(divide="ignore", invalid="ignore"):
            up = 0.5 * (1.0 - np.cos(np.pi * time / rise))
            down = 0.5 * (1.0 + np.cos(np.pi * (time - rise) / fall))
        share = np.where(time <= rise, up, np.where(time <= rise + fall, down, 0.0))
        root = np.sqrt(least) + (np.sqrt(most) - np.sqrt(least)) * share
        return np.asarray(root**2)
