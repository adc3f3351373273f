"""Flow waveforms by name (aortic ejection, roller pump), scaled to a given mean."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

import numpy as np

from design.errors import FlowInputError
from design.hemodynamics.waveforms.waveform import Tabulated, check_period
from design.network import FloatArray

_SAMPLES: Final = 200
_SYSTOLE: Final = 0.4


def _ejection(phase: FloatArray) -> FloatArray:
    """Half a sine in systole, nothing in diastole: flow into the aorta in Windkessel models.

    I(t) = I₀ sin(π t/T_s) for t < T_s = 2/5 T (Catanho, Sinha & Vijayan 2012, Model of aortic
    blood flow using the Windkessel effect).
    """
    return np.where(phase < _SYSTOLE, np.sin(np.pi * phase / _SYSTOLE), 0.0)


def _roller(phase: FloatArray) -> FloatArray:
    """A peristaltic pump, idealised: a rectified sine, one lobe a roller."""
    return np.abs(np.sin(np.pi * phase))


SHAPES: Final[dict[str, Callable[[FloatArray], FloatArray]]] = {
    "ejection": _ejection,
    "roller_pump": _roller,
}
"""Name to shape, a function of the phase in 0 to 1."""


def shape(name: str, mean: float, period_s: float) -> Tabulated:
    """The shape of that name, scaled to a mean.

    Raises
    ------
    FlowInputError
        For an unknown name, or an impossible period.
    """
    if name not in SHAPES:
        raise FlowInputError(f"there is no waveform {name!r}; choose one of {', '.join(SHAPES)}")
    phase = np.arange(_SAMPLES) / _SAMPLES
    value = SHAPES[name](phase)
    return Tabulated(phase * check_period(period_s), mean * value / value.mean(), period_s)
