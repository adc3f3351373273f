"""Write the MPI flow solver's case folder: mesh, conditions, options, and the solver's code."""

from __future__ import annotations

import hashlib
import json
import shutil
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, Literal

import numpy as np
from scipy.sparse import coo_array, csc_array
from scipy.sparse.linalg import splu

from design.errors import FlowError
from design.files import atomic_replacement, write_bytes, write_text
from design.hemodynamics.conditions import FlowConditions, ResistanceOutlet
from design.hemodynamics.fluids import require_above_zero
from design.hemodynamics.three_d.meshing.lumen_mesh import WALL, LumenMesh
from design.hemodynamics.three_d.ports import GivenFlow, steady_plan
from design.units import WATER_DENSITY
from kernels.arrays import FloatArray, IntArray

ENGINE: Final = Path(__file__).parent / "engine"
"""The engine's own package, which needs FEniCSx and nothing of ours."""
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


# Compute velocities at a port's mesh nodes for a given flow (developed or parabola).

Profile = Literal["developed", "parabola"]


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
    profile : {"developed", "parabola"}
        Of given flows; see `port_velocity`.
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
    profile: Profile = "developed"
    solver: Literal["auto", "direct", "iterative"] = "auto"
    tolerance: float = 1e-9

    def __post_init__(self) -> None:
        _check(self)


def write_case(mesh: LumenMesh, conditions: RankConditions, folder: Path) -> None:
    """Write a case and the engine beside it: a folder that can be copied to a cluster.

    `case.json`, `points.npy`, `tets.npy`, `faces.npy`, `label.npy`, `inflow.npy` (velocities at
    ports of given flow, mm/s) and `engine/`. What an earlier case left as results is removed.

    Raises
    ------
    FlowError
        When conditions don't fit the mesh's ports.
    OSError
        When a file can't be written.
    """
    if len(conditions.ports) != len(mesh.ports):
        raise FlowError(
            f"{len(conditions.ports)} conditions for {len(mesh.ports)} ports; give one each"
        )
    inflow = np.zeros((len(mesh.points), 3))
    for port, given in enumerate(conditions.ports):
        if isinstance(given, PortFlow):
            inflow += port_velocity(mesh, port, given.flow_ul_s, conditions.profile)
    arrays: dict[str, Any] = {
        "points": mesh.points.astype(np.float64),
        "tets": mesh.tets.astype(np.int64),
        "faces": mesh.faces.astype(np.int64),
        "label": mesh.label.astype(np.int32),
        "inflow": inflow,
    }
    facts = _case_facts(mesh, conditions)
    facts["id"] = _digest(facts, arrays)
    folder.mkdir(parents=True, exist_ok=True)
    for left in RESULTS:
        (folder / left).unlink(missing_ok=True)
    for name, values in arrays.items():
        with atomic_replacement(folder / f"{name}.npy") as draft:
            np.save(draft, values)
    for source in sorted(ENGINE.glob("*.py")):
        write_bytes(folder / "engine" / source.name, source.read_bytes())
    shutil.rmtree(folder / "engine" / "__pycache__", ignore_errors=True)
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
                "pressure_pa": _held(given),
            }
            for k, given in enumerate(conditions.ports)
        ],
        "groups": _groups(conditions),
    }


def _held(given: PortCondition) -> float:
    """Pressure that holds whatever flows."""
    return given.pressure_pa if isinstance(given, PortPressure) and not given.resistance else 0.0


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


# Translate a network's steady flow conditions to port conditions of the MPI flow solver.


