"""Make a table of each vessel's pressures, flows and wall shear from a pulsatile 0D solution."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from design.hemodynamics.vessel_coefficients import (
    QUASI_STEADY,
    plug_inertance,
    shear_factor,
    wave_speed,
    womersley_number,
)
from design.hemodynamics.zero_d.pulsatile.conditions import PulsatileConditions
from design.hemodynamics.zero_d.pulsatile.solution import (
    SAMPLES,
    ComplexArray,
    PulsatileSolution,
    cycle_extremes,
)
from design.hemodynamics.zero_d.validity import ENTRANCE_SHARE, LAMINAR_REYNOLDS, entrance_share
from design.network import VesselNetwork
from design.units import PA_PER_MMHG, UL_S_PER_ML_MIN
from kernels.arrays import FloatArray


@dataclass(frozen=True)
class PulseNumbers:
    """Numbers that say how a pulse goes through each vessel, all (v,).

    Attributes
    ----------
    womersley : float64
        At the fundamental frequency; 0 where nothing changes.
    reynolds : float64
        At the greatest flow.
    wave_speed : float64, mm/s
        Pulse wave velocity; infinite in a rigid vessel.
    wave_share : float64
        Length over the wavelength of the fundamental; a lumped vessel needs it well below 1.
    quasi_steady : bool
        Womersley number below 1: the profile stays a parabola in step with the pressure.
    poiseuille : bool
        Quasi-steady, laminar, and developed but for a tenth of the length.
    """

    womersley: FloatArray
    reynolds: FloatArray
    wave_speed: FloatArray
    wave_share: FloatArray
    quasi_steady: NDArray[np.bool_]
    poiseuille: NDArray[np.bool_]


def pulse_numbers(
    network: VesselNetwork, solution: PulsatileSolution, conditions: PulsatileConditions
) -> PulseNumbers:
    """Womersley and Reynolds numbers, pulse wave velocity, and what holds in each vessel."""
    radius, length = network.mean_radius(), network.lengths()
    omega = float(solution.omega[1:].min(initial=np.inf))
    omega = omega if np.isfinite(omega) else 0.0
    alpha = womersley_number(radius, omega, conditions.viscosity_pa_s, conditions.density)
    low, high = cycle_extremes(solution, middle_flow(solution))
    peak = np.maximum(np.abs(low), np.abs(high))
    number = 2.0 * conditions.density * peak / (np.pi * radius * conditions.viscosity_pa_s)
    inertance = plug_inertance(network, conditions.density)
    speed = wave_speed(inertance, conditions.wall.compliance(network), length)
    steady = alpha < QUASI_STEADY
    developed = entrance_share(network, number) <= ENTRANCE_SHARE
    return PulseNumbers(
        alpha,
        number,
        speed,
        length * omega / (2.0 * np.pi * speed),
        steady,
        steady & developed & (number < LAMINAR_REYNOLDS),
    )


def middle_flow(solution: PulsatileSolution) -> ComplexArray:
    """Phasors of the flow amid each vessel, (k, v), µL/s."""
    return (solution.flow_in + solution.flow_out) / 2.0


def shear_phasors(
    network: VesselNetwork, solution: PulsatileSolution, conditions: PulsatileConditions
) -> ComplexArray:
    """Phasors of the wall shear at the mean radius, (k, v), Pa, with Womersley's correction."""
    radius = network.mean_radius()
    shear = middle_flow(solution) * (4.0 * conditions.viscosity_pa_s / (np.pi * radius**3))
    for k, omega in enumerate(solution.omega):
        alpha = womersley_number(radius, omega, conditions.viscosity_pa_s, conditions.density)
        shear[k] *= shear_factor(alpha)
    return shear


