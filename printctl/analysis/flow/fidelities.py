"""Solve 3D flow and compare 0D, 1D and 3D results, as a recipe's flow section asks."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from design.files import write_bytes
from design.hemodynamics import FlowConditions, PulsatileConditions, solve_one_d
from design.hemodynamics.probes import Probes, ProbeWaves
from design.hemodynamics.three_d import check_cycles, probe_steady
from design.network import VesselNetwork
from printctl.analysis.flow.comparison import (
    Comparison,
    comparison_summary,
    places,
    pulsatile_comparison,
    steady_comparison,
    write_comparison,
)
from printctl.analysis.flow.match import reduced_summary
from printctl.analysis.flow.one_d import one_d_options
from printctl.analysis.flow.three_d import (
    FlowInMesh,
    Tell,
    pulse_at,
    resolve,
    stepping_of,
    write_resolved,
)
from printctl.recipe.parts import ComparePart, FlowPart
from registration.report.flow_figures import comparison_figure
from registration.report.lumen_figure import pressure_figure, shear_figure, streamline_figure

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
    """Summary by fidelity, and the files written."""

    summary: dict[str, Any] = field(default_factory=dict)
    files: list[str] = field(default_factory=list)


def solve_fidelities(folder: Path, case: Case, tell: Tell) -> Outcome:
    """Resolve the flow in space and compare fidelities, as far as the section asks; write both.

    Raises
    ------
    FlowError, SolidError, OSError
        As `resolve`, `pulse_at`, `solve_one_d` and the writers.
    """
    done, resolved = Outcome(), None
    if case.pulse is not None and case.part.three_d is not None and case.part.compare is not None:
        check_cycles(case.network.radius.max(), case.pulse, stepping_of(case.part.three_d))
    if case.part.three_d is not None:
        driven = case.steady
        resolved, summary = resolve(
            case.network, driven, case.part.three_d, case.fillet_ratio, tell
        )
        summary["reduced"] = reduced_summary(case.network, driven, resolved.steady)
        done.summary["three_d"] = summary
        done.files += write_resolved(folder, resolved)
        write_bytes(folder / SEEN, shear_figure(resolved.mesh, resolved.steady.wall_shear))
        write_bytes(folder / PRESSURE, pressure_figure(resolved.steady.field))
        write_bytes(folder / STREAMLINES, streamline_figure(resolved.steady.field))
        done.files += [SEEN, PRESSURE, STREAMLINES]
    if case.part.compare is not None and (resolved is not None or case.part.one_d is not None):
        compared = _compared(case, case.part.compare, resolved, tell)
        done.summary["comparison"] = comparison_summary(compared)
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
