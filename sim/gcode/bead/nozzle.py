"""Constants of ink flow from plunger to needle tip: lag, needle resistance, yield pressure.

Syringe, plunger and ink give way by C µL/Pa; the needle resists. With P the pressure behind it,

    C dP/dt = Q_plunger − Q,    Q = (P − P_y) / R  for P > P_y,  else 0,

so that V = C P, the ink that is held back, follows dV/dt = Q_plunger − (V − V_y)/τ with τ = R C.
τ is what `printctl calibrate lag` measures. P_y = 4 τ_y L/d is what a yield stress holds in the
needle (`firmware_profiles.yield_pressure_pa`). R is the needle's secant resistance at the job's
flow, P(Q)/Q less P_y of a Herschel-Bulkley ink (`firmware_profiles.rheology`): a power-law ink is
taken as linear around that flow, as its measured τ is.
"""

from __future__ import annotations

from dataclasses import dataclass

from firmware_profiles import Ink, Needle, pressure_pa, yield_pressure_pa


@dataclass(frozen=True)
class Nozzle:
    """Constants of the flow out of a needle.

    Attributes
    ----------
    lag_s : float, s
        τ; 0 where the needle gives what the plunger pushes, at once.
    resistance_pa_s_ul : float, Pa·s/µL
        R; 0 where no needle is known, and then pressure isn't either.
    held_pa : float, Pa
        P_y; what drives nothing and stays behind after a stop.
    """

    lag_s: float = 0.0
    resistance_pa_s_ul: float = 0.0
    held_pa: float = 0.0

    @property
    def held_ul(self) -> float:
        """V_y = C P_y, the ink that stays compressed while nothing flows, µL."""
        if self.resistance_pa_s_ul == 0:
            return 0.0
        return self.lag_s * self.held_pa / self.resistance_pa_s_ul


def nozzle_of(ink: Ink, needle: Needle | None, lag_s: float, flow_ul_s: float) -> Nozzle:
    """Constants for an ink and a needle around a flow (µL/s); without a needle the lag alone."""
    if needle is None or flow_ul_s <= 0:
        return Nozzle(lag_s)
    held = yield_pressure_pa(ink, needle)
    return Nozzle(lag_s, (pressure_pa(ink, needle, flow_ul_s) - held) / flow_ul_s, held)
