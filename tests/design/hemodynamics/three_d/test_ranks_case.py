"""Cases for MPI ranks and svMultiPhysics' input, read back by other readers."""

import ast
import base64
import json
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import meshio
import numpy as np
import pytest

from design.errors import FlowError
from design.hemodynamics import (
    FlowConditions,
    OutletLoad,
    PressureOutlet,
    PulsatileConditions,
    ResistanceOutlet,
    WindkesselOutlet,
)
from design.hemodynamics.other_solvers.svmultiphysics import MarchSteps, write_svmultiphysics
from design.hemodynamics.three_d.meshing.lumen_mesh import LumenMesh
from design.hemodynamics.three_d.ranks import (
    ENGINE,
    RankOptions,
    read_result,
    write_case,
)
from design.hemodynamics.waveforms import Constant, Sine
from tests.design.hemodynamics.three_d.lumens import pipe

RADIUS, FLOW, VISCOSITY = 0.2, 4.0, 1e-3
DRIVEN = FlowConditions(VISCOSITY, inlet_flow_ul_s=FLOW)
tube = partial(pipe, layers=4, radius=RADIUS, length=1.0)


def squeezed(mesh: LumenMesh, by: float) -> LumenMesh:
    """The pipe with an ellipse for its section."""
    ports = tuple(replace(p, radius_mm=p.radius_mm * np.sqrt(by)) for p in mesh.ports)
    return replace(mesh, points=mesh.points * [1.0, by, 1.0], ports=ports)


def case_of(folder: Path, mesh: LumenMesh, conditions: FlowConditions) -> dict[str, Any]:
    write_case(mesh, conditions, folder)
    return json.loads((folder / "case.json").read_text())


def inflow(folder: Path, mesh: LumenMesh) -> np.ndarray:
    write_case(mesh, DRIVEN, folder)
    return np.load(folder / "inflow.npy")


def test_a_developed_profile_in_a_circle_is_the_parabola(tmp_path):
    errors = []
    for rings in (2, 4):
        mesh = tube(rings)
        found = inflow(tmp_path, mesh)
        nodes = np.unique(mesh.faces[mesh.label == 1])
        r = np.hypot(*mesh.points[nodes, :2].T)
        exact = 2.0 * FLOW / (np.pi * RADIUS**2) * (1.0 - (r / RADIUS) ** 2)
        errors.append(np.abs(found[nodes, 2] - exact).max() / exact.max())
        assert np.all(found[nodes, :2] == 0.0)
    assert errors[0] < 5e-3
    assert errors[1] < errors[0] / 6.0  # third order or better


def test_a_developed_profile_follows_an_ellipse(tmp_path):
    mesh = squeezed(tube(4), 0.5)
    found = inflow(tmp_path, mesh)
    nodes = np.unique(mesh.faces[mesh.label == 1])
    x, y = mesh.points[nodes, :2].T
    a, b = RADIUS, 0.5 * RADIUS
    exact = 2.0 * FLOW / (np.pi * a * b) * (1.0 - (x / a) ** 2 - (y / b) ** 2)
    assert np.abs(found[nodes, 2] - exact).max() < 2e-3 * exact.max()


def test_a_case_holds_mesh_conditions_and_the_engine(tmp_path):
    mesh = tube(3)
    (tmp_path / "ranks.json").write_text("{}")
    case = case_of(tmp_path, mesh, replace(DRIVEN, behind={1: OutletLoad(2.0, 7.0)}))
    assert [port["kind"] for port in case["ports"]] == ["profile", "open"]
    # Q = (p - 7)/2 is Q - p/2 = -7/2.
    assert case["groups"] == [{"ports": [1], "slope": 0.5, "given": -3.5}]
    assert np.array_equal(np.load(tmp_path / "tets.npy"), mesh.tets)
    assert (tmp_path / "engine.py").read_bytes() == ENGINE.read_bytes()
    assert not (tmp_path / "ranks.json").exists()
    with pytest.raises(FlowError, match="hasn't been solved"):
        read_result(tmp_path)


def test_conditions_that_leave_the_flow_open_are_refused(tmp_path):
    both = replace(DRIVEN, outlet_flow_ul_s={1: FLOW})
    with pytest.raises(FlowError, match="no pressure is determined"):
        write_case(tube(3), both, tmp_path)
    with pytest.raises(FlowError, match="node 9 isn't at a port"):
        write_case(tube(3), replace(DRIVEN, inlets=(9,)), tmp_path)
    with pytest.raises(FlowError, match="tolerance is 0"):
        RankOptions(tolerance=0.0)