def pulsatile_table(
    network: VesselNetwork, solution: PulsatileSolution, conditions: PulsatileConditions
) -> dict[str, NDArray[np.generic]]:
    """Columns of a per-vessel table, each (v,).

    An amplitude is half of what lies between least and greatest. ``pressure_damping`` and
    ``flow_damping`` are amplitudes at the vessel's end over those at its begin (1 where nothing
    changes), ``oscillating_shear`` is ½ (1 - |mean τ|/mean |τ|), 0 where the shear keeps its
    direction and ½ where it has none.
    """
    numbers = pulse_numbers(network, solution, conditions)
    table: dict[str, NDArray[np.generic]] = {
        "vessel": np.arange(network.vessel_count),
        "kind": network.kind_names(),
        "tree": network.tree,
        "length_mm": network.lengths(),
        "diameter_mm": 2.0 * network.mean_radius(),
    }
    swings = cycle_extremes(solution, solution.pressure)
    for name, nodes in (("in", network.vessel_nodes[:, 0]), ("out", network.vessel_nodes[:, 1])):
        table |= _pressures(
            name, solution.pressure[0].real[nodes], swings[0][nodes], swings[1][nodes]
        )
    table |= _flows(solution)
    table["pressure_damping"] = _ratio(
        table["pressure_out_amplitude_pa"], table["pressure_in_amplitude_pa"]
    )
    table["flow_damping"] = _ratio(
        _amplitude(solution, solution.flow_out), _amplitude(solution, solution.flow_in)
    )
    table |= _shears(solution, shear_phasors(network, solution, conditions))
    return table | {
        "reynolds_max": numbers.reynolds,
        "womersley": numbers.womersley,
        "wave_speed_mm_s": numbers.wave_speed,
        "wave_share": numbers.wave_share,
        "quasi_steady": numbers.quasi_steady.astype(np.int64),
        "poiseuille_holds": numbers.poiseuille.astype(np.int64),
    }


def _pressures(
    name: str, mean: FloatArray, low: FloatArray, high: FloatArray
) -> dict[str, NDArray[np.generic]]:
    return {
        f"pressure_{name}_mean_pa": mean,
        f"pressure_{name}_amplitude_pa": (high - low) / 2.0,
        f"pressure_{name}_min_mmhg": low / PA_PER_MMHG,
        f"pressure_{name}_mean_mmhg": mean / PA_PER_MMHG,
        f"pressure_{name}_max_mmhg": high / PA_PER_MMHG,
    }


def _flows(solution: PulsatileSolution) -> dict[str, NDArray[np.generic]]:
    flow = middle_flow(solution)
    low, high = cycle_extremes(solution, flow)
    mean = flow[0].real
    return {
        "flow_mean_ul_s": mean,
        "flow_amplitude_ul_s": (high - low) / 2.0,
        "flow_min_ul_s": low,
        "flow_max_ul_s": high,
        "flow_mean_ml_min": mean / UL_S_PER_ML_MIN,
        "flow_amplitude_ml_min": (high - low) / 2.0 / UL_S_PER_ML_MIN,
    }


def _shears(solution: PulsatileSolution, shear: ComplexArray) -> dict[str, NDArray[np.generic]]:
    low, high = cycle_extremes(solution, shear)
    mean = shear[0].real
    return {
        "wall_shear_mean_pa": mean,
        "wall_shear_amplitude_pa": (high - low) / 2.0,
        "wall_shear_min_pa": low,
        "wall_shear_max_pa": high,
        "oscillating_shear": _oscillating(solution, shear, mean),
    }


def _oscillating(
    solution: PulsatileSolution, shear: ComplexArray, mean: FloatArray, chunk: int = 20_000
) -> FloatArray:
    size = np.empty(len(mean))
    times = solution.times(SAMPLES)
    for start in range(0, len(mean), chunk):
        part = slice(start, start + chunk)
        size[part] = np.abs(solution.at(shear[:, part], times)).mean(axis=0)
    share = np.divide(np.abs(mean), size, out=np.ones_like(size), where=size > 0.0)
    return np.maximum(0.0, (1.0 - share) / 2.0)


def _amplitude(solution: PulsatileSolution, phasors: ComplexArray) -> FloatArray:
    low, high = cycle_extremes(solution, phasors)
    return (high - low) / 2.0


def _ratio(over: NDArray[np.generic], under: NDArray[np.generic]) -> FloatArray:
    top, bottom = (np.asarray(x, dtype=np.float64) for x in (over, under))
    still = 1e-12 * float(bottom.max(initial=0.0))
    return np.divide(top, bottom, out=np.ones_like(top), where=bottom > still)
