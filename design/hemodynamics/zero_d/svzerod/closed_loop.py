"""Equations of svZeroDSolver's closed loops: heart and lungs, Windkessels and coronaries.

After Sankaran et al. 2012 (doi 10.1007/s10439-012-0579-3) and Menon et al. 2023, as svZeroDSolver
solves it: atria as `terms.EXPONENTIAL`, ventricles P = E(t) (V - V_u), each chamber's outflow
through a resistance and an inertance, the lungs C_p dP/dt = Q_RV - (P - P_LA)/R_pd, the aorta's
capacitance at the outlet. A valve is closed where neither flow nor pressure drives it forward; its
flow counts for nothing then, and is 0 after the step.
"""

from __future__ import annotations

from functools import partial
from typing import Final

import numpy as np

from design.hemodynamics.zero_d.svzerod.activation import WrappingCosine, fourier
from design.hemodynamics.zero_d.svzerod.chambers import activation_at
from design.hemodynamics.zero_d.svzerod.stamps import Group, Stamps
from design.hemodynamics.zero_d.svzerod.terms import AFFINE, EXPONENTIAL, GATE, Moments
from kernels.arrays import FloatArray

HEART: Final = "CLH"
"""Name of the heart in results and initial conditions."""
PARAMETERS: Final = (
    "Tsa", "tpwave", "Erv_s", "Elv_s", "Lra_v", "Rra_v", "Lrv_a", "Rrv_a", "Lla_v", "Rla_v",
    "Llv_a", "Rlv_ao", "Vrv_u", "Vlv_u", "Rpd", "Cp", "Cpa", "Kxp_ra", "Kxv_ra", "Kxp_la",
    "Kxv_la", "Emax_ra", "Emax_la", "Vaso_ra", "Vaso_la", "iml", "imr",
)  # fmt: skip
OWN: Final = (
    "V_RA", "Q_RA", "P_RV", "V_RV", "Q_RV", "P_pul", "P_LA", "V_LA", "Q_LA", "P_LV", "V_LV",
    "Q_LV",
)  # fmt: skip
# Variables of the heart: pressure at its inlet is the right atrium's, at its outlet the aorta's.
(_P_RA, _Q_IN, _P_AO, _Q_OUT, _V_RA, _Q_RA, _P_RV, _V_RV, _Q_RV, _P_PUL, _P_LA, _V_LA, _Q_LA, _P_LV,
 _V_LV, _Q_LV) = range(16)  # fmt: skip
_VALVES: Final = (
    (_Q_RA, _P_RA, _P_RV, "Rra_v", 3), (_Q_RV, _P_RV, _P_PUL, "Rrv_a", 6),
    (_Q_LA, _P_LA, _P_LV, "Rla_v", 10), (_Q_LV, _P_LV, _P_AO, "Rlv_ao", 13),
)  # fmt: skip
"""Flow, pressure before and behind, resistance and momentum equation of each valve."""
_FED: Final = {_Q_RA: (2, 5), _Q_RV: (5, 7, 9), _Q_LA: (9, 12), _Q_LV: (12, 1)}
"""Balances that each valve's flow leaves (the first) and enters; the lungs hold no volume."""


def heart(group: Group, to: Stamps) -> None:
    """Add the equations of ClosedLoopHeartAndPulmonary."""
    values = dict(zip(PARAMETERS, group.values.T, strict=True))
    for row, pressure in ((0, _P_RA), (4, _P_RV), (8, _P_LA), (11, _P_LV)):
        to.f(row, {pressure: 1.0})
    for row, volume in ((2, _V_RA), (5, _V_RV), (9, _V_LA), (12, _V_LV)):
        to.e(row, {volume: 1.0})
    to.f(2, {_Q_IN: -1.0})
    to.e(1, {_P_AO: values["Cpa"]})
    to.f(1, {_Q_OUT: 1.0})
    to.e(7, {_P_PUL: values["Cp"]})
    to.f(7, {_P_PUL: 1.0 / values["Rpd"], _P_LA: -1.0 / values["Rpd"]})
    for (flow, before, behind, _, row), key in zip(
        _VALVES, ("Lra_v", "Lrv_a", "Lla_v", "Llv_a"), strict=True
    ):
        to.e(row, {flow: values[key]})
        to.f(row, {before: -1.0, behind: 1.0})
    for side, volume, row in (("ra", _V_RA, 0), ("la", _V_LA, 8)):
        constants = [values[f"{key}_{side}"] for key in ("Emax", "Kxp", "Kxv", "Vaso")]
        beat = partial(_atria, values["Tsa"].item(), values["tpwave"].item())
        to.add(EXPONENTIAL, (row,), (volume,), ((0, 0),), constants, beat)
    for side, volume, row in (("rv", _V_RV, 4), ("lv", _V_LV, 11)):
        timed = partial(_ventricle, values[f"E{side}_s"], values[f"V{side}_u"])
        to.add(AFFINE, (row,), (volume,), ((0, 0),), timed=timed)
    for flow, before, behind, key, row in _VALVES:
        rows = (row, *_FED[flow])
        slopes = [(k, 0) for k in range(len(rows))]
        to.add(GATE, rows, (flow, before, behind), slopes, (values[key],))


def _atria(share: float, divisor: float, at: Moments) -> tuple[FloatArray]:
    beat = WrappingCosine(at.period, share, divisor)
    return (activation_at((beat,), at),)


def _ventricle(scale: FloatArray, rest: FloatArray, at: Moments) -> tuple[FloatArray, ...]:
    elastance = fourier(np.fmod(at.times, at.period), at.period)[:, None] * scale
    return -elastance, np.zeros_like(elastance), rest


def closed_windkessel(group: Group, to: Stamps) -> None:
    """Add the equations of ClosedLoopRCR."""
    proximal, compliance, resistance = group.values.T[:3]
    to.f(0, {1: -1.0, 3: 1.0})
    to.e(0, {4: 0.0 if to.steady else compliance})
    to.f(1, {0: 1.0, 1: -proximal, 4: -1.0})
    to.f(2, {2: -1.0, 3: -resistance, 4: 1.0})


def closed_coronary(ventricle: str, group: Group, to: Stamps) -> None:
    """Add the equations of ClosedLoopCoronaryLeft or Right, whose muscle is a ventricle's."""
    first, middle, vein, arterial, muscle, share = group.values.T
    to.e(0, {0: -middle * arterial, 1: middle * first * arterial})
    to.f(0, {0: -1.0, 1: first + middle, 2: 1.0, 3: vein})
    to.e(1, {0: -arterial, 1: arterial * first, 4: -1.0})
    to.f(1, {1: 1.0, 3: -1.0})
    to.f(2, {2: muscle, 3: muscle * vein, 4: -1.0})
    to.add_coupled(2, f"{ventricle}:{HEART}", muscle * share)
