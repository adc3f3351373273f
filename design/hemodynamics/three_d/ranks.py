"""3D flow on several processors by MPI: write a case folder, and read the result from it."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, Literal

import numpy as np

from design.errors import FlowError
from design.files import atomic_replacement, write_bytes, write_text
from design.hemodynamics.conditions import FlowConditions, ResistanceOutlet
from design.hemodynamics.fluids import require_above_zero
from design.hemodynamics.three_d.engine import engine_mesh, engine_threads
from design.hemodynamics.three_d.meshing.lumen_mesh import LumenMesh
from design.hemodynamics.three_d.newton import spaces
from design.hemodynamics.three_d.ports import GivenFlow, steady_plan, unit_profile
from design.hemodynamics.three_d.solution import at_points, field_of
from design.units import WATER_DENSITY
from kernels.arrays import FloatArray

ENGINE: Final = Path(__file__).with_name("rank_engine.py")
"""The solver, which needs FEniCSx and imports nothing of printctl."""
RESULTS: Final = ("ranks.json", "velocity.npy", "pressure.npy")


@dataclass(frozen=True)
class PortFlow:
    """A velocity profile of a flow into the lumen, µL/s (below 0: out of it)."""

    flow_ul_s: float


@dataclass(frozen=True)
class PortShare:
    """One of the ports that share a supply's flow, and one pressure: which supply."""

    supply: int


@dataclass(frozen=True)
class PortPressure:
    """A pressure, Pa, and a resistance in front of it, Pa·s/µL (0: none)."""

    pressure_pa: float = 0.0
    resistance: float = 0.0


PortCondition = PortFlow | PortShare | PortPressure


@dataclass(frozen=True)
class RankConditions:
    """Conditions of a steady case on ranks.

    Attributes
    ----------
    ports : tuple of PortCondition
        One for each of the mesh's ports, in their order.
    viscosity_pa_s : float, Pa·s
    supplies : tuple of float, µL/s
        Flow into the lumen by all ports of each supply.
    density : float, Pa·s²/mm²
    model : {"stokes", "navier_stokes"}
    solver : {"auto", "direct", "iterative"}
        MUMPS, or multigrid in a Krylov method; by the number of unknowns.
    tolerance : float
        Of the residual, by that of the lift.
    """

    ports: tuple[PortCondition, ...]
    viscosity_pa_s: float
    supplies: tuple[float, ...] = ()
    density: float = WATER_DENSITY
    model: Literal["stokes", "navier_stokes"] = "navier_stokes"
    solver: Literal["auto", "direct", "iterative"] = "auto"
    tolerance: float = 1e-9

    def __post_init__(self) -> None:
        _check(self)


def write_case(mesh: LumenMesh, conditions: RankConditions, folder: Path) -> None:
    """Write a case and its solver: a folder that can be copied to a cluster.

    `case.json`, `points.npy`, `tets.npy`, `faces.npy`, `label.npy`, `inflow.npy` (velocities at
    ports of given flow, mm/s) and `engine.py`. Results of an earlier case are removed.

    Raises
    ------
    FlowError
        When conditions don't fit the mesh's ports, a port of given flow has no face or no node
        inside its rim, or the extra isn't installed.
    OSError
        When a file can't be written.
    """
    if len(conditions.ports) != len(mesh.ports):
        raise FlowError(
            f"{len(conditions.ports)} conditions for {len(mesh.ports)} ports; give one each"
        )
    driven = {k: x.flow_ul_s for k, x in enumerate(conditions.ports) if isinstance(x, PortFlow)}
    arrays: dict[str, Any] = {
        "points": mesh.points.astype(np.float64),
        "tets": mesh.tets.astype(np.int64),
        "faces": mesh.faces.astype(np.int64),
        "label": mesh.label.astype(np.int32),
        "inflow": port_velocities(mesh, driven),
    }
    facts = _case_facts(mesh, conditions)
    facts["id"] = _digest(facts, arrays)
    folder.mkdir(parents=True, exist_ok=True)
    for left in RESULTS:
        (folder / left).unlink(missing_ok=True)
    for name, values in arrays.items():
        with atomic_replacement(folder / f"{name}.npy") as draft:
            np.save(draft, values)
    write_bytes(folder / "engine.py", ENGINE.read_bytes())
    write_text(folder / "case.json", json.dumps(facts, indent=1) + "\n")


def _case_facts(mesh: LumenMesh, conditions: RankConditions) -> dict[str, Any]:
    return {
        "units": "mm, s, Pa, µL",
        "nodes": len(mesh.points),
        "corners": mesh.corner_count,
        "model": conditions.model,
        "viscosity_pa_s": conditions.viscosity_pa_s,
        "density": conditions.density,
        "solver": conditions.solver,
        "tolerance": conditions.tolerance,
        "ports": [
            {
                "label": k + 1,
                "node": mesh.ports[k].node,
                "outlet": not mesh.ports[k].inlet,
                "kind": "profile" if isinstance(given, PortFlow) else "open",
                # What holds whatever flows.
                "pressure_pa": given.pressure_pa
                if isinstance(given, PortPressure) and not given.resistance
                else 0.0,
            }
            for k, given in enumerate(conditions.ports)
        ],
        "groups": _groups(conditions),
    }


