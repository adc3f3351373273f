"""Muscle activation of a heart chamber over its cycle, from 0 (rest) to 1 (fully contracted).

As in svZeroDSolver's documentation: half a cosine; two half cosines (Regazzoni et al. 2022, doi
10.1016/j.jcp.2022.111083); two Hill functions (doi 10.1007/s10439-022-03047-3); a cosine that goes
on over the cycle's end (Sankaran et al. 2012, doi 10.1007/s10439-012-0579-3); a Fourier series.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from design.errors import FlowError
from design.hemodynamics.zero_d.svzerod.elastance import COSINES, SINES
from design.hemodynamics.zero_d.svzerod.keys import check_keys, number, text
from kernels.arrays import FloatArray

Activation = Callable[[float], float]
"""Activation at a time."""
_MOMENTS: Final = ("t_active", "t_shift", "contract_start", "relax_start")
_HILL_STEP: Final = 1e-5
_FOURIER_STEPS: Final = 10_000


def activation_of(data: Any, place: str, period: float | None) -> Activation:
    """Return what ``activation_function`` says.

    Parameters
    ----------
    period : float or None
        Of a cycle; None where the file gives none.

    Raises
    ------
    FlowError
        For a kind or key that isn't known, a missing or wrong number, no period.
    """
    place = f"{place}: activation_function"
    if not isinstance(data, Mapping):
        raise FlowError(f"{place} is missing; write an object with type and its numbers")
    kind = text(data, "type", place)
    if kind not in _KINDS:
        raise FlowError(f"{place}: type is {kind!r}; known: {', '.join(sorted(_KINDS))}")
    needed, make = _KINDS[kind]
    check_keys(data, place, frozenset(("type", *needed)))
    if period is None:
        raise FlowError(
            f"{place} needs a cycle's length; give simulation_parameters cardiac_period"
        )
    return make(period, *(_positive(data, key, place) for key in needed))


def _positive(data: Mapping[str, Any], key: str, place: str) -> float:
    """Return a number, above 0 unless it is a moment of the cycle."""
    value = number(data, key, place)
    if value <= 0.0 and key not in _MOMENTS:
        raise FlowError(f"{place}: {key} is {value:g}; write a number above 0")
    return value


@dataclass(frozen=True)
class _HalfCosine:
    """½ - ½ cos(2π t/twitch) from ``start`` on."""

    period: float
    start: float
    twitch: float

    def __call__(self, time: float) -> float:
        since = max(0.0, math.fmod(time, self.period) - self.start)
        if since > self.twitch:
            return 0.0
        return 0.5 - 0.5 * math.cos(2.0 * math.pi * since / self.twitch)


@dataclass(frozen=True)
class _PiecewiseCosine:
    """Half a cosine up from ``contract``, half a cosine down from ``relax``."""

    period: float
    contract: float
    relax: float
    rise: float
    fall: float

    def __call__(self, time: float) -> float:
        since = math.fmod(time - self.contract, self.period)
        if 0.0 <= since < self.rise:
            return 0.5 * (1.0 - math.cos(math.pi * since / self.rise))
        since = math.fmod(time - self.relax, self.period)
        if 0.0 <= since < self.fall:
            return 0.5 * (1.0 + math.cos(math.pi * since / self.fall))
        return 0.0


class _TwoHill:
    """g₁/(1 + g₁) · 1/(1 + g₂), g = (t/τ)^m, over its greatest value."""

    def __init__(self, period: float, shift: float, *shape: float) -> None:
        self.period, self.shift, self.shape = period, shift, shape
        self.greatest = 1.0
        with np.errstate(over="ignore"):
            self.greatest = float(self._hills(np.arange(0.0, period, _HILL_STEP)).max())
        if not self.greatest > 0.0:
            raise FlowError("activation_function two_hill is 0 over the whole cycle")

    def _hills(self, time: Any) -> Any:
        first, second, rise, fall = self.shape
        up, down = (time / first) ** rise, (time / second) ** fall
        return (up / (1.0 + up)) * (1.0 / (1.0 + down))

    def __call__(self, time: float) -> float:
        since = math.fmod(math.fmod(time, self.period) - self.shift, self.period)
        since = since if since >= 0.0 else since + self.period
        return float(self._hills(since)) / self.greatest


@dataclass(frozen=True)
class WrappingCosine:
    """A cosine of length ``systole`` that ends ``wave`` after the cycle's begin.

    Attributes
    ----------
    period : float
    share : float
        Of the period that the contraction takes.
    divisor : float
        The period over the time at which the contraction ends.
    """

    period: float
    share: float
    divisor: float

    def __call__(self, time: float) -> float:
        """Return the activation at a time."""
        systole, wave = self.period * self.share, self.period / self.divisor
        here, rest = math.fmod(time, self.period), self.period - systole
        if here <= wave:
            since = here - wave + systole
        elif rest + wave <= here < self.period:
            since = here - wave - rest
        else:
            return 0.0
        return 0.5 * (1.0 - math.cos(2.0 * math.pi * since / systole))


def fourier(time: FloatArray | float, period: float) -> Any:
    """Return the ventricles' elastance over its scale, by 25 harmonics."""
    angle = 2.0 * np.pi * np.multiply.outer(np.asarray(time), np.arange(len(COSINES))) / period
    return np.cos(angle) @ COSINES - np.sin(angle) @ SINES


class _Fourier:
    """`fourier`, from its least value to its greatest."""

    def __init__(self, period: float) -> None:
        self.period = period
        samples = fourier(np.linspace(0.0, period, _FOURIER_STEPS, endpoint=False), period)
        self.least, self.span = float(samples.min()), float(np.ptp(samples))

    def __call__(self, time: float) -> float:
        here = float(fourier(math.fmod(time, self.period), self.period))
        return (here - self.least) / self.span


_KINDS: Final[Mapping[str, tuple[tuple[str, ...], Callable[..., Activation]]]] = {
    "half_cosine": (("t_active", "t_twitch"), _HalfCosine),
    "piecewise_cosine": (
        ("contract_start", "relax_start", "contract_duration", "relax_duration"), _PiecewiseCosine
    ),
    "two_hill": (("t_shift", "tau_1", "tau_2", "m1", "m2"), _TwoHill),
    "wrapping_cosine": (("Tsa", "tpwave"), WrappingCosine),
    "fourier": ((), _Fourier),
}  # fmt: skip
