"""Mesh a network's lumens; solve steady or pulsatile 3D flow; write the steady result."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
from scipy.spatial import cKDTree

from design.hemodynamics import FlowConditions, PulsatileConditions
from design.hemodynamics.probes import Probes, ProbeWaves, midpoints
from design.hemodynamics.three_d import (
    FlowOptions,
    LumenMesh,
    ResidenceTime,
    Stepping,
    ThreeDSolution,
    at_points,
    estimate_error,
    face_mean,
    march_flow,
    probe_steady,
    residence_time,
    sections_at,
    shear_of_faces,
    solve_steady,
    straighten_edges,
    write_flow_vtu,
)
from design.hemodynamics.three_d.meshing.mesh import MeshOptions, lumen_mesh
from design.hemodynamics.three_d.meshing.surface import axis_places
from design.hemodynamics.three_d.time_steps import needed_steps
from design.hemodynamics.three_d.vessels.sections import clear_sections, conserve_mass, vessel_flows
from design.network import VesselNetwork
from design.units import DYN_CM2_PER_PA, PA_PER_MMHG, UL_S_PER_ML_MIN
from kernels.arrays import FloatArray
from printctl.analysis.flow.tables import write_columns
from printctl.recipe.parts import ThreeDPart

THREE_D, FIELD = "flow_3d.csv", "flow_3d.vtu"
SHARP: Final = 0.1
"""Fillet ratio where the recipe's solid has sharp seams: a seam has no wall shear of its own."""

_APART: Final = 0.5
"""Radii between places on an axis: more, and a node's nearest is another vessel's."""

Tell = Callable[[float, str], None]


@dataclass(frozen=True)
class FlowInMesh:
    """A network's lumens, meshed, the steady flow in them (by vessel, too), and the fluid's age."""

    network: VesselNetwork
    mesh: LumenMesh
    steady: ThreeDSolution
    flow: FloatArray
    ages: ResidenceTime


def resolve(
    network: VesselNetwork,
    conditions: FlowConditions | PulsatileConditions,
    part: ThreeDPart,
    fillet_ratio: float,
    tell: Tell,
) -> tuple[FlowInMesh, dict[str, Any]]:
    """Mesh the lumens, solve the steady flow; summary.

    Raises
    ------
    FlowError
        As `lumen_mesh` and `solve_steady`.
    SolidError
        As `lumen_mesh`.
    """
    tell(0.0, "meshing")
    shape = MeshOptions(edge_ratio=part.edge_ratio, fillet_ratio=max(fillet_ratio, SHARP))
    mesh, bent_back = straighten_edges(lumen_mesh(network, shape))
    tell(0.3, f"{len(mesh.tets):,} elements")
    options = options_of(part, conditions.density)
    solution = solve_steady(mesh, conditions, options)
    ages = residence_time(solution)
    flow = vessel_flows(network, solution)
    summary: dict[str, Any] = {
        "elements": len(mesh.tets),
        "straightened_elements": bent_back,
        "unknowns": solution.unknowns,
        "order": part.order,
        "pressure_drop_mmhg": float(np.ptp(solution.port_pressure)) / PA_PER_MMHG,
        "largest_reynolds": float(solution.reynolds.max()),
        "mass_imbalance": solution.mass_imbalance,
        "energy_imbalance": solution.energy.imbalance,
        "volume_ul": ages.volume_ul,
        "mean_residence_s": ages.mean_s,
        "vessels_without_flow": np.flatnonzero(np.isnan(flow)).tolist(),
        "wall_shear_median_dyn_cm2": _median_shear(solution) * DYN_CM2_PER_PA,
    }
    if part.check:
        tell(0.7, "again, of another order")
        error = estimate_error(mesh, conditions, solution, options)
        summary["estimated_error"] = {
            "pressure": error.pressure, "flow": error.flow, "wall_shear": error.wall_shear
        }  # fmt: skip
    tell(1.0, "")
    return FlowInMesh(network, mesh, solution, flow, ages), summary


def options_of(part: ThreeDPart, density: float) -> FlowOptions:
    """A recipe's words as options; ``density`` in Pa·s²/mm²."""
    return FlowOptions(
        order=part.order, convection=part.inertia, memory_gb=part.memory_gb, density=density
    )


