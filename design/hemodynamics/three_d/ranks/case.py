"""Write the MPI flow solver's case folder: mesh, conditions, options, and the solver's code."""

from __future__ import annotations

import hashlib
import json
import shutil
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, Literal

import numpy as np

from design.errors import FlowError
from design.files import atomic_replacement, write_bytes, write_text
from design.hemodynamics.three_d.lumen_mesh import LumenMesh
from design.hemodynamics.three_d.ranks.profile import Profile, port_velocity
from design.units import WATER_DENSITY

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
        if not (np.isfinite(value) and value > 0.0):
            raise FlowError(f"{name} is {value:g} {unit}; give a number above 0".replace(" ;", ";"))
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
