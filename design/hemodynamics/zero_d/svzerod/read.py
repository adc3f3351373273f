"""Read svZeroDSolver's JSON input as a circuit for the pulsatile 0D solver.

Vessels are R, then C to ground, then L (its `BloodVessel`); junctions join them without loss;
boundary conditions are FLOW, PRESSURE, RESISTANCE and RCR. Format: the project's documentation
and test cases (github.com/SimVascular/svZeroDSolver). What else a file may hold (chambers, valves,
coronaries, closed loops, stenoses) is refused by name.
"""

from __future__ import annotations

import json
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from design.errors import FlowError
from design.hemodynamics.waveforms import Constant, Tabulated, Waveform
from design.hemodynamics.zero_d.pulsatile.circuit import Circuit
from design.hemodynamics.zero_d.pulsatile.march import MarchOptions
from design.hemodynamics.zero_d.svzerod.case import SvZeroDCase
from design.network import IntArray

SPECTRAL_RADIUS = 0.5
"""What svZeroDSolver steps with."""

_JUNCTIONS = {"NORMAL_JUNCTION", "internal_junction"}
_FOREIGN = ("closed_loop_blocks", "chambers", "valves", "external_solver_coupling_blocks")


def read_svzerod(path: Path) -> SvZeroDCase:
    """Read a file.

    Raises
    ------
    FlowError
        When it isn't such a file, or asks for what isn't modelled here.
    OSError
        When it can't be read.
    """
    try:
        data = json.loads(path.read_text(encoding="utf-8"))
        return case_of(data)
    except FlowError as exc:
        raise FlowError(f"{path}: {exc}") from exc
    except ValueError as exc:
        raise FlowError(f"{path} isn't JSON: {exc}") from exc
    except (KeyError, TypeError, AttributeError, IndexError) as exc:
        raise FlowError(
            f"{path} isn't an input of svZeroDSolver: {type(exc).__name__} {exc}"
        ) from exc


def case_of(data: dict[str, Any]) -> SvZeroDCase:
    """The case that parsed JSON describes.

    Raises
    ------
    FlowError
        For what isn't modelled here.
    KeyError, TypeError
        For what has another form.
    """
    for key in _FOREIGN:
        if data.get(key):
            raise FlowError(f"{key} aren't modelled here; use svZeroDSolver for this file")
    vessels = data["vessels"]
    ports = _ports(vessels, data.get("junctions", []))
    values = np.array([_values(vessel) for vessel in vessels])
    conditions = {c["bc_name"]: c for c in data["boundary_conditions"]}
    more = _Ends(int(ports.max()) + 1)
    for k, vessel in enumerate(vessels):
        for side, name in vessel.get("boundary_conditions", {}).items():
            if name not in conditions:
                raise FlowError(f"vessel {_name(vessel)} has {side} {name!r}, which isn't given")
            more.add(int(ports[k, int(side == "outlet")]), conditions[name], side == "outlet")
    parameters = data.get("simulation_parameters", {})
    options = MarchOptions(
        steps=int(parameters["number_of_time_pts_per_cardiac_cycle"]) - 1,
        cycles=int(parameters.get("number_of_cardiac_cycles", 1)),
        tolerance=None,
        spectral_radius=SPECTRAL_RADIUS,
    )
    names = tuple(_name(vessel) for vessel in vessels)
    circuit = more.circuit(ports, values)
    return SvZeroDCase(names, circuit, options)


def _name(vessel: dict[str, Any]) -> str:
    return str(vessel.get("vessel_name", vessel["vessel_id"]))


def _values(vessel: dict[str, Any]) -> tuple[float, float, float]:
    """R, C and L of a vessel."""
    kind, given = vessel["zero_d_element_type"], vessel["zero_d_element_values"]
    if kind != "BloodVessel":
        raise FlowError(f"vessel {_name(vessel)} is a {kind}; only BloodVessel is modelled here")
    if float(given.get("stenosis_coefficient", 0.0)) != 0.0:
        raise FlowError(
            f"vessel {_name(vessel)} has a stenosis_coefficient, which makes the problem "
            "nonlinear; use svZeroDSolver for this file"
        )
    resistance, compliance, inertance = (given.get(key, 0.0) for key in ("R_poiseuille", "C", "L"))
    return float(resistance), float(compliance), float(inertance)