def stepping_of(part: ThreeDPart, conditions: PulsatileConditions) -> Stepping:
    """A recipe's steps, or as many as the Windkessels need, and cycles."""
    return Stepping(steps=part.steps or needed_steps(conditions), cycles=part.most_cycles)


def write_resolved(folder: Path, resolved: FlowInMesh) -> tuple[str, str]:
    """Write `THREE_D`, a row a vessel, and `FIELD` for ParaView; their names.

    Raises
    ------
    OSError
        When a file can't be written.
    """
    folder.mkdir(parents=True, exist_ok=True)
    write_columns(folder / THREE_D, vessel_table(resolved))
    age = at_points(resolved.mesh, resolved.ages.age[..., None], 2)[:, 0]
    more = {"residence_time_s": age}
    write_flow_vtu(folder / FIELD, resolved.steady.field, resolved.steady.wall_shear, more)
    return THREE_D, FIELD


def vessel_table(resolved: FlowInMesh) -> dict[str, Any]:
    """Flow and pressure amid each vessel, and wall shear on its wall."""
    amid = probe_steady(resolved.network, midpoints(resolved.network), resolved.steady.field)
    mean, most = wall_shear_of_vessels(resolved.network, resolved.steady)
    return {
        "vessel": np.arange(resolved.network.vessel_count),
        "flow_ml_min": resolved.flow / UL_S_PER_ML_MIN,
        "pressure_mmhg": amid.pressure[:, 0] / PA_PER_MMHG,
        "wall_shear_mean_dyn_cm2": mean * DYN_CM2_PER_PA,
        "wall_shear_max_dyn_cm2": most * DYN_CM2_PER_PA,
    }


def wall_shear_of_vessels(
    network: VesselNetwork, solution: ThreeDSolution
) -> tuple[FloatArray, FloatArray]:
    """Mean over the area and greatest wall shear on each vessel's wall, (v,), Pa; NaN without one.

    A triangle of the wall belongs to the vessel whose axis is nearest to its middle, in radii.
    """
    middle, area, size = shear_of_faces(solution)
    axis, apart, owner = axis_places(network, _APART)
    radius = apart / _APART
    away, near = cKDTree(axis).query(middle, k=min(32, len(axis)))
    away, near = away.reshape(len(middle), -1), near.reshape(len(middle), -1)
    best = np.argmin(away / radius[near], axis=1)
    mine = owner[near[np.arange(len(near)), best]]
    count = network.vessel_count
    most = np.full(count, np.nan)
    np.fmax.at(most, mine, size.max(axis=1))
    areas = np.bincount(mine, area, minlength=count)
    with np.errstate(invalid="ignore"):
        mean = np.bincount(mine, area * face_mean(size), minlength=count)
        return mean / np.where(areas > 0.0, areas, np.nan), most


def _median_shear(solution: ThreeDSolution) -> float:
    """Wall shear that half of the wall's area exceeds, Pa."""
    _, area, size = shear_of_faces(solution)
    mean = face_mean(size)
    order = np.argsort(mean)
    covered = np.cumsum(area[order])
    return float(mean[order][np.searchsorted(covered, 0.5 * covered[-1])])


def pulse_at(
    resolved: FlowInMesh,
    conditions: PulsatileConditions,
    part: ThreeDPart,
    probes: Probes,
) -> ProbeWaves:
    """A cycle of pulsatile flow in the mesh: pressure at probes, and the flow of their vessels.

    Raises
    ------
    FlowError
        As `march_flow`.
    """
    places = sections_at(resolved.network, probes, resolved.mesh, part.order)
    own = clear_sections(resolved.network, resolved.mesh, part.order)
    clear = np.array([section is not None for section in own])
    sections = [*places, *(section for section in own if section is not None)]
    waves = march_flow(
        resolved.mesh,
        conditions,
        options_of(part, conditions.density),
        stepping_of(part, conditions),
        sections,
    )
    through = np.full((len(own), len(waves.time_s)), np.nan)
    through[clear] = waves.section_flow[len(places) :]
    flow = conserve_mass(resolved.network, through, resolved.mesh.ports, waves.port_flow)
    return ProbeWaves(waves.time_s, waves.section_pressure[: len(places)], flow[probes.vessel])
