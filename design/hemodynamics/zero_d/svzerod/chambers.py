"""Equations of svZeroDSolver's heart chambers and valves.

Variables are pressure and flow at the inlet, at the outlet, then the element's own (`elements`).
As in svZeroDSolver's documentation:

* LinearElastanceChamber (Regazzoni et al. 2022, doi 10.1016/j.jcp.2022.111083): P = E (V - V_rest),
  E = E_pass + E_max φ(t), equal pressures at both ends.
* ChamberElastanceInductor (Kerckhoffs et al. 2007, doi 10.1007/s10439-006-9212-7): E from E_min to
  E_max, V_rest from V_rd to V_rs, an inertance at the outlet.
* ChamberElastanceInductorExponential (Sankaran et al. 2012): P = φ E_max (V - V_so)
  + (1 - φ) K_p (exp(K_v (V - V_so)) - 1).
* ChamberSphere (Caruel et al. 2014, doi 10.1007/s10237-013-0544-6; Pfaller et al. 2019, doi
  10.1007/s10237-018-1098-4): a thin sphere of a hyperelastic, viscous, contracting material.
* ValveTanh (Pfaller et al. 2019, eq. 16 and 22): a resistance that goes over from R_min to R_max;
  PiecewiseValve: one that jumps.
"""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np

from design.hemodynamics.zero_d.svzerod.laws import Law, Local, Response
from design.hemodynamics.zero_d.svzerod.stamps import Group, Stamps
from design.network import FloatArray


def linear_chamber(group: Group, to: Stamps) -> None:
    """Add the equations of LinearElastanceChamber."""
    _chamber(to, 0.0)
    greatest, passive, rest = group.values.T

    def law(here: Local) -> Response:
        return _elastance(here, passive + greatest * here.activation, rest)

    to.add(Law(group, law))


def inductor_chamber(group: Group, to: Stamps) -> None:
    """Add the equations of ChamberElastanceInductor."""
    greatest, least, diastole, systole, inertance = group.values.T
    _chamber(to, inertance)

    def law(here: Local) -> Response:
        rest = (1.0 - here.activation) * (diastole - systole) + systole
        return _elastance(here, (greatest - least) * here.activation + least, rest)

    to.add(Law(group, law))


def exponential_chamber(group: Group, to: Stamps) -> None:
    """Add the equations of ChamberElastanceInductorExponential."""
    greatest, inertance, pressure, volume, rest = group.values.T
    _chamber(to, inertance)

    def law(here: Local) -> Response:
        value, slope = atrium(here.activation, here.y[4] - rest, greatest, pressure, volume)
        return Response({0: -value}, {(0, 4): -slope})

    to.add(Law(group, law))


def atrium(
    active: Any, filled: Any, greatest: Any, pressure: Any, volume: Any, exp: Any = np.exp
) -> tuple[Any, Any]:
    """Return the pressure of a chamber that is exponential at rest, and its derivative.

    Parameters
    ----------
    active, filled : float or (m,) float64
        Activation; volume above that without pressure.
    greatest, pressure, volume : float or (m,) float64
        Elastance when contracted; K_p and K_v at rest.
    exp : function
        `math.exp` for plain numbers.
    """
    grown = exp(volume * filled)
    value = active * greatest * filled + (1.0 - active) * pressure * (grown - 1.0)
    slope = active * greatest + (1.0 - active) * pressure * volume * grown
    return value, slope


def _chamber(to: Stamps, inertance: FloatArray | float) -> None:
    to.f(0, {0: 1.0})
    to.f(1, {0: 1.0, 2: -1.0})
    to.e(1, {3: -inertance})
    to.f(2, {1: 1.0, 3: -1.0})
    to.e(2, {4: -1.0})


def _elastance(here: Local, elastance: FloatArray, rest: FloatArray) -> Response:
    return Response({0: -elastance * (here.y[4] - rest)}, {(0, 4): -elastance})


