"""Write a lumen mesh with pulsatile conditions as a svMultiPhysics case, in cm, g, s.

svMultiPhysics (before: svFSIplus) knows no units; SimVascular's cases are in cm, g, s, where a
pressure is in dyn/cm², and its tolerances are made for such numbers.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final
from xml.etree import ElementTree

import numpy as np
from numpy.typing import NDArray

from design.errors import FlowError
from design.files import write_text
from design.geometry.vtk import vtk_document
from design.hemodynamics.conditions import (
    Outlet,
    PressureOutlet,
    PulsatileConditions,
    ResistanceOutlet,
)
from design.hemodynamics.other_solvers.network_case import CGS, outlet_values
from design.hemodynamics.three_d.meshing.lumen_mesh import (
    WALL,
    LumenMesh,
    jacobian,
    quadratic,
    tetrahedron_rule,
)
from design.hemodynamics.three_d.solution import elements_behind
from design.hemodynamics.waveforms import Waveform, cycle_times
from design.hemodynamics.zero_d.boundary import refuse_supplies
from design.units import CM3_PER_UL, DYN_CM2_PER_PA
from kernels.arrays import FloatArray, IntArray

_MODES: Final = 16
"""Fourier modes that the solver takes of a waveform's 201 samples."""
Fields = dict[str, Any]
_EQUATION: Final[Fields] = {
    "Coupled": True,
    "Min_iterations": 3,
    "Max_iterations": 12,
    "Tolerance": 1e-9,
    "Backflow_stabilization_coefficient": 0.2,
}
_LINEAR_SOLVER: Final[Fields] = {
    "Max_iterations": 15,
    "NS_GM_max_iterations": 10,
    "NS_CG_max_iterations": 300,
    "Tolerance": 1e-3,
    "NS_GM_tolerance": 1e-3,
    "NS_CG_tolerance": 1e-3,
    "Absolute_tolerance": 1e-17,
    "Krylov_space_dimension": 250,
}


@dataclass(frozen=True)
class MarchSteps:
    """Time stepping options written to svMultiPhysics' input.

    Attributes
    ----------
    per_cycle : int
        Steps of a cycle (of a second, where nothing pulses).
    cycles : int
    inlet_share : mapping of port to float
        Of the flow, where there are several inlets; adds up to 1.
    """

    per_cycle: int = 1000
    cycles: int = 3
    inlet_share: Mapping[int, float] | None = None


def write_svmultiphysics(
    folder: Path, mesh: LumenMesh, conditions: PulsatileConditions, steps: MarchSteps | None = None
) -> None:
    """Write `solver.xml`, `mesh-complete/` (see `write_mesh_complete`) and waveforms.

    Walls are rigid. A given flow comes in with a parabolic profile; ``name.flow`` holds it, below
    0 as it goes against the outward normal, and 16 Fourier modes are taken of it. Outlets by
    node of their port: pressure, resistance (to pressure 0), Windkessel (RCR).

    Raises
    ------
    FlowError
        What its input can't express: a resistance to another pressure than 0, several inlets
        on one flow without ``inlet_share``, a port without an outlet's condition.
    OSError
        When a file can't be written.
    """
    refuse_supplies(conditions.supplies, "svMultiPhysics")
    steps = steps or MarchSteps()
    period = conditions.inlet.period_s or 1.0
    files: dict[str, str] = {}
    shares = _shares(mesh, conditions, steps)
    root = ElementTree.Element("svMultiPhysicsFile", version="0.1")
    root.append(ElementTree.Comment(" cm, g, s: pressure in dyn/cm2, flow in cm3/s "))
    _fill(root, "GeneralSimulationParameters", _general(steps, period))
    _add_mesh(root, mesh)
    fluid = {
        "Density": conditions.density * CGS.g_cm3_per_pa_s2_mm2,
        "Viscosity": {"Value": conditions.viscosity_pa_s * CGS.poise_per_pa_s},
    }
    equation = _fill(root, "Add_equation", _EQUATION | fluid, type="fluid")
    _add_numerics(equation)
    for k, port in enumerate(mesh.ports):
        name = face_name(mesh, k + 1)
        if port.inlet:
            condition = _inlet(name, conditions, shares.get(k, 1.0), period, files)
        else:
            given = conditions.outlet
            if isinstance(given, Mapping) and port.node not in given:
                raise FlowError(
                    f"port {k} (node {port.node}) is an outlet without a condition; give one"
                )
            outlet = given[port.node] if isinstance(given, Mapping) else given
            condition = _outlet(name, outlet, period, files)
        _fill(equation, "Add_BC", condition, name=name)
    wall = {"Type": "Dir", "Time_dependence": "Steady", "Value": 0.0}
    _fill(equation, "Add_BC", wall, name=face_name(mesh, WALL))
    write_mesh_complete(folder / "mesh-complete", mesh)
    for name, text in files.items():
        write_text(folder / name, text)
    ElementTree.indent(root)
    head = '<?xml version="1.0" encoding="UTF-8" ?>\n'
    write_text(folder / "solver.xml", head + ElementTree.tostring(root, "unicode") + "\n")


