"""Steps of a cycle that Windkessels need in 3D, and the error that so many steps leave."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

import numpy as np

from design.hemodynamics.conditions import PulsatileConditions, WindkesselOutlet
from design.hemodynamics.waveforms import cycle_times
from kernels.arrays import ComplexArray, FloatArray

LEAST_STEPS: Final = 24
MOST_STEPS: Final = 10_000
MAX_ERROR: Final = 0.01
"""Of a Windkessel's pressure swing; the work is proportional to the steps, this to their inverse
square."""
_SAMPLES: Final = 2048
"""Of the given waveform in a cycle."""


def pulse_error(conditions: PulsatileConditions, steps: int) -> float:
    """Return the relative error in time of the swing of pressure at a Windkessel; 0 without one.

    Of several the largest, negative where the swing comes out too small. Second-order backward
    differences put ``λ = (3/2 - 2 z + z²/2) / Δt``, ``z = exp(-iωΔt)``, in the place of iω, which
    is ``iω (1 + (ωΔt)²/3 + …)``; so each harmonic of the flow meets ``R_p + R_d / (1 + λ R_d C)``
    (Hairer, Nørsett & Wanner 1993, III.1). The given waveform, whether flow or pressure, stands for
    the flow at the outlets. The error of the flow in space isn't in it.

    Parameters
    ----------
    conditions : PulsatileConditions
    steps : int
        Of a cycle.
    """
    period_s = conditions.inlet.period_s
    if period_s is None:
        return 0.0
    drive = np.fft.rfft(conditions.inlet.at(cycle_times(period_s, _SAMPLES)))
    drive[0], drive[steps // 2 + 1 :] = 0.0, 0.0  # what so many steps resolve of it
    rate: ComplexArray = np.arange(len(drive)).astype(np.complex128) * (2j * np.pi / period_s)
    turn: ComplexArray = np.exp(-rate * period_s / steps)
    stepped = (turn * (0.5 * turn - 2.0) + 1.5) * (steps / period_s)
    given = conditions.outlet
    outlets = given.values() if isinstance(given, Mapping) else [given]
    errors = [0.0]
    for outlet in outlets:
        if isinstance(outlet, WindkesselOutlet) and drive.any():
            errors.append(_swing(outlet, stepped, drive) / _swing(outlet, rate, drive) - 1.0)
    return max(errors, key=abs)


def _swing(outlet: WindkesselOutlet, rate: ComplexArray, drive: ComplexArray) -> float:
    """Swing of pressure over a cycle, Pa, at harmonics of the flow; ``rate`` is theirs of d/dt."""
    impedance = outlet.proximal + outlet.distal / (1.0 + rate * outlet.distal * outlet.compliance)
    pressure: FloatArray = np.fft.irfft(impedance * drive, _SAMPLES)
    return float(np.ptp(pressure))


def needed_steps(conditions: PulsatileConditions) -> int:
    """Return how many steps of a cycle keep `pulse_error` within `MAX_ERROR`; 24 at least.

    Of a sine and without a proximal resistance ``2 π sqrt(x² / (1 + x²) / (3 MAX_ERROR))`` with
    ``x = ω R_d C``: 37 where the compliance takes all.
    """
    steps = LEAST_STEPS
    while (error := abs(pulse_error(conditions, steps))) > MAX_ERROR and steps < MOST_STEPS:
        steps = min(max(steps + 1, int(steps * np.sqrt(error / MAX_ERROR))), MOST_STEPS)
    return steps
