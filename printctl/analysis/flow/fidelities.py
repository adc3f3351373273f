"""Solve 3D flow; compare 0D, 1D and 3D flow at the same places."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Final

import numpy as np

from design.files import write_bytes
from design.hemodynamics import (
    FlowConditions,
    PulsatileConditions,
    RigidWall,
    pulsatile_at_probes,
    solve_flow,
    solve_one_d,
    solve_pulsatile,
    steady_at_probes,
)
from design.hemodynamics.probes import Probes, ProbeWaves, clear_parts, midpoints, probes_along
from design.hemodynamics.three_d import ThreeDSolution, check_cycles, probe_steady
from design.hemodynamics.three_d.time_steps import pulse_error
from design.hemodynamics.three_d.vessels.effective import effective_network, flow_error
from design.network import VesselNetwork
from design.units import PA_PER_MMHG, UL_S_PER_ML_MIN
from kernels.arrays import FloatArray
from printctl.analysis.flow.solve import one_d_options
from printctl.analysis.flow.tables import write_columns
from printctl.analysis.flow.three_d import (
    FlowInMesh,
    Tell,
    pulse_at,
    resolve,
    stepping_of,
    write_resolved,
)
from printctl.recipe.parts import ComparePart, FlowPart
from report.figures.flow_figures import comparison_figure
from report.figures.lumen_figure import pressure_figure, shear_figure, streamline_figure

# The ideal is the design as it is meant: Poiseuille's resistance of the designed radii between
# rigid walls, solved 0D.
COMPARISON: Final = "flow_comparison.csv"
IDEAL: Final = "ideal"
_UL_MIN: Final = 1000.0 / UL_S_PER_ML_MIN
"""µL/min in a µL/s, over 1000 µL in a mL."""


@dataclass(frozen=True)
class Comparison:
    """Waves of several fidelities at the same places and times.

    Attributes
    ----------
    probes : Probes
        Amid every vessel, then along one.
    along : int
        The vessel of the last ones.
    points : int
        How many those are.
    time_s : (t,) float64
    waves : mapping of fidelity to ProbeWaves
        `IDEAL` first.
    inlet_flow_ul_s, inlet_pressure_pa : float
        Mean, of the ideal; deviations are told as parts of them.
    """

    probes: Probes
    along: int
    points: int
    time_s: FloatArray
    waves: Mapping[str, ProbeWaves]
    inlet_flow_ul_s: float
    inlet_pressure_pa: float

    def line(self) -> dict[str, Any]:
        """What the comparison's figure draws: the places along the one vessel."""
        amid = len(self.probes.vessel) - int(self.points)
        return {
            "vessel": self.along,
            "time_s": self.time_s,
            "fraction": self.probes.fraction[amid:],
            "flow_ml_min": {n: w.flow[amid:] / UL_S_PER_ML_MIN for n, w in self.waves.items()},
            "pressure_mmhg": {n: w.pressure[amid:] / PA_PER_MMHG for n, w in self.waves.items()},
        }


def places(network: VesselNetwork, part: ComparePart) -> tuple[Probes, int]:
    """Where fidelities are compared, and the vessel that the last places are along."""
    longest = int(np.argmax(network.lengths()))
    vessel = longest if part.along_vessel is None else part.along_vessel
    amid = midpoints(network)
    Probes(np.array([vessel]), np.array([0.5])).check(network)
    first, last = clear_parts(network)[vessel]
    share = first + (last - first) * probes_along(vessel, part.points).fraction
    return Probes(
        np.append(amid.vessel, np.full(part.points, vessel)), np.append(amid.fraction, share)
    ), vessel


def steady_comparison(
    network: VesselNetwork,
    conditions: FlowConditions,
    part: ComparePart,
    others: Mapping[str, ProbeWaves],
) -> Comparison:
    """Compare steady flows.

    Raises
    ------
    FlowError
        A vessel that the network doesn't have.
    """
    probes, vessel = places(network, part)
    solution = solve_flow(network, conditions)
    ideal = steady_at_probes(network, solution, conditions, probes)
    inflow = float(np.abs(solution.flow).max())
    waves = {IDEAL: ideal, **others}
    drop = float(np.ptp(solution.pressure))
    return Comparison(probes, vessel, part.points, np.zeros(1), waves, inflow, drop)


