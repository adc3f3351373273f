"""Curved meshes of lumens: volume, ports, wall and elements."""

from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
import pytest

from design.errors import FlowError
from design.hemodynamics.three_d import LumenMesh, least_jacobian, straighten_edges
from design.hemodynamics.three_d.meshing.mesh import MeshOptions, lumen_mesh
from design.hemodynamics.three_d.meshing.surface import check_surface, wall_surface
from design.hemodynamics.three_d.meshing.wall import lumen_wall
from design.network import VesselNetwork
from tests.design.hemodynamics.networks import network_of
from tests.design.hemodynamics.three_d.shapes import (
    bent,
    cross,
    crowded,
    mesh_volume,
    port_area,
    random_fork,
    ring,
    straight,
    thick_and_thin,
)
from tests.design.networks import polyline
from tests.slower import first_of

pytest.importorskip("netgen")


def _euler(mesh: LumenMesh) -> int:
    """Of the boundary."""
    ends = np.sort(mesh.faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    edges, count = np.unique(ends, axis=0, return_counts=True)
    assert (count == 2).all()
    return len(np.unique(mesh.faces[:, :3])) - len(edges) + len(mesh.faces)


def _sound(network: VesselNetwork, options: MeshOptions | None = None) -> LumenMesh:
    """Mesh a network, and see that it is one: closed, of its genus, mapped one to one."""
    options = options or MeshOptions()
    raw = lumen_mesh(network, options)
    mesh, bent_back = straighten_edges(raw)
    assert least_jacobian(mesh).min() > 0.0
    assert bent_back < 0.02 * len(mesh.tets)
    loops = network.vessel_count - len(network.nodes) + 1
    assert _euler(mesh) == 2 - 2 * loops
    assert mesh_volume(raw) == pytest.approx(mesh_volume(mesh), rel=3e-3)
    for k, port in enumerate(mesh.ports):
        assert port_area(raw, k) == pytest.approx(np.pi * port.radius_mm**2, rel=1e-3)
    wall = np.unique(raw.faces[raw.label == 0, :3])
    field = lumen_wall(network, options.fillet_ratio, options.edge_ratio)
    assert np.abs(field.distance(raw.points[wall])).max() < 1e-4 * network.radius.min()
    return mesh


@pytest.mark.parametrize("edge_ratio", [pytest.param(0.5, marks=pytest.mark.slow), 0.7])
def test_a_tube_has_its_volume_and_its_ports_area_to_a_ten_thousandth(edge_ratio: float) -> None:
    mesh = lumen_mesh(straight(0.5, 4.0), MeshOptions(edge_ratio=edge_ratio))
    assert mesh_volume(mesh) == pytest.approx(np.pi, rel=5e-5)
    for k in range(2):
        assert port_area(mesh, k) == pytest.approx(np.pi / 4.0, rel=5e-5)


def test_a_cone_has_its_volume() -> None:
    mesh = lumen_mesh(straight(0.5, 4.0, 0.4))
    exact = np.pi * 4.0 / 3.0 * (0.25 + 0.5 * 0.2 + 0.04)
    # The ball at the wide end stands out of the cone by 1e-3 of a radius.
    assert mesh_volume(mesh) == pytest.approx(exact, rel=2e-4)


@pytest.mark.slow
def test_a_bend_has_the_volume_of_a_quarter_torus() -> None:
    mesh = _sound(bent(300))
    assert mesh_volume(mesh) == pytest.approx(0.5 * np.pi**2 * 2.0 * 0.4**2, rel=2e-4)


@pytest.mark.slow
def test_curved_faces_lie_on_the_wall_in_the_mean() -> None:
    network = bent(60)
    mesh = lumen_mesh(network)
    wall = lumen_wall(network, 0.5, 0.7)
    node = mesh.points[mesh.faces[mesh.label == 0]]
    share = np.random.default_rng(1).dirichlet(np.ones(3), 400)
    l0, l1, l2 = share.T
    shape = np.stack(
        [*(v * (2 * v - 1) for v in (l0, l1, l2)), 4 * l0 * l1, 4 * l1 * l2, 4 * l2 * l0], axis=1
    )
    off = wall.distance(np.einsum("qn,fnx->fqx", shape, node).reshape(-1, 3)).reshape(-1, 400)
    assert abs(off.mean()) < 5e-5 * 0.4
    assert np.abs(off.mean(axis=1)).max() < 2e-3 * 0.4
    assert np.abs(off).max() < 0.02 * 0.4
    # Flat triangles lie inside by a hundred times as much.
    flat = wall.distance(np.einsum("qn,fnx->fqx", share, node[:, :3]).reshape(-1, 3))
    assert flat.mean() < -0.01 * 0.4


@pytest.mark.slow
def test_finer_meshes_have_the_same_lumen() -> None:
    network = cross()
    first, second = (
        mesh_volume(lumen_mesh(network, MeshOptions(edge_ratio=ratio))) for ratio in (0.7, 0.55)
    )
    assert first == pytest.approx(second, rel=3e-4)


@pytest.mark.slow
@pytest.mark.parametrize(
    "make", [crowded, ring, cross, thick_and_thin, *(partial(random_fork, k) for k in range(30))]
)
def test_forks_loops_crowds_and_radii_of_20_to_1_are_meshed(make: Any) -> None:
    _sound(make())


@pytest.mark.slow
@pytest.mark.parametrize("edge_ratio", [1.0])
def test_coarse_meshes_keep_the_lumens_volume(edge_ratio: float) -> None:
    """Elements that fold are few enough that straightening them takes nothing that counts."""
    network = cross()
    coarse, _ = straighten_edges(lumen_mesh(network, MeshOptions(edge_ratio=edge_ratio)))
    assert mesh_volume(coarse) == pytest.approx(mesh_volume(lumen_mesh(network)), rel=5e-3)


def test_a_closed_ring_buried_ends_and_fillets_without_room_are_refused() -> None:
    nodes = [[0.0, 0, 0], [3, 0, 0], [1.5, 2.5, 0]]
    closed = network_of(nodes, [(0, 1), (1, 2), (2, 0)], 0.3)
    with pytest.raises(FlowError, match="no free ends"):
        lumen_mesh(closed)
    # Vessel 2 ends within vessel 1.
    nodes = [[0.0, 0, 0], [3, 0, 0], [8, 0, 0], [5, 0.2, 0]]
    buried = network_of(nodes, [(0, 1), (1, 2), (1, 3)], [0.5, 0.5, 0.3])
    with pytest.raises(FlowError, match=r"free end at node 3 .* isn't an open disc"):
        lumen_mesh(buried)
    with pytest.raises(FlowError, match=r"crosses itself near .* lower the fillet ratio"):
        lumen_mesh(_side_by_side(0.2))


def _side_by_side(gap: float) -> VesselNetwork:
    """A turn whose legs run back beside one another, unjoined."""
    wide = 0.8 + gap
    nodes = [[0.0, 0, 0], [4, 0, 0], [6, wide / 2, 0], [4, wide, 0], [0, wide, 0]]
    return network_of(nodes, [(0, 1), (1, 2), (2, 3), (3, 4)], 0.4)


def test_a_vertex_off_the_wall_is_refused() -> None:
    network = straight(0.5, 4.0)
    wall = lumen_wall(network, 0.5, 0.7)
    surface = wall_surface(network, wall, 0.5)
    check_surface(surface, wall, 0.5)
    surface.vertices[np.argmin(np.abs(surface.vertices[:, 0] - 2.0))] *= (1.0, 1.02, 1.02)
    with pytest.raises(FlowError, match=r"can't be followed near .* lower the fillet ratio"):
        check_surface(surface, wall, 0.5)


@pytest.mark.slow
@pytest.mark.parametrize("seed", [2])
def test_rough_centrelines_are_meshed(seed: int) -> None:
    """Kinks nearer to each other than a radius, as a scan's centreline has."""
    rng = np.random.default_rng(seed)
    x = np.linspace(0.0, 6.0, 30)
    points = np.stack([x, 0.5 * np.sin(2.0 * x + seed), 0.3 * np.cos(1.5 * x)], axis=1)
    points += rng.normal(0.0, 0.01, points.shape)
    _sound(polyline(points, 0.3 * np.exp(rng.normal(0.0, 0.05, 30))))


@pytest.mark.parametrize("degrees", first_of([9.0, 12.0]))
def test_acute_forks_are_meshed(degrees: float) -> None:
    angle = np.radians(degrees)
    far = [9.0 * np.cos(angle), 9.0 * np.sin(angle), 0.0]
    _sound(
        network_of(
            [[-4, 0, 0], [0, 0, 0], far, [9, 0, 0]], [(0, 1), (1, 2), (1, 3)], [0.5, 0.4, 0.35]
        )
    )


def test_options_out_of_bounds_are_refused() -> None:
    for name, value in (("edge_ratio", 2.0), ("fillet_ratio", 0.0)):
        with pytest.raises(FlowError, match=f"{name} {value:g} of a 3D mesh"):
            replace(MeshOptions(), **{name: value})