def sphere(group: Group, to: Stamps) -> None:
    """Add the equations of ChamberSphere."""
    density, thickness = group.values.T[:2]
    to.e(0, {5: density * thickness})
    to.f(1, {6: -1.0, 7: 1.0})
    to.e(2, {8: -1.0})
    to.e(3, {7: 1.0})
    to.e(4, {4: 1.0})
    to.f(4, {5: -1.0})
    to.f(5, {1: 1.0, 3: -1.0})
    to.e(5, {8: -1.0})
    to.f(6, {0: 1.0, 2: -1.0})
    to.add(Law(group, partial(_sphere_law, group.values.T)))


def _sphere_law(values: FloatArray, here: Local) -> Response:
    """With s = 1 + r/r₀ the stretch, C = s²: momentum, stress, volume and active stress."""
    _, thickness, radius, w1, w2, viscosity, greatest = values[:7]
    pressure, change, speed, stress, tension = here.y[[2, 4, 5, 6, 7]]
    s, slope, rate = 1.0 + change / radius, thickness / radius, here.rate[4] / radius
    passive = w1 + w2 * s**2
    area, active = 4.0 * np.pi * radius**2, _sphere_active(values, here)
    stretched = 1.0 - s**-6.0
    by_stretch = 24.0 * s**-7.0 * passive + 8.0 * stretched * s * w2
    by_stretch += 2.0 * viscosity * rate * (1.0 - 22.0 * s**-12.0)
    drag = 2.0 * viscosity * (s + 2.0 * s**-11.0)
    return Response(
        {
            0: s * (slope * stress - pressure * s),
            1: 4.0 * stretched * passive + drag * rate,
            2: area * s**2 * speed,
            3: np.abs(active) * tension - greatest * np.maximum(active, 0.0),
        },
        {
            (0, 2): -(s**2),
            (0, 4): (slope * stress - 2.0 * pressure * s) / radius,
            (0, 6): s * slope,
            (1, 4): by_stretch / radius,
            (2, 4): 2.0 * area * s * speed / radius,
            (2, 5): area * s**2,
            (3, 7): np.abs(active),
        },
        {(1, 4): drag / radius},
    )


def _sphere_active(values: FloatArray, here: Local) -> FloatArray:
    most, least, systole, diastole, steep = values[7:]
    time = float(np.fmod(here.time, here.period))
    on = 0.5 * (1.0 + np.tanh((time - systole) / steep))
    share = on * (0.5 * (1.0 - np.tanh((time - diastole) / steep)))
    return np.asarray(most * share + least * (1.0 - share))


def tanh_valve(group: Group, to: Stamps) -> None:
    """Add the equations of ValveTanh."""
    most, least, steep = group.values.T
    _valve(to)
    to.f(2, {4: 1.0})

    def law(here: Local) -> Response:
        before, flow, behind = here.y[:3]
        turned = np.tanh(steep * (behind - before))
        bend = 0.5 * steep * (1.0 - turned**2)
        resistance = 0.5 * (most + least) + 0.5 * (most - least) * turned
        by_pressure = (most - least) * flow * bend
        return Response(
            {0: -resistance * flow, 2: -0.5 * (1.0 + turned)},
            {
                (0, 0): by_pressure, (0, 1): -resistance, (0, 2): -by_pressure,
                (2, 0): bend, (2, 2): -bend,
            },
        )  # fmt: skip

    to.add(Law(group, law))


def jump_valve(group: Group, to: Stamps) -> None:
    """Add the equations of PiecewiseValve."""
    most, least = group.values.T
    _valve(to)

    def law(here: Local) -> Response:
        resistance = np.where(here.y[2] < here.y[0], least, most)
        return Response({0: -resistance * here.y[1]}, {(0, 1): -resistance})

    to.add(Law(group, law))


def _valve(to: Stamps) -> None:
    to.f(0, {0: 1.0, 2: -1.0})
    to.f(1, {1: 1.0, 3: -1.0})