def pulsatile_comparison(
    network: VesselNetwork,
    conditions: PulsatileConditions,
    part: ComparePart,
    others: Mapping[str, ProbeWaves],
    time_s: FloatArray,
) -> Comparison:
    """Compare a cycle, at ``time_s`` of it; the others' waves are brought to these times.

    Raises
    ------
    FlowError
        A vessel that the network doesn't have.
    """
    probes, vessel = places(network, part)
    rigid = replace(conditions, wall=RigidWall(), profile="poiseuille")
    count = len(time_s)
    solution = solve_pulsatile(network, rigid, max(count, 100))
    ideal = pulsatile_at_probes(network, solution, rigid, probes, count)
    inlet = network.inlets()
    into = np.isin(network.vessel_nodes[:, 0], inlet)
    inflow = float(solution.flow_in[0, into].real.sum())
    drop = float(solution.pressure[0, inlet].real.max() - solution.pressure[0].real.min())
    period = solution.period_s
    waves = {IDEAL: ideal} | {name: _at(wave, time_s, period) for name, wave in others.items()}
    return Comparison(probes, vessel, part.points, time_s, waves, inflow, drop)


def _at(wave: ProbeWaves, time_s: FloatArray, period: float) -> ProbeWaves:
    """The same at other times of the cycle."""

    def brought(values: FloatArray) -> FloatArray:
        return np.array([np.interp(time_s, wave.time_s, row, period=period) for row in values])

    return ProbeWaves(time_s, brought(wave.pressure), brought(wave.flow))


def comparison_table(comparison: Comparison) -> dict[str, Any]:
    """A row a place and fidelity: means, swings, and how far from the ideal."""
    blocks = [_block(comparison, name) for name in comparison.waves]
    return {key: np.concatenate([block[key] for block in blocks]) for key in blocks[0]}


def _block(comparison: Comparison, name: str) -> dict[str, Any]:
    wave, ideal = comparison.waves[name], comparison.waves[IDEAL]
    flow, pressure = wave.flow - ideal.flow, wave.pressure - ideal.pressure
    count = len(comparison.probes.vessel)
    return {
        "fidelity": np.full(count, name),
        "vessel": comparison.probes.vessel,
        "fraction": comparison.probes.fraction,
        "flow_ml_min": wave.flow.mean(axis=1) / UL_S_PER_ML_MIN,
        "flow_swing_ml_min": np.ptp(wave.flow, axis=1) / UL_S_PER_ML_MIN,
        "pressure_mmhg": wave.pressure.mean(axis=1) / PA_PER_MMHG,
        "pressure_swing_mmhg": np.ptp(wave.pressure, axis=1) / PA_PER_MMHG,
        "flow_off_ul_min": np.abs(flow).max(axis=1) * _UL_MIN,
        "pressure_off_mmhg": np.abs(pressure).max(axis=1) / PA_PER_MMHG,
    }


def comparison_summary(comparison: Comparison) -> dict[str, Any]:
    """Largest deviations from the ideal of each fidelity, in units and as parts of the inlet's."""
    summary: dict[str, Any] = {"along_vessel": comparison.along}
    ideal = comparison.waves[IDEAL]
    for name, wave in comparison.waves.items():
        if name == IDEAL:
            continue
        # 3D has no flow where no section is clear.
        flow = float(np.nanmax(np.abs(wave.flow - ideal.flow)))
        pressure = float(np.abs(wave.pressure - ideal.pressure).max())
        summary[name] = {
            "flow_off_ul_min": flow * _UL_MIN,
            "flow_off_percent_of_inlet": 100.0 * flow / comparison.inlet_flow_ul_s,
            "pressure_off_mmhg": pressure / PA_PER_MMHG,
            "pressure_off_percent_of_inlet": 100.0 * pressure / comparison.inlet_pressure_pa,
            "flow_spread_percent": _spread(comparison, wave),
        }
    summary["ideal_flow_spread_percent"] = _spread(comparison, ideal)
    return summary


def _spread(comparison: Comparison, wave: ProbeWaves) -> float:
    """Standard deviation over mean of the flow amid vessels, in percent."""
    amid = len(comparison.probes.vessel) - comparison.points
    flow = np.abs(wave.flow[:amid].mean(axis=1))
    mean = np.nanmean(flow)
    return float(100.0 * np.nanstd(flow) / mean) if mean > 0.0 else 0.0


def write_comparison(folder: Path, comparison: Comparison) -> str:
    """Write `COMPARISON`; its name."""
    folder.mkdir(parents=True, exist_ok=True)
    write_columns(folder / COMPARISON, comparison_table(comparison))
    return COMPARISON


COMPARED, SEEN, STREAMLINES = "flow_comparison.svg", "flow_3d.svg", "flow_streamlines.svg"
PRESSURE = "flow_3d_pressure.svg"


@dataclass(frozen=True)
class Case:
    """A network, what drives it, and what of it is asked for.

    Attributes
    ----------
    network : VesselNetwork
    part : FlowPart
    steady : FlowConditions
    pulse : PulsatileConditions or None
    fillet_ratio : float
        Of the lumens as they are printed.
    """

    network: VesselNetwork
    part: FlowPart
    steady: FlowConditions
    pulse: PulsatileConditions | None
    fillet_ratio: float