def _shares(
    mesh: LumenMesh, conditions: PulsatileConditions, steps: MarchSteps
) -> Mapping[int, float]:
    inlets = [k for k, port in enumerate(mesh.ports) if port.inlet]
    if conditions.inlet_is == "pressure" or len(inlets) == 1:
        return {}
    given = steps.inlet_share
    if given is None or sorted(given) != inlets or abs(sum(given.values()) - 1.0) > 1e-6:
        raise FlowError(
            f"{len(inlets)} inlets (ports {inlets}) on one flow: svMultiPhysics wants each one's; "
            "give inlet_share, adding up to 1, such as from the 0D solution"
        )
    return given


def _general(steps: MarchSteps, period: float) -> Fields:
    return {
        "Continue_previous_simulation": False,
        "Number_of_spatial_dimensions": 3,
        "Number_of_time_steps": steps.per_cycle * steps.cycles,
        "Time_step_size": period / steps.per_cycle,
        "Spectral_radius_of_infinite_time_step": 0.5,
        "Searched_file_name_to_trigger_stop": "STOP_SIM",
        "Save_results_to_VTK_format": True,
        "Name_prefix_of_saved_VTK_files": "result",
        "Increment_in_saving_VTK_files": max(steps.per_cycle // 20, 1),
        "Start_saving_after_time_step": steps.per_cycle * (steps.cycles - 1) + 1,
        "Increment_in_saving_restart_files": steps.per_cycle,
        "Convert_BIN_to_VTK_format": False,
        "Verbose": True,
        "Warning": False,
        "Debug": False,
    }


def _add_mesh(root: ElementTree.Element, mesh: LumenMesh) -> None:
    where = "mesh-complete"
    values = {"Mesh_file_path": f"{where}/mesh-complete.mesh.vtu"}
    part = _fill(root, "Add_mesh", values, name="msh")
    for label in range(len(mesh.ports) + 1):
        name = face_name(mesh, label)
        path = f"{where}/mesh-surfaces/{name}.vtp"
        _fill(part, "Add_face", {"Face_file_path": path}, name=name)


def _add_numerics(equation: ElementTree.Element) -> None:
    for viscosity in equation.iter("Viscosity"):
        viscosity.set("model", "Constant")
    wanted = dict.fromkeys(("Velocity", "Pressure", "Traction", "WSS"), True)
    _fill(equation, "Output", wanted, type="Spatial")
    solver = _fill(equation, "LS", {}, type="NS")
    _fill(solver, "Linear_algebra", {"Preconditioner": "fsils"}, type="fsils")
    for key, value in _LINEAR_SOLVER.items():
        _fill(solver, key, value)


def _inlet(
    name: str, conditions: PulsatileConditions, share: float, period: float, files: dict[str, str]
) -> Fields:
    if conditions.inlet_is == "pressure":
        return _pressure(name, conditions.inlet, period, files)
    wave = _wave(f"{name}.flow", conditions.inlet, -CM3_PER_UL * share, period, files)
    return {"Type": "Dir", **wave, "Profile": "Parabolic", "Impose_flux": True}


def _outlet(name: str, outlet: Outlet, period: float, files: dict[str, str]) -> Fields:
    if isinstance(outlet, PressureOutlet):
        return _pressure(name, outlet.waveform, period, files)
    cgs = outlet_values(outlet)
    if isinstance(outlet, ResistanceOutlet):
        if outlet.distal_pa != 0.0:
            raise FlowError(
                f"{name}: svMultiPhysics' resistance ends at pressure 0, and distal_pa is "
                f"{outlet.distal_pa:g} Pa; take pressures from there, or a Windkessel"
            )
        return {"Type": "Neu", "Time_dependence": "Resistance", "Value": cgs["R"]}
    values = {
        "Capacitance": cgs["C"],
        "Distal_resistance": cgs["Rd"],
        "Proximal_resistance": cgs["Rp"],
        "Distal_pressure": cgs["Pd"],
        "Initial_pressure": cgs["Pd"],
    }
    return {"Type": "Neu", "Time_dependence": "RCR", "RCR_values": values}


def _pressure(name: str, wave: Waveform, period: float, files: dict[str, str]) -> Fields:
    return {"Type": "Neu", **_wave(f"{name}.pressure", wave, DYN_CM2_PER_PA, period, files)}


def _wave(name: str, wave: Waveform, scale: float, period: float, files: dict[str, str]) -> Fields:
    """A value, or the file of a waveform: samples and modes, then a line a sample."""
    if wave.period_s is None:
        value = float(wave.at(np.zeros(1))[0]) * scale
        return {"Time_dependence": "Steady", "Value": value}
    times = cycle_times(period, 200, closed=True)
    lines = [f"{len(times)} {_MODES}"]
    lines += [f"{t:.9g} {v:.12g}" for t, v in zip(times, wave.at(times) * scale, strict=True)]
    files[name] = "\n".join(lines) + "\n"
    return {"Time_dependence": "Unsteady", "Temporal_values_file_path": name}


def _fill(
    parent: ElementTree.Element, tag: str, value: Any, **attributes: str
) -> ElementTree.Element:
    """Add an element with a value, or with one for each entry of a mapping."""
    child = ElementTree.SubElement(parent, tag, attributes)
    if isinstance(value, Mapping):
        for key, inner in value.items():
            _fill(child, key, inner)
    elif isinstance(value, bool):
        child.text = f" {str(value).lower()} "
    else:
        child.text = f" {value:.12g} " if isinstance(value, float) else f" {value} "
    return child


Arrays = Mapping[str, NDArray[Any]]


def face_name(mesh: LumenMesh, label: int) -> str:
    """``wall``, or ``inlet_0``, ``outlet_1``, ...: the port's number behind what it is."""
    if label == WALL:
        return "wall"
    return f"{'inlet' if mesh.ports[label - 1].inlet else 'outlet'}_{label - 1}"


def write_mesh_complete(folder: Path, mesh: LumenMesh) -> None:
    """Write the folder that svMultiPhysics and SimVascular read, from the mesh's corners.

    The elements are straight: nodes on edges are left out, so a lumen loses the sliver between
    its wall and its facets; mesh it finer than for the curved elements. `mesh-complete.mesh.vtu`,
    `mesh-complete.exterior.vtp`, `walls_combined.vtp` and `mesh-surfaces/` with a file a face.
    Numbers (``GlobalNodeID``, ``GlobalElementID``) begin at 1 and are 32 bits, as the solver
    reads nothing else; a face's element is the tetrahedron behind it. ``ModelFaceID`` is the
    label and 1. Faces are outward.

    Raises
    ------
    FlowError
        When straight elements turn inside out, a face belongs to no tetrahedron, or there are
        more nodes or elements than 32 bits count.
    OSError
        When a file can't be written.
    """
    tets, faces = mesh.tets[:, :4], mesh.faces[:, :3]
    _check(mesh, tets)
    points = mesh.points[: mesh.corner_count] * CGS.cm_per_mm
    behind, _ = elements_behind(mesh, np.arange(len(faces)))
    whole = np.arange(len(faces))
    _write_volume(folder / "mesh-complete.mesh.vtu", points, tets)
    surfaces = {"mesh-complete.exterior": whole, "walls_combined": whole[mesh.label == WALL]}
    for label in range(len(mesh.ports) + 1):
        name = f"mesh-surfaces/{face_name(mesh, label)}"
        surfaces[name] = whole[mesh.label == label]
    for name, chosen in surfaces.items():
        cells = {"GlobalElementID": behind[chosen] + 1, "ModelFaceID": mesh.label[chosen] + 1}
        _write_surface(folder / f"{name}.vtp", points, faces[chosen], cells)


@dataclass(frozen=True)
class StraightShares:
    """What straight elements keep of a lumen: of its volume, and of its inlets' area, 0 to 1."""

    volume: float
    inlet_area: float


def straight_shares(mesh: LumenMesh) -> StraightShares:
    """Compare the mesh that is written, without its curved edges, with the lumen's own."""
    at, weight = tetrahedron_rule(3)
    _, slope = quadratic(at)
    curved = np.linalg.det(jacobian(mesh.points[mesh.tets], slope)) @ weight
    inlets = [k for k, port in enumerate(mesh.ports) if port.inlet]
    p = mesh.points[mesh.faces[np.isin(mesh.label, np.add(inlets, 1)), :3]]
    area = 0.5 * np.linalg.norm(np.cross(p[:, 1] - p[:, 0], p[:, 2] - p[:, 0]), axis=1)
    meant = np.pi * sum(mesh.ports[k].radius_mm ** 2 for k in inlets)
    volume = float(_six_volumes(mesh, mesh.tets[:, :4]).sum()) / 6.0
    return StraightShares(volume / float(curved.sum()), float(area.sum()) / meant)


def _six_volumes(mesh: LumenMesh, tets: IntArray) -> FloatArray:
    p = mesh.points[tets]
    across = np.cross(p[:, 1] - p[:, 0], p[:, 2] - p[:, 0])
    return np.asarray(np.einsum("ti,ti->t", across, p[:, 3] - p[:, 0]))


def _check(mesh: LumenMesh, tets: IntArray) -> None:
    if max(mesh.corner_count, len(tets)) >= 2**31:
        raise FlowError(f"{len(tets)} elements are more than 32 bits count; mesh coarser")
    volume = _six_volumes(mesh, tets)
    worst = int(np.argmin(volume))
    if volume[worst] <= 0.0:
        place = mesh.points[tets[worst]].mean(0).round(3).tolist()
        raise FlowError(
            f"tetrahedron {worst} at {place} mm is inside out "
            f"without its curved edges (volume {volume[worst] / 6:.3g} mm³); mesh finer there"
        )


def _write_volume(path: Path, points: NDArray[Any], tets: IntArray) -> None:
    count = len(tets)
    sections: dict[str, Arrays] = {
        "PointData": {"GlobalNodeID": _int32(np.arange(1, len(points) + 1))},
        "CellData": {
            "GlobalElementID": _int32(np.arange(1, count + 1)),
            "ModelRegionID": _int32(np.ones(count)),
        },
        "Points": {"Points": points},
        "Cells": {
            "connectivity": _int32(tets.ravel()),
            "offsets": _int32(4 * np.arange(1, count + 1)),
            "types": np.full(count, 10, dtype=np.uint8),  # VTK_TETRA
        },
    }
    counts = {"NumberOfPoints": len(points), "NumberOfCells": count}
    write_text(path, vtk_document("UnstructuredGrid", counts, sections, bare_scalars=True))


def _write_surface(path: Path, points: NDArray[Any], faces: IntArray, data: Arrays) -> None:
    """Only the nodes that the faces have, which GlobalNodeID leads back to the volume's."""
    nodes, corners = np.unique(faces, return_inverse=True)
    sections: dict[str, Arrays] = {
        "PointData": {"GlobalNodeID": _int32(nodes + 1)},
        "CellData": {name: _int32(values) for name, values in data.items()},
        "Points": {"Points": points[nodes]},
        "Polys": {
            "connectivity": _int32(corners.ravel()),
            "offsets": _int32(3 * np.arange(1, len(faces) + 1)),
        },
    }
    counts = {"NumberOfPoints": len(nodes), "NumberOfPolys": len(faces)}
    write_text(path, vtk_document("PolyData", counts, sections, bare_scalars=True))


def _int32(values: NDArray[Any]) -> NDArray[np.int32]:
    return values.astype(np.int32)
