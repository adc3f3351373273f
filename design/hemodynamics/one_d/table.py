"""Make a table of each vessel's pressures, flows and wall shear from a 1D flow solution."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from design.hemodynamics.one_d.solution import OneDSolution
from design.hemodynamics.vessel.inertance import plug_inertance
from design.hemodynamics.vessel.wall import wave_speed
from design.hemodynamics.vessel.womersley import womersley_number
from design.hemodynamics.zero_d.pulsatile.conditions import PulsatileConditions
from design.network import VesselNetwork
from design.units import PA_PER_MMHG, UL_S_PER_ML_MIN
from kernels.arrays import FloatArray

Table = dict[str, NDArray[np.generic]]


def one_d_table(
    network: VesselNetwork, solution: OneDSolution, conditions: PulsatileConditions
) -> Table:
    """Columns of a per-vessel table, each (v,).

    Flow, shear and numbers are those amid a vessel, pressures at its ends, and
    ``pressure_…_anywhere`` along all of it. An amplitude is half of what lies between least and
    greatest. ``wave_share`` is the length over the wavelength of the cycle, ``widest`` and
    ``narrowest`` diameters over the rest's.
    """
    table: Table = {
        "vessel": np.arange(network.vessel_count),
        "kind": network.kind_names(),
        "tree": network.tree,
        "length_mm": network.lengths(),
        "diameter_mm": 2.0 * network.mean_radius(),
    }
    for name, waves in (("in", solution.pressure_in), ("out", solution.pressure_out)):
        table |= _wave(f"pressure_{name}", waves, "pa")
        table |= {
            f"pressure_{name}_{what}_mmhg": values / PA_PER_MMHG
            for what, values in (
                ("min", waves.min(axis=1)),
                ("mean", waves.mean(axis=1)),
                ("max", waves.max(axis=1)),
            )
        }
    table |= {
        "pressure_min_anywhere_pa": solution.pressure_low,
        "pressure_max_anywhere_pa": solution.pressure_high,
    }
    table |= _wave("flow", solution.flow, "ul_s")
    table |= {
        "flow_min_ul_s": solution.flow.min(axis=1),
        "flow_max_ul_s": solution.flow.max(axis=1),
        "flow_mean_ml_min": solution.flow.mean(axis=1) / UL_S_PER_ML_MIN,
        "flow_amplitude_ml_min": np.ptp(solution.flow, axis=1) / 2.0 / UL_S_PER_ML_MIN,
    }
    return table | _shear(solution, conditions) | _numbers(network, solution, conditions)


def _wave(name: str, values: FloatArray, unit: str) -> Table:
    return {
        f"{name}_mean_{unit}": values.mean(axis=1),
        f"{name}_amplitude_{unit}": np.ptp(values, axis=1) / 2.0,
    }


def _shear(solution: OneDSolution, conditions: PulsatileConditions) -> Table:
    shear = solution.wall_shear(conditions.viscosity_pa_s)
    size = np.abs(shear).mean(axis=1)
    mean = shear.mean(axis=1)
    share = np.divide(np.abs(mean), size, out=np.ones_like(size), where=size > 0.0)
    return _wave("wall_shear", shear, "pa") | {
        "wall_shear_min_pa": shear.min(axis=1),
        "wall_shear_max_pa": shear.max(axis=1),
        "oscillating_shear": np.maximum(0.0, (1.0 - share) / 2.0),
    }


def _numbers(
    network: VesselNetwork, solution: OneDSolution, conditions: PulsatileConditions
) -> Table:
    viscosity, density = conditions.viscosity_pa_s, conditions.density
    omega = 2.0 * np.pi / solution.period_s
    speed = wave_speed(
        plug_inertance(network, density), conditions.wall.compliance(network), network.lengths()
    )
    rest = solution.rest_area
    return {
        "reynolds_max": solution.reynolds(viscosity, density),
        "womersley": womersley_number(network.mean_radius(), omega, viscosity, density),
        "wave_speed_mm_s": speed,
        "wave_share": network.lengths() / (speed * solution.period_s),
        "speed_over_wave_speed": np.abs(solution.velocity()).max(axis=1) / speed,
        "widest": np.sqrt(solution.area.max(axis=1) / rest),
        "narrowest": np.sqrt(solution.area.min(axis=1) / rest),
    }
