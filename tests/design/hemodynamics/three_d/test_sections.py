"""Cross-sections, polynomials and files of 3D flow, against known fields."""

import base64
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest

from design.errors import FlowError
from design.hemodynamics.probes import Probes
from design.hemodynamics.three_d import (
    Field,
    LumenMesh,
    probe_steady,
    wall_shear,
    write_flow_vtu,
)
from design.hemodynamics.three_d.meshing.lumen_mesh import gradients, nodes, quadratic, shapes
from design.hemodynamics.three_d.meshing.mesh import MeshOptions, lumen_mesh
from design.hemodynamics.three_d.residence import trace_streamlines
from design.hemodynamics.three_d.vessels.sections import VesselSections
from kernels.arrays import FloatArray
from tests.design.hemodynamics.networks import network_of
from tests.design.hemodynamics.three_d.lumens import bend, pipe

RADIUS, LENGTH, FLOW = 0.5, 4.0, 3.0


def _poiseuille(mesh: LumenMesh, order: int = 3) -> Field:
    """The exact parabola and a pressure of 10 - 2 z, told at the elements' nodes."""
    place, low = (
        np.einsum("qn,tnx->tqx", quadratic(nodes(k))[0], mesh.points[mesh.tets])
        for k in (order, order - 1)
    )
    speed = 2.0 * FLOW / (np.pi * RADIUS**2) * (1.0 - (place[..., :2] ** 2).sum(-1) / RADIUS**2)
    velocity = np.zeros_like(place)
    velocity[..., 2] = speed
    return Field(mesh, velocity, 10.0 - 2.0 * low[..., 2:], order)


def test_probes_along_a_pipe_find_its_flow_and_pressure() -> None:
    mesh, network = pipe(2, 7), network_of([[0, 0, 0], [0, 0, LENGTH]], [(0, 1)], RADIUS)
    fraction = np.array([0.0, 0.05, 0.31, 0.5, 0.77, 1.0])
    found = probe_steady(network, Probes(np.zeros(6, dtype=np.int64), fraction), _poiseuille(mesh))
    assert found.flow[:, 0] == pytest.approx(FLOW, rel=5e-4)
    assert found.pressure[:, 0] == pytest.approx(10.0 - 2.0 * LENGTH * fraction, abs=1e-9)