def test_a_result_is_of_its_own_case(tmp_path):
    mesh = tube(3)
    write_case(mesh, DRIVEN, tmp_path)
    for name, values in (("velocity", mesh.points), ("pressure", mesh.points[:, 0])):
        np.save(tmp_path / f"{name}.npy", values)
    (tmp_path / "ranks.json").write_text(json.dumps({"case": "of yesterday", "ports": []}))
    with pytest.raises(FlowError, match="of another case"):
        read_result(tmp_path)


def test_conditions_of_a_network_hold_at_its_lumens_ports(tmp_path):
    mesh = tube(3)
    case = case_of(tmp_path, mesh, replace(DRIVEN, outlet_pressure_pa=3.0))
    assert [port["pressure_pa"] for port in case["ports"]] == [0.0, 3.0]
    assert case["groups"] == []
    drawn = FlowConditions(VISCOSITY, inlet_pressure_pa=9.0, outlet_flow_ul_s={1: FLOW})
    case = case_of(tmp_path, mesh, drawn)
    assert [port["kind"] for port in case["ports"]] == ["open", "open"]
    assert [port["pressure_pa"] for port in case["ports"]] == [9.0, 0.0]
    assert case["groups"] == [{"ports": [1], "slope": 0.0, "given": FLOW}]
    both = replace(mesh, ports=(*mesh.ports, replace(mesh.ports[0], node=2)))
    case = case_of(tmp_path, both, DRIVEN)
    assert case["groups"] == [{"ports": [0, 2], "slope": 0.0, "given": -FLOW}]


