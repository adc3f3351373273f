"""svMultiPhysics' input, read back by other readers."""

import base64
from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree

import meshio
import numpy as np
import pytest

from design.errors import FlowError
from design.hemodynamics import (
    PressureOutlet,
    PulsatileConditions,
    ResistanceOutlet,
    WindkesselOutlet,
)
from design.hemodynamics.three_d.svmultiphysics import MarchSteps, write_svmultiphysics
from design.hemodynamics.waveforms import Constant, Sine
from tests.design.hemodynamics.three_d.pipes import pipe_mesh

RADIUS, LENGTH = 0.2, 2.0
MESH = pipe_mesh(RADIUS, LENGTH, 3, 12)
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
    hexagons = 18 / 2 * np.sin(2 * np.pi / 18) * RADIUS**2  # the rim has 18 straight sides
    assert volume.sum() == pytest.approx(hexagons * LENGTH * 1e-3, rel=1e-9)
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
