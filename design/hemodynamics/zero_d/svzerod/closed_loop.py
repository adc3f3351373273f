"""Equations of svZeroDSolver's closed loops: heart and lungs, Windkessels and coronaries.

After Sankaran et al. 2012 (doi 10.1007/s10439-012-0579-3) and Menon et al. 2023, as svZeroDSolver
solves it: atria as in `chambers.atrium`, ventricles P = E(t) (V - V_u), each chamber's outflow
through a resistance and an inertance, the lungs C_p dP/dt = Q_RV - (P - P_LA)/R_pd, the aorta's
capacitance at the outlet. A valve is closed where neither flow nor pressure drives it forward; its
flow counts for nothing then, and is 0 after the step.
"""

from __future__ import annotations

import math
from typing import ClassVar, Final

import numpy as np

from design.hemodynamics.zero_d.svzerod.activation import WrappingCosine, fourier
from design.hemodynamics.zero_d.svzerod.chambers import atrium
from design.hemodynamics.zero_d.svzerod.laws import Coupled
from design.hemodynamics.zero_d.svzerod.nonlinear import Added, Moment
from design.hemodynamics.zero_d.svzerod.stamps import Group, Stamps

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
    to.add(Heart(group))


class Heart:
    """Chambers and valves of the heart, in plain numbers: there is one, and it is asked often.

    Each of its summands depends on one variable: an atrium's and a ventricle's pressure on the
    volume, a valve's pressure drop and what it takes from one balance to another on the flow.
    """

    smooth: ClassVar[bool] = False

    def __init__(self, group: Group) -> None:
        self.values = dict(zip(PARAMETERS, group.values[0].tolist(), strict=True))
        self.own = group.variables[0]
        pressures = ((0, _V_RA), (8, _V_LA), (4, _V_RV), (11, _V_LV))
        flows = [(row, flow) for flow, _, _, _, row in _VALVES for row in (row, *_FED[flow])]
        self.rows, self.columns = (
            array[[pair[k] for pair in (*pressures, *flows)]]
            for k, array in enumerate((group.equations[0], self.own))
        )
        self._beat: tuple[float, float, float] = (np.nan, 0.0, 0.0)

    def at(self, moment: Moment) -> Added:
        """Return value and derivatives."""
        if moment.time != self._beat[0]:
            self._beat = (moment.time, *self._activation(moment))
        y = moment.state[self.own].tolist()
        found = [self._atrium(side, y[volume]) for side, volume in (("ra", _V_RA), ("la", _V_LA))]
        found += [self._ventricle(side, y[v]) for side, v in (("rv", _V_RV), ("lv", _V_LV))]
        shut = []
        for flow, before, behind, key, _ in _VALVES:
            through, is_open = y[flow], 1.0
            if y[before] <= y[behind] and y[flow] <= 0.0:
                through, is_open = 0.0, 0.0
                shut.append(flow)
            found.append((self.values[key] * through, self.values[key] * is_open))
            found += [(through, is_open)] + [(-through, -is_open)] * (len(_FED[flow]) - 1)
        value, slope = np.array(found).T
        none = np.zeros_like(slope)
        return Added(self.rows, value, (self.rows, self.columns), slope, none, self.own[shut])

    def _activation(self, moment: Moment) -> tuple[float, float]:
        atria = WrappingCosine(moment.period, self.values["Tsa"], self.values["tpwave"])
        scale = fourier(math.fmod(moment.time, moment.period), moment.period)
        return atria(moment.time), float(scale)

    def _atrium(self, side: str, volume: float) -> tuple[float, float]:
        of = self.values
        pressure, slope = atrium(
            self._beat[1], volume - of[f"Vaso_{side}"], of[f"Emax_{side}"], of[f"Kxp_{side}"],
            of[f"Kxv_{side}"], math.exp,
        )  # fmt: skip
        return -pressure, -slope

    def _ventricle(self, side: str, volume: float) -> tuple[float, float]:
        elastance = self._beat[2] * self.values[f"E{side}_s"]
        return -elastance * (volume - self.values[f"V{side}_u"]), -elastance


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
    pressure = to.places[f"{ventricle}:{HEART}"]
    to.add(Coupled(group.equations[:, 2], muscle * share, pressure))