def test_the_engine_imports_nothing_of_ours():
    ours = {
        "design",
        "gcode",
        "printctl",
        "kernels",
        "registration",
        "report",
        "sim",
        "firmware_profiles",
    }
    for node in ast.walk(ast.parse(ENGINE.read_text())):
        names = [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
        if isinstance(node, ast.ImportFrom):
            assert node.level == 0
            names = [node.module]
        assert not {name.split(".")[0] for name in names} & ours


# svMultiPhysics' input.


WIDE, LONG = 0.2, 2.0
MESH = pipe(3, 12, WIDE, LONG)
SINE = Sine(4.0, 1.0, 0.5)


def conditions(**changes) -> PulsatileConditions:
    return PulsatileConditions(**({"viscosity_pa_s": 4e-3, "inlet": SINE} | changes))


def read_vtp(path: Path) -> dict[str, np.ndarray]:
    """Arrays of inline binary VTK XML, by the standard library."""
    root = ElementTree.parse(path).getroot()
    assert root.attrib["header_type"] == "UInt64"
    kinds = {"Float64": "<f8", "Int32": "<i4", "UInt8": "<u1"}
    found = {}
    for array in root.iter("DataArray"):
        data = base64.b64decode(array.text)
        assert int.from_bytes(data[:8], "little") == len(data) - 8
        values = np.frombuffer(data[8:], kinds[array.attrib["type"]])
        found[array.attrib["Name"]] = values
    found["Points"] = found["Points"].reshape(-1, 3)
    return found


def texts(path: Path) -> ElementTree.Element:
    root = ElementTree.parse(path).getroot()
    for each in root.iter():
        each.text = (each.text or "").strip()
    return root


def condition(root: ElementTree.Element, name: str) -> ElementTree.Element:
    return next(x for x in root.iter("Add_BC") if x.attrib["name"] == name)


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    path = tmp_path_factory.mktemp("svmp")
    write_svmultiphysics(path, MESH, conditions(outlet=WindkesselOutlet(1.0, 0.1, 4.0, 50.0)))
    return path


def test_the_volume_is_the_lumens_in_cm(folder):
    found = meshio.read(folder / "mesh-complete" / "mesh-complete.mesh.vtu")
    (cells,) = found.cells
    assert cells.type == "tetra"
    assert np.array_equal(cells.data, MESH.tets[:, :4])
    assert np.allclose(found.points, 0.1 * MESH.points[: MESH.corner_count], rtol=0, atol=1e-16)
    p = found.points[cells.data]
    volume = np.linalg.det(p[:, 1:] - p[:, :1]) / 6.0
    assert volume.min() > 0.0
    hexagons = 18 / 2 * np.sin(2 * np.pi / 18) * WIDE**2  # the rim has 18 straight sides
    assert volume.sum() == pytest.approx(hexagons * LONG * 1e-3, rel=1e-9)
    assert found.point_data["GlobalNodeID"].dtype == np.int32  # the solver reads no other
    assert np.array_equal(found.point_data["GlobalNodeID"], np.arange(1, len(found.points) + 1))
    (elements,) = found.cell_data["GlobalElementID"]
    assert elements.dtype == np.int32
    assert np.array_equal(elements, np.arange(1, len(MESH.tets) + 1))


@pytest.mark.parametrize(
    ("name", "label"), [("wall", 0), ("inlet_0", 1), ("outlet_1", 2)], ids=["wall", "in", "out"]
)
def test_faces_lead_back_to_nodes_and_elements_of_the_volume(folder, name, label):
    found = read_vtp(folder / "mesh-complete" / "mesh-surfaces" / f"{name}.vtp")
    node, element = found["GlobalNodeID"], found["GlobalElementID"]
    assert node.dtype == element.dtype == np.int32
    assert np.allclose(found["Points"], 0.1 * MESH.points[node - 1], rtol=0, atol=1e-16)
    faces = node[found["connectivity"].reshape(-1, 3)] - 1
    assert np.array_equal(faces, MESH.faces[MESH.label == label, :3])
    for face, behind in zip(faces, element - 1, strict=True):
        assert set(face) < set(MESH.tets[behind, :4])
    assert set(found["ModelFaceID"]) == {label + 1}


def test_numbers_are_in_cm_g_s(folder):
    root = texts(folder / "solver.xml")
    assert float(root.find("Add_equation/Density").text) == pytest.approx(1.06)
    assert float(root.find("Add_equation/Viscosity/Value").text) == pytest.approx(0.04)
    assert float(root.find(".//Time_step_size").text) == pytest.approx(0.5 / 1000)
    rcr = condition(root, "outlet_1").find("RCR_values")
    # 1 Pa·s/µL = 10 dyn/cm² / (1e-3 cm³/s); 1 µL/Pa = 1e-3 cm³ / (10 dyn/cm²).
    assert float(rcr.find("Proximal_resistance").text) == pytest.approx(1e4)
    assert float(rcr.find("Distal_resistance").text) == pytest.approx(4e4)
    assert float(rcr.find("Capacitance").text) == pytest.approx(1e-5)
    assert float(rcr.find("Distal_pressure").text) == pytest.approx(500.0)


def test_the_inlets_flow_goes_against_the_outward_normal(folder):
    lines = (folder / "inlet_0.flow").read_text().splitlines()
    assert [int(x) for x in lines[0].split()] == [len(lines) - 1, 16]
    time, flow = np.array([line.split() for line in lines[1:]], dtype=float).T
    assert time[0] == 0.0
    assert time[-1] == pytest.approx(0.5)
    assert flow == pytest.approx(-1e-3 * SINE.at(time), rel=1e-6)


def test_pressures_drive_from_either_end(tmp_path):
    given = conditions(inlet_is="pressure", inlet=Sine(100.0, 10.0, 1.0), outlet=PressureOutlet())
    write_svmultiphysics(tmp_path, MESH, given)
    root = texts(tmp_path / "solver.xml")
    assert condition(root, "inlet_0").find("Type").text == "Neu"
    first = (tmp_path / "inlet_0.pressure").read_text().splitlines()[1]
    assert float(first.split()[1]) == pytest.approx(1000.0)


def test_several_inlets_want_their_shares(tmp_path):
    both = replace(MESH, ports=tuple(replace(p, inlet=True) for p in MESH.ports))
    with pytest.raises(FlowError, match=r"2 inlets \(ports \[0, 1\]\).*inlet_share"):
        write_svmultiphysics(tmp_path, both, conditions())
    shares = MarchSteps(inlet_share={0: 0.25, 1: 0.75})
    write_svmultiphysics(tmp_path, both, conditions(inlet=Constant(4.0)), shares)
    root = texts(tmp_path / "solver.xml")
    assert float(condition(root, "inlet_1").find("Value").text) == pytest.approx(-3e-3)


@pytest.mark.parametrize(
    ("outlet", "message"),
    [
        (ResistanceOutlet(2.0, 10.0), "resistance ends at pressure 0"),
        ({7: ResistanceOutlet(2.0)}, r"port 1 \(node 1\) is an outlet without a condition"),
    ],
)
def test_what_the_solver_cant_be_told_is_refused(tmp_path, outlet, message):
    with pytest.raises(FlowError, match=message):
        write_svmultiphysics(tmp_path, MESH, conditions(outlet=outlet))
    assert not list(tmp_path.iterdir())


def test_elements_that_turn_inside_out_without_curves_are_refused(tmp_path):
    tets = MESH.tets.copy()
    tets[5, :2] = tets[5, [1, 0]]
    with pytest.raises(FlowError, match=r"tetrahedron 5 at .* is inside out"):
        write_svmultiphysics(tmp_path, replace(MESH, tets=tets), conditions())