def _ports(vessels: list[dict[str, Any]], junctions: list[dict[str, Any]]) -> IntArray:
    """Node at either end of each vessel, (v, 2)."""
    number = {int(vessel["vessel_id"]): k for k, vessel in enumerate(vessels)}
    joined: list[tuple[int, int]] = []
    for junction in junctions:
        if junction["junction_type"] not in _JUNCTIONS:
            raise FlowError(
                f"junction {junction['junction_name']} is a {junction['junction_type']}; only "
                "junctions without losses are modelled here"
            )
        meeting = [2 * number[int(v)] + 1 for v in junction["inlet_vessels"]]
        meeting += [2 * number[int(v)] for v in junction["outlet_vessels"]]
        joined += pairwise(meeting)
    first, last = np.array(joined, dtype=np.int64).reshape(-1, 2).T
    size = 2 * len(vessels)
    graph = coo_array((np.ones(len(first), dtype=np.int8), (first, last)), shape=(size, size))
    _, node = connected_components(graph, directed=False)
    return np.asarray(node, dtype=np.int64).reshape(-1, 2)


class _Ends:
    """Nodes and branches that boundary conditions add."""

    def __init__(self, nodes: int) -> None:
        self.nodes = nodes
        self.branches: list[tuple[int, int, float]] = []
        self.stored: dict[int, float] = {}
        self.held: list[int] = []
        self.drive: dict[int, int] = {}
        self.waveforms: list[Waveform] = []

    def add(self, node: int, condition: dict[str, Any], outlet: bool) -> None:
        kind, given, name = condition["bc_type"], condition["bc_values"], condition["bc_name"]
        if kind == "FLOW":
            # Positive in the vessel's direction: out of the network at an outlet.
            self._push(node, _waveform(name, given["t"], given["Q"], -1.0 if outlet else 1.0))
        elif kind == "PRESSURE":
            self._hold(node, _waveform(name, given["t"], given["P"], 1.0))
        elif kind == "RESISTANCE":
            self._to(node, _one(name, given["R"]), _one(name, given.get("Pd", 0.0)))
        elif kind == "RCR":
            middle = self._new()
            self.stored[middle] = _one(name, given["C"])
            self.branches.append((node, middle, _one(name, given["Rp"])))
            self._to(middle, _one(name, given["Rd"]), _one(name, given.get("Pd", 0.0)))
        else:
            raise FlowError(f"boundary condition {name} is a {kind}, which isn't modelled here")

    def circuit(self, ports: IntArray, values: Any) -> Circuit:
        ends = np.array([(a, b) for a, b, _ in self.branches], dtype=np.int64).reshape(-1, 2)
        stored, drive = np.zeros(self.nodes), np.full(self.nodes, -1)
        stored[list(self.stored)] = list(self.stored.values())
        drive[list(self.drive)] = list(self.drive.values())
        held = np.zeros(self.nodes, dtype=bool)
        held[self.held] = True
        bare = np.zeros(len(ends))
        return Circuit(
            first=np.concatenate([ports[:, 0], ends[:, 0]]),
            last=np.concatenate([ports[:, 1], ends[:, 1]]),
            resistance=np.concatenate([values[:, 0], [r for _, _, r in self.branches]]),
            inertance=np.concatenate([values[:, 2], bare]),
            capacitance=np.concatenate([values[:, 1], bare]),
            stored=stored,
            held=held,
            drive=drive,
            waveforms=tuple(self.waveforms),
            middle=True,
        )

    def _new(self) -> int:
        self.nodes += 1
        return self.nodes - 1

    def _push(self, node: int, waveform: Waveform) -> None:
        self.drive[node] = len(self.waveforms)
        self.waveforms.append(waveform)

    def _hold(self, node: int, waveform: Waveform) -> None:
        self.held.append(node)
        self._push(node, waveform)

    def _to(self, node: int, resistance: float, distal: float) -> None:
        far = self._new()
        self.branches.append((node, far, resistance))
        self._hold(far, Constant(distal))


def _waveform(name: str, time: Any, value: Any, sign: float) -> Waveform:
    times, values = np.atleast_1d(np.array(time, float)), np.atleast_1d(np.array(value, float))
    if len(values) and np.ptp(values) == 0.0:
        return Constant(sign * float(values[0]))
    try:
        return Tabulated(times, sign * values)
    except FlowError as exc:
        raise FlowError(f"boundary condition {name}: {exc}") from exc


def _one(name: str, value: Any) -> float:
    values = np.atleast_1d(np.array(value, dtype=float))
    if len(values) != 1:
        raise FlowError(
            f"boundary condition {name} changes a resistance or compliance over time, which "
            "isn't modelled here"
        )
    return float(values[0])
