"""3D flow on several processors by MPI: write a case folder, and read the result from it."""

from __future__ import annotations

import hashlib
import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, Literal

import numpy as np

from design.errors import FlowError
from design.files import atomic_replacement, write_bytes, write_text
from design.hemodynamics.conditions import FlowConditions
from design.hemodynamics.fluids import require_above_zero
from design.hemodynamics.three_d.engine import engine_mesh, running_engine
from design.hemodynamics.three_d.meshing.lumen_mesh import LumenMesh
from design.hemodynamics.three_d.newton import spaces
from design.hemodynamics.three_d.ports import PortPlan, steady_plan, unit_profile
from design.hemodynamics.three_d.solution import at_points, field_of
from design.hemodynamics.three_d.steady import mean, mean_laws
from kernels.arrays import FloatArray

ENGINE: Final = Path(__file__).with_name("rank_engine.py")
"""The solver, which needs FEniCSx and imports nothing of printctl."""
RESULTS: Final = ("ranks.json", "velocity.npy", "pressure.npy")


@dataclass(frozen=True)
class RankOptions:
    """Options of the solver on ranks.

    Attributes
    ----------
    model : {"stokes", "navier_stokes"}
    solver : {"auto", "direct", "iterative"}
        MUMPS, or multigrid in a Krylov method; by the number of unknowns.
    tolerance : float
        Residual left, over that of the given velocities.
    """

    model: Literal["stokes", "navier_stokes"] = "navier_stokes"
    solver: Literal["auto", "direct", "iterative"] = "auto"
    tolerance: float = 1e-9

    def __post_init__(self) -> None:
        require_above_zero("tolerance", self.tolerance, "")


def write_case(
    mesh: LumenMesh,
    conditions: FlowConditions,
    folder: Path,
    options: RankOptions | None = None,
) -> None:
    """Write a steady case and its solver: a folder that can be copied to a cluster.

    `case.json`, `points.npy`, `tets.npy`, `faces.npy`, `label.npy`, `inflow.npy` (velocities at
    the port of given flow, mm/s) and `engine.py`. Results of an earlier case are removed.

    A given flow has a profile where there is one inlet; several share a pressure. An outlet of
    given flow has a pressure of its own.

    Raises
    ------
    FlowError
        As `steady_plan`; an inlet without a face or a node inside its rim; the extra isn't
        installed.
    OSError
        When a file can't be written.
    """
    plan = steady_plan(mesh, conditions, conditions.density)
    arrays: dict[str, Any] = {
        "points": mesh.points.astype(np.float64),
        "tets": mesh.tets.astype(np.int64),
        "faces": mesh.faces.astype(np.int64),
        "label": mesh.label.astype(np.int32),
        "inflow": _inflow(mesh, plan),
    }
    facts = _case_facts(mesh, plan, options or RankOptions())
    facts["id"] = _digest(facts, arrays)
    folder.mkdir(parents=True, exist_ok=True)
    for left in RESULTS:
        (folder / left).unlink(missing_ok=True)
    for name, values in arrays.items():
        with atomic_replacement(folder / f"{name}.npy") as draft:
            np.save(draft, values)
    write_bytes(folder / "engine.py", ENGINE.read_bytes())
    write_text(folder / "case.json", json.dumps(facts, indent=1) + "\n")


def _case_facts(mesh: LumenMesh, plan: PortPlan, options: RankOptions) -> dict[str, Any]:
    """Return ports, and groups of ports of one unknown pressure p with Q - D p = s outward."""
    pressure = {port: mean(waveform) for port, waveform in plan.held}
    slope, given = mean_laws(plan.coupled)
    # Resistances in the ports' order, the inlets' common supply, outlets of given flow.
    order = sorted(
        range(len(plan.coupled)),
        key=lambda k: (slope[k] == 0.0, len(plan.coupled[k].ports) == 1, plan.coupled[k].ports),
    )
    return {
        "units": "mm, s, Pa, µL",
        "nodes": len(mesh.points),
        "corners": mesh.corner_count,
        "model": options.model,
        "viscosity_pa_s": plan.viscosity_pa_s,
        "density": plan.density,
        "solver": options.solver,
        "tolerance": options.tolerance,
        "ports": [
            {
                "label": k + 1,
                "node": port.node,
                "outlet": k in plan.outlets,
                "kind": "profile" if k == plan.inflow else "open",
                "pressure_pa": pressure.get(k, 0.0),
            }
            for k, port in enumerate(mesh.ports)
        ],
        "groups": [
            {
                "ports": list(plan.coupled[k].ports),
                "slope": float(slope[k]),
                "given": float(given[k]),
            }
            for k in order
        ],
    }


def _inflow(mesh: LumenMesh, plan: PortPlan) -> FloatArray:
    """Return the developed profile's velocities at the mesh's nodes (n + e, 3), mm/s."""
    velocity = np.zeros((len(mesh.points), 3))
    if plan.inflow is None:
        return velocity
    with running_engine() as ng:
        room = spaces(ng, engine_mesh(ng, mesh), len(mesh.ports), 2, plan.inflow)
        field = field_of(room, mesh, mean(plan.flow) * unit_profile(room, mesh, plan.inflow))
    # NGSolve's hierarchical functions of the port's corners go on into the edges behind it.
    node = np.unique(mesh.faces[mesh.label == plan.inflow + 1])
    velocity[node] = at_points(mesh, field.velocity, field.order)[node]
    return velocity


def _digest(facts: dict[str, Any], arrays: dict[str, Any]) -> str:
    """Name a case by its content, so that a result can't be taken for another's."""
    digest = hashlib.sha256(json.dumps(facts, sort_keys=True).encode())
    for name in sorted(arrays):
        digest.update(np.ascontiguousarray(arrays[name]).tobytes())
    return digest.hexdigest()[:16]


@dataclass(frozen=True)
class RankResult:
    """Result of a 3D flow solution on MPI ranks.

    Attributes
    ----------
    velocity : (n + e, 3) float64, mm/s
        At the mesh's nodes.
    pressure : (n,) float64, Pa
        At its corners.
    port_flow : (k,) float64, µL/s
        Out of each port.
    port_pressure : (k,) float64, Pa
        Its mean over each port.
    report : dict
        `ranks.json`: ranks, unknowns, solver, steps with residuals and iterations, seconds,
        memory of each rank.
    """

    velocity: FloatArray
    pressure: FloatArray
    port_flow: FloatArray
    port_pressure: FloatArray
    report: dict[str, Any]


def read_result(folder: Path) -> RankResult:
    """Read the result from a case's folder.

    Raises
    ------
    FlowError
        Where there is no result, or one of another case.
    """
    try:
        case = json.loads((folder / "case.json").read_text(encoding="utf-8"))
        report = json.loads((folder / "ranks.json").read_text(encoding="utf-8"))
        velocity, pressure = (np.load(folder / f"{x}.npy") for x in ("velocity", "pressure"))
    except FileNotFoundError as exc:
        raise FlowError(f"{exc.filename} isn't there: the case hasn't been solved; run it") from exc
    if report["case"] != case["id"]:
        raise FlowError(f"{folder}: the result is of another case; run it again")
    return RankResult(
        velocity,
        pressure,
        np.array([port["flow_out_ul_s"] for port in report["ports"]]),
        np.array([port["pressure_pa"] for port in report["ports"]]),
        report,
    )
