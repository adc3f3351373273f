"""Flow waveforms by name (aorta, coronary artery, roller pump), scaled to a given mean."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

import numpy as np

from design.errors import FlowInputError
from design.hemodynamics.waveforms.waveform import Tabulated, check_period
from kernels.arrays import FloatArray

_SAMPLES: Final = 200
_SYSTOLE: Final = 0.4
_KASSAB_COS: Final = np.array([-0.005, -0.040, -0.034])
_KASSAB_SIN: Final = np.array([0.212, 0.086, 0.032])


def _ejection(phase: FloatArray) -> FloatArray:
    """Half a sine in systole, nothing in diastole: flow into the aorta in Windkessel models.

    I(t) = I₀ sin(π t/T_s) for t < T_s = 2/5 T (Catanho, Sinha & Vijayan 2012, Model of aortic
    blood flow using the Windkessel effect).
    """
    return np.where(phase < _SYSTOLE, np.sin(np.pi * phase / _SYSTOLE), 0.0)


def _roller(phase: FloatArray) -> FloatArray:
    """A peristaltic pump, idealised: a rectified sine, one lobe a roller."""
    return np.abs(np.sin(np.pi * phase))


def _kassab(phase: FloatArray) -> FloatArray:
    """A coronary artery: three harmonics of the left anterior descending one's flow.

    Within 3 % of the mean of the wave in its main trunk (Huo & Kassab 2006, Am J Physiol Heart
    Circ Physiol 291, H1074, doi 10.1152/ajpheart.00200.2006; a cycle there lasts 0.7 s).
    Sexton et al. 2025 cite Kassab for the waves that drive their trees.
    """
    angle = 2.0 * np.pi * np.outer(np.arange(1, 4), phase)
    return 1.0 + _KASSAB_COS @ np.cos(angle) + _KASSAB_SIN @ np.sin(angle)


SHAPES: Final[dict[str, Callable[[FloatArray], FloatArray]]] = {
    "ejection": _ejection,
    "kassab": _kassab,
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
