"""Compute values and derivatives of the terms of svZeroDSolver's equations."""

from __future__ import annotations

import numpy as np

from design.hemodynamics.zero_d.svzerod.terms import (
    AFFINE,
    COUPLED,
    EXPONENTIAL,
    GATE,
    JUMP_VALVE,
    LOSS,
    SPHERE,
    STORED_LOSS,
    TANH_VALVE,
    Terms,
)
from kernels import jit
from kernels.arrays import FloatArray, IntArray


@jit
def term_values(
    terms: Terms, timed: FloatArray, state: FloatArray, rate: FloatArray, value: FloatArray,
    by_state: FloatArray, by_rate: FloatArray, shut: IntArray,
) -> None:  # fmt: skip
    """Write each term's values and derivatives.

    Parameters
    ----------
    timed : (t, 3) float64
        `timed_coefficients` at this time.
    state, rate : (n,) float64
    value : (p,) float64
        Written.
    by_state, by_rate : (d,) float64
        Written; ``by_rate`` is 0 before, and where nothing depends on rates.
    shut : (t,) int64
        Written: the flow that a closed valve sets to 0 once the correction is found; -1 for none.
    """
    for k in range(len(terms.kind)):
        kind, v, d = terms.kind[k], terms.first_value[k], terms.first_slope[k]
        first = terms.variables[k, 0]
        y, size = state[first], terms.constants[k, 0]
        shut[k] = -1
        if kind == LOSS:
            slope = -size * abs(y)
            value[v], by_state[d] = slope * y, 2.0 * slope
        elif kind == STORED_LOSS:
            slope = 2.0 * size * abs(y)
            value[v], by_rate[d] = slope * rate[first], slope
            by_state[d] = 2.0 * size * np.sign(y) * rate[first]
        elif kind == AFFINE:
            value[v] = timed[k, 0] * (y - timed[k, 2]) + timed[k, 1] * rate[first]
            by_state[d], by_rate[d] = timed[k, 0], timed[k, 1]
        elif kind == EXPONENTIAL:
            _exponential(terms.constants[k], timed[k, 0], y, value[v:], by_state[d:])
        elif kind == TANH_VALVE:
            flow, behind = state[terms.variables[k, 1]], state[terms.variables[k, 2]]
            _tanh_valve(terms.constants[k], y, flow, behind, value[v:], by_state[d:])
        elif kind == JUMP_VALVE:
            flow, behind = state[terms.variables[k, 1]], state[terms.variables[k, 2]]
            resistance = terms.constants[k, 1] if behind < y else size
            value[v], by_state[d] = -resistance * flow, -resistance
        elif kind == SPHERE:
            _sphere(terms, k, timed[k, 0], state, rate, value[v:], by_state[d:], by_rate[d:])
        elif kind == COUPLED:
            value[v] = -size * y
        elif kind == GATE:
            before, behind = state[terms.variables[k, 1]], state[terms.variables[k, 2]]
            is_open = 1.0
            if before <= behind and y <= 0.0:
                is_open = 0.0
                shut[k] = first
            factor = size
            for j in range(terms.first_value[k + 1] - v):
                value[v + j], by_state[d + j] = factor * (is_open * y), factor * is_open
                factor = 1.0 if j == 0 else -1.0


@jit
def _exponential(
    of: FloatArray, active: float, volume: float, value: FloatArray, by_state: FloatArray
) -> None:
    """P = φ E_max (V - V_so) + (1 - φ) K_p (exp(K_v (V - V_so)) - 1)."""
    greatest, pressure, stiff, filled = of[0], of[1], of[2], volume - of[3]
    grown = np.exp(stiff * filled)
    value[0] = -(active * greatest * filled + (1.0 - active) * pressure * (grown - 1.0))
    by_state[0] = -(active * greatest + (1.0 - active) * pressure * stiff * grown)


@jit
def _tanh_valve(
    of: FloatArray, before: float, flow: float, behind: float, value: FloatArray,
    by_state: FloatArray,
) -> None:  # fmt: skip
    most, least, steep = of[0], of[1], of[2]
    turned = np.tanh(steep * (behind - before))
    bend = 0.5 * steep * (1.0 - turned**2)
    resistance = 0.5 * (most + least) + 0.5 * (most - least) * turned
    by_pressure = (most - least) * flow * bend
    value[0], value[1] = -resistance * flow, -0.5 * (1.0 + turned)
    by_state[0], by_state[1], by_state[2] = by_pressure, -resistance, -by_pressure
    by_state[3], by_state[4] = bend, -bend


@jit
def _sphere(
    terms: Terms, k: int, active: float, state: FloatArray, rate: FloatArray, value: FloatArray,
    by_state: FloatArray, by_rate: FloatArray,
) -> None:  # fmt: skip
    """With s = 1 + r/r₀ the stretch, C = s²: momentum, stress, volume and active stress."""
    of, at = terms.constants[k], terms.variables[k]
    thickness, radius, w1, w2, viscosity, greatest = of[0], of[1], of[2], of[3], of[4], of[5]
    pressure, change, speed = state[at[0]], state[at[1]], state[at[2]]
    stress, tension = state[at[3]], state[at[4]]
    s, slope, moving = 1.0 + change / radius, thickness / radius, rate[at[1]] / radius
    passive, area, stretched = w1 + w2 * s**2, 4.0 * np.pi * radius**2, 1.0 - s**-6.0
    by_stretch = 24.0 * s**-7.0 * passive + 8.0 * stretched * s * w2
    by_stretch += 2.0 * viscosity * moving * (1.0 - 22.0 * s**-12.0)
    drag = 2.0 * viscosity * (s + 2.0 * s**-11.0)
    value[0] = s * (slope * stress - pressure * s)
    value[1] = 4.0 * stretched * passive + drag * moving
    value[2] = area * s**2 * speed
    value[3] = abs(active) * tension - greatest * max(active, 0.0)
    by_state[0] = -(s**2)
    by_state[1] = (slope * stress - 2.0 * pressure * s) / radius
    by_state[2] = s * slope
    by_state[3], by_rate[3] = by_stretch / radius, drag / radius
    by_state[4] = 2.0 * area * s * speed / radius
    by_state[5] = area * s**2
    by_state[6] = abs(active)
