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

from collections.abc import Callable, Sequence
from functools import partial

import numpy as np

from design.hemodynamics.zero_d.svzerod.activation import Activation
from design.hemodynamics.zero_d.svzerod.stamps import Group, Stamps
from design.hemodynamics.zero_d.svzerod.terms import (
    AFFINE,
    EXPONENTIAL,
    JUMP_VALVE,
    SPHERE,
    TANH_VALVE,
    Moments,
)
from kernels.arrays import FloatArray


def linear_chamber(group: Group, to: Stamps) -> None:
    """Add the equations of LinearElastanceChamber."""
    _chamber(to, 0.0)
    greatest, passive, rest = group.values.T
    active = partial(activation_at, group.activations)
    _elastance(to, lambda at: (passive + greatest * active(at), rest))


def inductor_chamber(group: Group, to: Stamps) -> None:
    """Add the equations of ChamberElastanceInductor."""
    greatest, least, diastole, systole, inertance = group.values.T
    _chamber(to, inertance)

    def timed(at: Moments) -> tuple[FloatArray, FloatArray]:
        active = activation_at(group.activations, at)
        return (greatest - least) * active + least, (1.0 - active) * (diastole - systole) + systole

    _elastance(to, timed)


def exponential_chamber(group: Group, to: Stamps) -> None:
    """Add the equations of ChamberElastanceInductorExponential."""
    greatest, inertance, pressure, volume, rest = group.values.T
    _chamber(to, inertance)
    constants = (greatest, pressure, volume, rest)
    timed = partial(_activations, group.activations)
    to.add(EXPONENTIAL, (0,), (4,), ((0, 0),), constants, timed)


def activation_at(activations: Sequence[Activation], at: Moments) -> FloatArray:
    """Return the activation of chambers at times, (s, m)."""
    return np.array([[one(time) for one in activations] for time in at.times.tolist()])


def _activations(activations: Sequence[Activation], at: Moments) -> tuple[FloatArray]:
    return (activation_at(activations, at),)


def _chamber(to: Stamps, inertance: FloatArray | float) -> None:
    to.f(0, {0: 1.0})
    to.f(1, {0: 1.0, 2: -1.0})
    to.e(1, {3: -inertance})
    to.f(2, {1: 1.0, 3: -1.0})
    to.e(2, {4: -1.0})


def _elastance(to: Stamps, law: Callable[[Moments], tuple[FloatArray, FloatArray]]) -> None:
    """Add -E (V - V_rest); ``law`` gives E and V_rest at times."""

    def timed(at: Moments) -> tuple[FloatArray, FloatArray, FloatArray]:
        elastance, rest = law(at)
        return -elastance, np.zeros_like(elastance), rest

    to.add(AFFINE, (0,), (4,), ((0, 0),), timed=timed)


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
    slopes = ((0, 0), (0, 1), (0, 3), (1, 1), (2, 1), (2, 2), (3, 4))
    timed = partial(_sphere_active, group.values.T)
    to.add(SPHERE, range(4), (2, 4, 5, 6, 7), slopes, group.values.T[1:7], timed)


def _sphere_active(values: FloatArray, at: Moments) -> tuple[FloatArray]:
    most, least, systole, diastole, steep = values[7:]
    time = np.fmod(at.times, at.period)[:, None]
    on = 0.5 * (1.0 + np.tanh((time - systole) / steep))
    share = on * (0.5 * (1.0 - np.tanh((time - diastole) / steep)))
    return (np.asarray(most * share + least * (1.0 - share)),)


def tanh_valve(group: Group, to: Stamps) -> None:
    """Add the equations of ValveTanh."""
    _valve(to)
    to.f(2, {4: 1.0})
    slopes = ((0, 0), (0, 1), (0, 2), (1, 0), (1, 2))
    to.add(TANH_VALVE, (0, 2), (0, 1, 2), slopes, group.values.T)


def jump_valve(group: Group, to: Stamps) -> None:
    """Add the equations of PiecewiseValve."""
    _valve(to)
    to.add(JUMP_VALVE, (0,), (0, 1, 2), ((0, 1),), group.values.T)


def _valve(to: Stamps) -> None:
    to.f(0, {0: 1.0, 2: -1.0})
    to.f(1, {1: 1.0, 3: -1.0})