def _groups(conditions: RankConditions) -> list[dict[str, Any]]:
    """Ports of one unknown pressure p, and the law Q - D p = s of their flow Q outward."""
    groups = [
        {"ports": [k], "slope": 1.0 / x.resistance, "given": -x.pressure_pa / x.resistance}
        for k, x in enumerate(conditions.ports)
        if isinstance(x, PortPressure) and x.resistance
    ]
    for supply, flow in enumerate(conditions.supplies):
        ports = [k for k, x in enumerate(conditions.ports) if x == PortShare(supply)]
        groups.append({"ports": ports, "slope": 0.0, "given": -flow})
    return groups


def _digest(facts: dict[str, Any], arrays: dict[str, Any]) -> str:
    """Names a case by its content, so that a result can't be taken for another's."""
    digest = hashlib.sha256(json.dumps(facts, sort_keys=True).encode())
    for name in sorted(arrays):
        digest.update(np.ascontiguousarray(arrays[name]).tobytes())
    return digest.hexdigest()[:16]


def _check(conditions: RankConditions) -> None:
    for name, value, unit in (
        ("viscosity_pa_s", conditions.viscosity_pa_s, "Pa·s"),
        ("density", conditions.density, "Pa·s²/mm²"),
        ("tolerance", conditions.tolerance, ""),
    ):
        require_above_zero(name, value, unit)
    for port, given in enumerate(conditions.ports):
        _check_port(port, given, len(conditions.supplies))
    for supply, flow in enumerate(conditions.supplies):
        if not np.isfinite(flow) or PortShare(supply) not in conditions.ports:
            raise FlowError(
                f"supply {supply} of {flow} µL/s: give a number, and a port that has it"
            )
    if not any(isinstance(given, PortPressure) for given in conditions.ports):
        raise FlowError(
            "every port has a flow, so no pressure is determined; give one port a pressure"
        )


def _check_port(port: int, given: PortCondition, supplies: int) -> None:
    values = vars(given)
    for name, value in values.items():
        if not np.isfinite(value):
            raise FlowError(f"port {port}: {name} is {value}; give a number")
    if isinstance(given, PortShare) and not 0 <= given.supply < supplies:
        raise FlowError(f"port {port} is of supply {given.supply}, and there are {supplies}")
    if values.get("resistance", 0.0) < 0.0:
        raise FlowError(
            f"port {port}: resistance is {values['resistance']:g} Pa·s/µL; give 0 or more"
        )


def rank_conditions(mesh: LumenMesh, conditions: FlowConditions, **options: Any) -> RankConditions:
    """Conditions of every port, by its node: a network's own, at its lumen.

    A given flow has a profile where there is one inlet; several hang on one supply and share its
    pressure. An outlet of given flow has a pressure of its own.

    Parameters
    ----------
    mesh : LumenMesh
    conditions : FlowConditions
    **options
        Of `RankConditions`: density (the conditions' by default), model, solver, tolerance.

    Raises
    ------
    FlowError
        As `steady_plan`.
    """
    plan = steady_plan(mesh, conditions, conditions.density)
    at_rest = np.zeros(1)
    ports: dict[int, PortCondition] = {
        k: PortPressure(float(waveform.at(at_rest)[0])) for k, waveform in plan.held
    }
    if plan.inflow is not None:
        ports[plan.inflow] = PortFlow(float(plan.flow.at(at_rest)[0]))
    supplies: list[float] = []
    # The inlets' common supply first, then outlets in the ports' order.
    for group in sorted(plan.coupled, key=lambda each: (len(each.ports) == 1, each.ports)):
        if isinstance(group.law, GivenFlow):
            ports |= dict.fromkeys(group.ports, PortShare(len(supplies)))
            supplies.append(-group.law.factor * float(group.law.waveform.at(at_rest)[0]))
        elif isinstance(group.law, ResistanceOutlet):
            ports[group.ports[0]] = PortPressure(group.law.distal_pa, group.law.resistance)
    return RankConditions(
        tuple(ports[k] for k in range(len(mesh.ports))),
        conditions.viscosity_pa_s,
        tuple(supplies),
        **{"density": conditions.density, **options},
    )


def port_velocities(mesh: LumenMesh, flow_ul_s: Mapping[int, float]) -> FloatArray:
    """Developed velocities, mm/s, at the mesh's nodes (n + e, 3) that bring flows in by ports."""
    velocity = np.zeros((len(mesh.points), 3))
    if not flow_ul_s:
        return velocity
    with engine_threads() as ng:
        room = spaces(ng, engine_mesh(ng, mesh), len(mesh.ports), 2, None)
        for port, flow in flow_ul_s.items():
            field = field_of(room, mesh, flow * unit_profile(room, mesh, port))
            velocity += at_points(mesh, field.velocity, field.order)
    return velocity


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
    """Read what a run left in a case's folder.

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