@dataclass
class Outcome:
    """Summary by fidelity, the files written, and sentences for the user."""

    summary: dict[str, Any] = field(default_factory=dict)
    files: list[str] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)


def solve_fidelities(folder: Path, case: Case, tell: Tell) -> Outcome:
    """Resolve the flow in space and compare fidelities, as far as the section asks; write both.

    Raises
    ------
    FlowError, SolidError, OSError
        As `resolve`, `pulse_at`, `solve_one_d` and the writers.
    """
    done, resolved = Outcome(), None
    if case.pulse is not None and case.part.three_d is not None and case.part.compare is not None:
        check_cycles(
            case.network.radius.max(), case.pulse, stepping_of(case.part.three_d, case.pulse)
        )
    if case.part.three_d is not None:
        driven = case.steady
        resolved, summary = resolve(
            case.network, driven, case.part.three_d, case.fillet_ratio, tell
        )
        summary["reduced"] = _reduced_summary(case.network, driven, resolved.steady)
        done.summary["three_d"] = summary
        done.files += write_resolved(folder, resolved)
        write_bytes(folder / SEEN, shear_figure(resolved.mesh, resolved.steady.wall_shear))
        write_bytes(folder / PRESSURE, pressure_figure(resolved.steady.field))
        write_bytes(folder / STREAMLINES, streamline_figure(resolved.steady.field))
        done.files += [SEEN, PRESSURE, STREAMLINES]
    if case.part.compare is not None and (resolved is not None or case.part.one_d is not None):
        compared = _compared(case, case.part.compare, resolved, tell)
        done.summary["comparison"] = comparison_summary(compared)
        if case.pulse is not None and case.part.three_d is not None:
            steps = stepping_of(case.part.three_d, case.pulse).steps
            error = pulse_error(case.pulse, steps)
            done.summary["three_d"] |= {"steps": steps, "estimated_pulse_error": error}
            if error:
                done.notes.append(
                    f"3D took {steps} steps a cycle; by that the pressure swing at Windkessels is "
                    f"{100 * error:+.1f} % off (estimated)"
                )
        done.files.append(write_comparison(folder, compared))
        write_bytes(folder / COMPARED, comparison_figure(compared.line()))
        done.files.append(COMPARED)
    return done


def _compared(case: Case, part: ComparePart, resolved: FlowInMesh | None, tell: Tell) -> Comparison:
    probes, _ = places(case.network, part)
    if case.pulse is None:
        others = {} if resolved is None else {"3D": _steady_at(resolved, probes)}
        return steady_comparison(case.network, case.steady, part, others)
    waves = _waves(case, case.pulse, probes, resolved, tell)
    # At the times of the slowest to solve; the others know theirs at more.
    times = waves["3D" if "3D" in waves else "1D"].time_s
    return pulsatile_comparison(case.network, case.pulse, part, waves, times)


def _waves(
    case: Case,
    conditions: PulsatileConditions,
    probes: Probes,
    resolved: FlowInMesh | None,
    tell: Tell,
) -> dict[str, ProbeWaves]:
    waves: dict[str, ProbeWaves] = {}
    if case.part.one_d is not None and case.part.pulse is not None:
        tell(0.0, "1D, at the places compared")
        options = replace(one_d_options(case.part.one_d, case.part.pulse.steps), probes=probes)
        solved = solve_one_d(case.network, conditions, options).probes
        if solved is not None:
            waves["1D"] = solved
    if resolved is not None and case.part.three_d is not None:
        tell(0.0, "3D, in pulses")
        waves["3D"] = pulse_at(resolved, conditions, case.part.three_d, probes)
    return waves


def _steady_at(resolved: FlowInMesh, probes: Probes) -> ProbeWaves:
    """Pressure at probes, and the flow of their vessels: a section amid a fork isn't one's own."""
    at = probe_steady(resolved.network, probes, resolved.steady.field)
    return replace(at, flow=resolved.flow[probes.vessel, None])


def _reduced_summary(
    network: VesselNetwork, conditions: FlowConditions, solution: ThreeDSolution
) -> dict[str, Any]:
    """How far 0D is from 3D, with the network's radii and with those that 3D behaves as.

    Raises
    ------
    FlowError
        As `effective_network`.
    """
    effective = effective_network(network, conditions, solution)
    ratio = effective.resistance / effective.nominal
    summary: dict[str, Any] = {
        "resistance_over_nominal_least": float(ratio.min()),
        "resistance_over_nominal_most": float(ratio.max()),
    }
    for name, each in (("nominal", network), ("effective", effective.network)):
        off = flow_error(each, conditions, effective)
        summary[f"{name}_flow_off_percent_of_inlet"] = 100.0 * off.flow
        summary[f"{name}_pressure_off_percent_of_drop"] = 100.0 * off.pressure
    return summary