def test_a_section_of_a_tight_bend_leaves_the_other_leg_out() -> None:
    """A U whose legs the same plane cuts: one of them only."""
    for turn, layers in ((np.pi, 16), (np.pi / 2, 8)):
        angle = np.linspace(0.0, turn, 40)
        axis = np.column_stack([1.5 - 1.5 * np.cos(angle), 0.0 * angle, 1.5 * np.sin(angle)])
        # The mesh's ports are nodes 0 and 1: the line's ends.
        nodes, count = [*axis[[0, -1]].tolist(), *axis[1:-1].tolist()], len(axis) - 1
        ends = [(k and k + 1, k + 2 if k < count - 1 else 1) for k in range(count)]
        network = network_of(nodes, ends, RADIUS)
        mesh = bend(2, layers, RADIUS, 1.5, turn)
        for vessel in (0, count // 2, count - 1):
            section = VesselSections(network, mesh, 2).at(vessel, 0.5)
            assert section.area == pytest.approx(np.pi * RADIUS**2, rel=0.1)
            assert section.clear


def test_a_place_outside_the_mesh_is_refused() -> None:
    network = network_of([[5, 0, 0], [5, 0, 2]], [(0, 1)], RADIUS)
    with pytest.raises(FlowError, match=r"nothing at 5\.000, 0\.000, 1\.000 mm"):
        VesselSections(network, pipe(1, 2), 2).at(0, 0.5)


def test_a_section_that_another_vessel_is_part_of_has_no_flow() -> None:
    """A wide vessel that leaves a thin one by 20°; before it has left, a section cuts both."""
    pytest.importorskip("ngsolve")
    turn = np.deg2rad(20.0)
    far = [3.0 + 8.0 * np.cos(turn), 8.0 * np.sin(turn), 0.0]
    network = network_of(
        [[0, 0, 0], [3, 0, 0], [11, 0, 0], far], [(0, 1), (1, 2), (1, 3)], [0.4, 0.2, 0.4]
    )
    mesh = lumen_mesh(network, MeshOptions(edge_ratio=1.0, fillet_ratio=0.1))
    sections = VesselSections(network, mesh, 2)
    field = _uniform(mesh)
    for vessel, radius in enumerate((0.4, 0.2, 0.4)):
        section = sections.clearest(vessel)
        assert section is not None
        assert section.area == pytest.approx(np.pi * radius**2, rel=0.03)
    # The thin one's wall has left the other's at 0.4/sin 20° + 0.2/tan 20° = 1.72 mm.
    for away, clear in ((0.5, False), (1.2, False), (1.6, False), (2.6, True), (4.0, True)):
        section = sections.at(1, away / 8.0)
        assert section.clear == clear
        assert np.isfinite(section.flow(field)) == clear
        assert np.isfinite(section.mean_pressure(field))


def _uniform(mesh: LumenMesh) -> Field:
    count = len(mesh.tets)
    return Field(mesh, np.ones((count, 10, 3)), np.ones((count, 4, 1)), 2)


def test_wall_shear_of_the_parabola() -> None:
    found = wall_shear(_poiseuille(pipe(2, 4)), 2e-3)
    exact = 4.0 * 2e-3 * FLOW / (np.pi * RADIUS**3)
    assert found.traction[:, 2] == pytest.approx(exact, rel=2e-3)
    assert np.abs(found.traction[:, :2]).max() < 1e-3 * exact


def test_streamlines_of_the_parabola_are_straight_and_as_fast() -> None:
    seeds = np.array([[0.0, 0.0, 2.0], [0.3, 0.1, 1.0]])
    for seed, (points, speed) in zip(
        seeds, trace_streamlines(_poiseuille(pipe(2, 14)), seeds), strict=True
    ):
        assert points[:, :2] == pytest.approx(np.broadcast_to(seed[:2], (len(points), 2)), abs=1e-6)
        assert np.all(np.diff(points[:, 2]) > 0.0)
        assert points[0, 2] < 0.2
        assert points[-1, 2] > LENGTH - 0.2
        exact = 2.0 * FLOW / (np.pi * RADIUS**2) * (1.0 - (seed[:2] ** 2).sum() / RADIUS**2)
        assert speed == pytest.approx(exact, rel=0.02)


def test_a_vtu_is_read_back(tmp_path: Path) -> None:
    field = _poiseuille(pipe(1, 2))
    write_flow_vtu(tmp_path / "flow.vtu", field, wall_shear(field, 1e-3))
    root = ElementTree.parse(tmp_path / "flow.vtu").getroot()
    kinds = {"Float64": np.float64, "Int64": np.int64, "UInt8": np.uint8}
    arrays = {}
    for element in root.iter("DataArray"):
        raw = base64.b64decode(str(element.text))
        assert np.frombuffer(raw[:8], "<u8")[0] == len(raw) - 8
        arrays[element.get("Name")] = np.frombuffer(raw[8:], kinds[str(element.get("type"))])
    mesh = field.mesh
    assert np.array_equal(arrays["Points"].reshape(-1, 3), mesh.points)
    assert np.array_equal(arrays["connectivity"].reshape(-1, 10), mesh.tets)
    assert np.all(arrays["types"] == 24)
    assert arrays["pressure_pa"][: mesh.corner_count] == pytest.approx(
        10.0 - 2.0 * mesh.points[: mesh.corner_count, 2]
    )
    assert len(arrays["wall_shear_pa"]) == 3 * len(mesh.points)


@pytest.mark.parametrize("order", [1, 2, 3])
def test_shapes_reproduce_polynomials_and_their_slopes(order: int) -> None:
    at = np.random.default_rng(order).dirichlet(np.ones(4), 6)

    def wanted(x: FloatArray) -> FloatArray:
        return np.asarray(x[:, 1] ** order + 2.0 * x[:, 2] * x[:, 3] ** (order - 1))

    assert shapes(order, at)[0] @ wanted(nodes(order)) == pytest.approx(wanted(at))
    step = 1e-6 * np.eye(4)
    for c in range(4):
        slope = (shapes(order, at + step[c])[0] - shapes(order, at - step[c])[0]) / 2e-6
        assert shapes(order, at)[1][..., c] == pytest.approx(slope, abs=1e-6)


def test_gradients_on_curved_elements_are_those_of_linear_fields() -> None:
    mesh = bend(1, 4)
    place = np.einsum("qn,tnx->tqx", quadratic(nodes(2))[0], mesh.points[mesh.tets])
    matrix = np.arange(9.0).reshape(3, 3)
    found, _ = gradients(place @ matrix.T, mesh.points[mesh.tets], 2, nodes(3)[3:9])
    assert found == pytest.approx(np.broadcast_to(matrix, found.shape))
