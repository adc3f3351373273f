"""Terms of the lumped equations whose coefficients depend on flow or time."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

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
    """Contribution of a term to its rows, and its derivatives, all (m,)."""

    value: FloatArray
    by_state: FloatArray
    by_rate: FloatArray


class Term(Protocol):
    """Term in some rows, of one variable each."""

    @property
    def rows(self) -> IntArray:
        """Equations, (m,)."""
        ...

    @property
    def columns(self) -> IntArray:
        """Variables, (m,)."""
        ...

    def at(self, moment: Moment) -> Added:
        """Return value and derivatives."""
        ...


@dataclass(frozen=True)
class Loss:
    """-K |Q| Q: the pressure that a stenosis takes."""

    rows: IntArray
    columns: IntArray
    factor: FloatArray

    def at(self, moment: Moment) -> Added:
        """Return value and derivatives."""
        flow = moment.state[self.columns]
        slope = -self.factor * np.abs(flow)
        return Added(slope * flow, 2.0 * slope, np.zeros_like(flow))


@dataclass(frozen=True)
class StoredLoss:
    """2 C K |Q| Q̇: what a stenosis takes from the pressure at the compliance behind it."""

    rows: IntArray
    columns: IntArray
    factor: FloatArray

    def at(self, moment: Moment) -> Added:
        """Return value and derivatives."""
        flow, rate = moment.state[self.columns], moment.rates[self.columns]
        slope = 2.0 * self.factor * np.abs(flow)
        return Added(slope * rate, 2.0 * self.factor * np.sign(flow) * rate, slope)


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
        return Added(-resistance * held, -resistance, -resistance * muscle * vein)

    def _resistance(self, time: float) -> FloatArray:
        least, most, rise, fall = self.values.T[3:]
        with np.errstate(divide="ignore", invalid="ignore"):
            up = 0.5 * (1.0 - np.cos(np.pi * time / rise))
            down = 0.5 * (1.0 + np.cos(np.pi * (time - rise) / fall))
        share = np.where(time <= rise, up, np.where(time <= rise + fall, down, 0.0))
        root = np.sqrt(least) + (np.sqrt(most) - np.sqrt(least)) * share
        return np.asarray(root**2)
