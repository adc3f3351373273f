"""Cases for MPI ranks: port profiles and consistent files."""

import ast
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from design.errors import FlowError
from design.hemodynamics import FlowConditions
from design.hemodynamics.three_d.lumen_mesh import LumenMesh
from design.hemodynamics.three_d.ranks import (
    PortFlow,
    PortPressure,
    PortShare,
    RankConditions,
    rank_conditions,
    read_result,
    write_case,
)
from design.hemodynamics.three_d.ranks.case import ENGINE, port_velocity
from tests.design.hemodynamics.three_d.pipes import pipe_mesh

RADIUS, FLOW, VISCOSITY = 0.2, 4.0, 1e-3


def pipe(rings: int = 3) -> LumenMesh:
    return pipe_mesh(RADIUS, 1.0, rings, 4)


def squeezed(mesh: LumenMesh, by: float) -> LumenMesh:
    """The pipe with an ellipse for its section."""
    ports = tuple(replace(p, radius_mm=p.radius_mm * np.sqrt(by)) for p in mesh.ports)
    return replace(mesh, points=mesh.points * [1.0, by, 1.0], ports=ports)


def test_a_developed_profile_in_a_circle_is_the_parabola():
    errors = []
    for rings in (2, 4):
        mesh = pipe(rings)
        found = port_velocity(mesh, 0, FLOW, "developed")
        nodes = np.unique(mesh.faces[mesh.label == 1])
        r = np.hypot(*mesh.points[nodes, :2].T)
        exact = 2.0 * FLOW / (np.pi * RADIUS**2) * (1.0 - (r / RADIUS) ** 2)
        errors.append(np.abs(found[nodes, 2] - exact).max() / exact.max())
        assert np.all(found[nodes, :2] == 0.0)
    assert errors[0] < 5e-3
    assert errors[1] < errors[0] / 6.0  # third order or better


def test_a_developed_profile_follows_an_ellipse():
    mesh = squeezed(pipe(4), 0.5)
    found = port_velocity(mesh, 1, -FLOW, "developed")
    nodes = np.unique(mesh.faces[mesh.label == 2])
    x, y = mesh.points[nodes, :2].T
    a, b = RADIUS, 0.5 * RADIUS
    exact = 2.0 * FLOW / (np.pi * a * b) * (1.0 - (x / a) ** 2 - (y / b) ** 2)
    assert np.abs(found[nodes, 2] - exact).max() < 2e-3 * exact.max()


def test_a_case_holds_mesh_conditions_and_the_engine(tmp_path):
    mesh = pipe()
    conditions = RankConditions((PortFlow(FLOW), PortPressure(7.0, 2.0)), VISCOSITY)
    (tmp_path / "ranks.json").write_text("{}")
    write_case(mesh, conditions, tmp_path)
    case = json.loads((tmp_path / "case.json").read_text())
    assert [port["kind"] for port in case["ports"]] == ["profile", "open"]
    # Q = (p - 7)/2 is Q - p/2 = -7/2.
    assert case["groups"] == [{"ports": [1], "slope": 0.5, "given": -3.5}]
    assert np.array_equal(np.load(tmp_path / "tets.npy"), mesh.tets)
    assert (tmp_path / "engine" / "__main__.py").is_file()
    assert not (tmp_path / "ranks.json").exists()
    with pytest.raises(FlowError, match="hasn't been solved"):
        read_result(tmp_path)


def test_a_result_of_another_case_is_refused(tmp_path):
    mesh = pipe()
    conditions = RankConditions((PortFlow(FLOW), PortPressure()), VISCOSITY)
    write_case(mesh, conditions, tmp_path)
    for name, values in (("velocity", mesh.points), ("pressure", mesh.points[:, 0])):
        np.save(tmp_path / f"{name}.npy", values)
    (tmp_path / "ranks.json").write_text(json.dumps({"case": "of yesterday", "ports": []}))
    with pytest.raises(FlowError, match="of another case"):
        read_result(tmp_path)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"ports": (PortFlow(FLOW), PortFlow(-FLOW))}, "no pressure is determined"),
        ({"ports": (PortFlow(np.nan), PortPressure())}, "port 0: flow_ul_s is nan"),
        ({"ports": (PortFlow(1.0), PortPressure(0.0, -1.0))}, "resistance is -1 Pa·s/µL"),
        ({"viscosity_pa_s": 0.0}, "viscosity_pa_s is 0 Pa·s"),
        ({"ports": (PortShare(1), PortPressure()), "supplies": (1.0,)}, "of supply 1, and there"),
        ({"supplies": (1.0,)}, "supply 0 of 1.0 µL/s: give a number, and a port"),
    ],
)
def test_conditions_that_leave_the_flow_open_are_refused(change, message):
    good = {"ports": (PortFlow(FLOW), PortPressure()), "viscosity_pa_s": VISCOSITY}
    with pytest.raises(FlowError, match=message):
        RankConditions(**(good | change))


def test_every_port_wants_a_condition(tmp_path):
    with pytest.raises(FlowError, match="1 conditions for 2 ports"):
        write_case(pipe(), RankConditions((PortPressure(),), VISCOSITY), tmp_path)


def test_conditions_of_a_network_hold_at_its_lumens_ports():
    mesh = pipe()
    driven = FlowConditions(VISCOSITY, inlet_flow_ul_s=FLOW, outlet_pressure_pa=3.0)
    assert rank_conditions(mesh, driven).ports == (PortFlow(FLOW), PortPressure(3.0))
    drawn = FlowConditions(VISCOSITY, inlet_pressure_pa=9.0, outlet_flow_ul_s={1: FLOW})
    found = rank_conditions(mesh, drawn, model="stokes")
    assert found.ports == (PortPressure(9.0), PortShare(0))
    assert (found.supplies, found.model) == ((-FLOW,), "stokes")
    both = replace(mesh, ports=(*mesh.ports, replace(mesh.ports[0], node=2)))
    found = rank_conditions(both, driven)
    assert found.ports == (PortShare(0), PortPressure(3.0), PortShare(0))
    assert found.supplies == (FLOW,)
    with pytest.raises(FlowError, match="node 9 isn't at a port"):
        rank_conditions(mesh, FlowConditions(VISCOSITY, inlet_flow_ul_s=FLOW, inlets=(9,)))


def test_the_engine_imports_nothing_of_ours():
    ours = {"design", "printctl", "kernels", "registration", "sim", "firmware_profiles"}
    for source in sorted(Path(ENGINE).glob("*.py")):
        for node in ast.walk(ast.parse(source.read_text())):
            names = [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
            if isinstance(node, ast.ImportFrom) and node.level == 0:
                names = [node.module]
            assert not {name.split(".")[0] for name in names} & ours, source
            assert not (isinstance(node, ast.ImportFrom) and node.level > 1), source