def rank_conditions(mesh: LumenMesh, conditions: FlowConditions, **options: Any) -> RankConditions:
    """Conditions of every port, by its node: a network's own, at its lumen.

    A given flow has a profile where there is one inlet; several hang on one supply and share its
    pressure. An outlet of given flow has a pressure of its own.

    Parameters
    ----------
    mesh : LumenMesh
    conditions : FlowConditions
    **options
        Of `RankConditions`: density (the conditions' by default), model, profile, solver,
        tolerance.

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


# Dunavant 1985 (doi 10.1002/nme.1620210612), degree 5 on the triangle; weights sum up to 1/2.
_A, _B = (6.0 - np.sqrt(15.0)) / 21.0, (6.0 + np.sqrt(15.0)) / 21.0
_POINTS: Final = np.array([[1 / 3, 1 / 3], *([[a, a], [1 - 2 * a, a], [a, 1 - 2 * a]][k]
                                             for a in (_A, _B) for k in range(3))])  # fmt: skip
_WEIGHTS: Final = np.array(
    [9 / 80, *[(155 - np.sqrt(15.0)) / 2400] * 3, *[(155 + np.sqrt(15.0)) / 2400] * 3]
)


def port_velocity(mesh: LumenMesh, port: int, flow_ul_s: float, profile: Profile) -> FloatArray:
    """Velocity at a port's nodes that brings ``flow_ul_s`` into the lumen; 0 elsewhere.

    ``developed`` is the steady flow in a straight duct of the port's own shape, -Δw = 1 with
    w = 0 at its rim, by the port's quadratic triangles; in a circle it is the parabola.
    ``parabola`` is 1 - (r/R)² about the port's centre. Both are scaled so that the triangles'
    own integral is the flow.

    Returns
    -------
    (n + e, 3) float64, mm/s

    Raises
    ------
    FlowError
        When the port has no faces, or no node off the wall: the mesh is too coarse there.
    """
    faces, inner = _inner_nodes(mesh, port)
    if profile == "developed":
        shape = _duct(mesh.points, faces, inner)
    else:
        shape = np.zeros(len(mesh.points))
        opening = mesh.ports[port]
        radius = np.linalg.norm(mesh.points[inner] - opening.centre, axis=1)
        shape[inner] = np.maximum(1.0 - (radius / opening.radius_mm) ** 2, 0.0)
    jacobian, values, _ = _at_quadrature(mesh.points, faces)
    through = float(np.einsum("q,fq,qi,fi->", _WEIGHTS, jacobian, values, shape[faces]))
    speed = flow_ul_s / through * shape
    return -speed[:, None] * mesh.ports[port].outward


def _inner_nodes(mesh: LumenMesh, port: int) -> tuple[IntArray, IntArray]:
    faces = mesh.faces[mesh.label == port + 1]
    if len(faces) == 0:
        raise FlowError(f"port {port} has no faces (label {port + 1}); mesh the lumen again")
    inner = np.setdiff1d(faces, mesh.faces[mesh.label == WALL])
    if len(inner) == 0:
        raise FlowError(
            f"port {port} has no node off the wall, so no flow can pass it; mesh it finer"
        )
    return faces, inner


def _duct(points: FloatArray, faces: IntArray, inner: IntArray) -> FloatArray:
    """Solution of -Δw = 1, w = 0 but at ``inner``, per node of ``points``."""
    jacobian, values, gradient = _at_quadrature(points, faces)
    local = np.einsum("q,fq,fqix,fqjx->fij", _WEIGHTS, jacobian, gradient, gradient)
    load = np.einsum("q,fq,qi->fi", _WEIGHTS, jacobian, values)
    slot = np.full(len(points), -1)
    slot[inner] = np.arange(len(inner))
    at = slot[faces]
    row, column = np.repeat(at, 6, axis=1).ravel(), np.tile(at, 6).ravel()
    both = (row >= 0) & (column >= 0)
    size = (len(inner), len(inner))
    matrix = csc_array(coo_array((local.ravel()[both], (row[both], column[both])), shape=size))
    right = np.zeros(len(inner))
    np.add.at(right, at[at >= 0], load[at >= 0])
    velocity = np.zeros(len(points))
    velocity[inner] = splu(matrix).solve(right)
    return velocity


def _at_quadrature(
    points: FloatArray, faces: IntArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Area elements (f, q), shape functions (q, 6), their gradients along the face (f, q, 6, 3)."""
    values, slopes = _shapes(_POINTS)
    tangent = np.einsum("qia,fix->fqax", slopes, points[faces])
    metric = np.einsum("fqax,fqbx->fqab", tangent, tangent)
    gradient = np.einsum("qia,fqab,fqbx->fqix", slopes, np.linalg.inv(metric), tangent)
    return np.sqrt(np.linalg.det(metric)), values, gradient


def _shapes(at: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Quadratic shape functions (q, 6) and slopes (q, 6, 2), in the order of a mesh's faces."""
    s, t = at.T
    r = 1.0 - s - t
    values = [r * (2 * r - 1), s * (2 * s - 1), t * (2 * t - 1), 4 * r * s, 4 * s * t, 4 * t * r]
    zero = np.zeros_like(s)
    by_s = [1 - 4 * r, 4 * s - 1, zero, 4 * (r - s), 4 * t, -4 * t]
    by_t = [1 - 4 * r, zero, 4 * t - 1, -4 * s, 4 * s, 4 * (r - t)]
    return np.stack(values, 1), np.stack([np.stack(by_s, 1), np.stack(by_t, 1)], 2)


# Read the result files of the MPI flow solver from a case folder.


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
