"""Data classes of the generalised-α method: solution state, and time step with its weights."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from kernels.arrays import FloatArray


@dataclass(frozen=True)
class State:
    """Values and rates of all variables, (n,) each."""

    value: FloatArray
    rate: FloatArray


@dataclass(frozen=True)
class Pace:
    """Step, its weights (`march`), and when Newton's method ends.

    Attributes
    ----------
    step : float
    rho : float
        Spectral radius at infinite steps.
    tolerance : float
    iterations : int
    """

    step: float
    rho: float
    tolerance: float
    iterations: int

    @property
    def alpha_m(self) -> float:
        """Weight of the new rates where the equations hold."""
        return 0.5 * (3.0 - self.rho) / (1.0 + self.rho)

    @property
    def alpha_f(self) -> float:
        """Weight of the new values there."""
        return 1.0 / (1.0 + self.rho)

    @property
    def gamma(self) -> float:
        """Part of a rate's change over the step that a value takes."""
        return 0.5 + self.alpha_m - self.alpha_f

    def weighted(self, by_rate: Any, by_state: Any) -> Any:
        """Return the derivative by the rates' change, of derivatives by rates and values."""
        return self.alpha_m * by_rate + (self.alpha_f * self.gamma * self.step) * by_state

    def changed(self, old: State, change: FloatArray) -> State:
        """Return the state for a change of the predicted rates."""
        rate = old.rate * (1.0 - 1.0 / self.gamma)
        rate += change
        return State(old.value + change * (self.gamma * self.step), rate)
