"""Lumens meshed from surfaces: facets, voxels, and surfaces that can't be meshed."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from skimage.measure import marching_cubes

from design.errors import FlowError
from design.hemodynamics import FlowConditions
from design.hemodynamics.three_d import FlowOptions, LumenMesh, solve_steady, straighten_edges
from design.hemodynamics.three_d.meshing.mesh import (
    MeshOptions,
    SurfaceOptions,
    lumen_mesh,
    surface_mesh,
)
from kernels.arrays import FloatArray, IntArray
from tests.design.hemodynamics.networks import network_of
from tests.design.hemodynamics.three_d.surfaces import faceted_tube, straight, voxels_of_tube
from tests.slower import first_rows

RADIUS, LENGTH = 0.25, 1.5
WATER = 1e-3


def drop(mesh: LumenMesh, order: int = 2) -> float:
    """Pressure drop over Poiseuille's, and hold that the mesh is tight."""
    pytest.importorskip("ngsolve")
    flow = 4.0
    conditions = FlowConditions(WATER, inlet_flow_ul_s=flow)
    solution = solve_steady(straighten_edges(mesh)[0], conditions, FlowOptions(order=order))
    assert solution.mass_imbalance < 1e-8
    ideal = 8.0 * WATER * LENGTH * flow / (np.pi * RADIUS**4)
    return float(np.ptp(solution.port_pressure)) / ideal


@pytest.mark.slow
@pytest.mark.parametrize("beyond", [pytest.param(0.0, marks=pytest.mark.slow), 0.3])
def test_a_faceted_tube_flows_like_the_round_one(beyond: float) -> None:
    pytest.importorskip("netgen")
    network = straight(RADIUS, LENGTH)
    points, faces = faceted_tube(RADIUS, LENGTH, 48, beyond)
    ours = drop(surface_mesh(points, faces, network, SurfaceOptions(edge_ratio=0.7)))
    round_one = drop(lumen_mesh(network, MeshOptions(edge_ratio=0.7)))
    assert_allclose(ours, round_one, rtol=5e-3)
    # Flat facets would narrow the tube: a 24-gon of the same corners has 2.3 % less area.
    assert_allclose(ours, 1.0, rtol=5e-3)


@pytest.mark.parametrize(("noise", "passes"), first_rows([(0.1, 10), (0.0, 0)]))
def test_a_tube_of_voxels_flows_like_the_smooth_one(noise: float, passes: int) -> None:
    pytest.importorskip("netgen")
    volume, first, step = voxels_of_tube(RADIUS, LENGTH, 0.025, noise, np.random.default_rng(1))
    points, faces = isosurface(volume, first, step)
    options = SurfaceOptions(edge_ratio=0.6, smooth_passes=passes)
    mesh = surface_mesh(points, faces, straight(RADIUS, LENGTH), options)
    assert_allclose(drop(mesh), 1.0, rtol=2e-2)


def isosurface(volume: FloatArray, first: FloatArray, step: float) -> tuple[FloatArray, IntArray]:
    points, faces, _, _ = marching_cubes(volume, 0.5, spacing=(step,) * 3)
    points, faces = points.astype(np.float64) + first, faces.astype(np.int64)
    a, b, c = points[faces].transpose(1, 0, 2)
    turned = np.einsum("fd,fd->", a, np.cross(b, c)) < 0.0
    return points, faces[:, ::-1] if turned else faces


def test_ports_are_flat_and_where_the_network_ends() -> None:
    pytest.importorskip("netgen")
    points, faces = faceted_tube(RADIUS, LENGTH, 48, 0.3)
    mesh = surface_mesh(points, faces, straight(RADIUS, LENGTH), SurfaceOptions(edge_ratio=0.8))
    for number, port in enumerate(mesh.ports):
        on = mesh.points[mesh.faces[mesh.label == number + 1]]
        assert_allclose((on - port.centre) @ port.outward, 0.0, atol=1e-9)
        assert_allclose(port.radius_mm, RADIUS, rtol=5e-3)
        assert port.inlet == (port.node == 0)


def test_curved_edges_bulge_out_to_the_round_wall() -> None:
    pytest.importorskip("netgen")
    points, faces = faceted_tube(RADIUS, LENGTH, 32, 0.0)
    mesh = surface_mesh(points, faces, straight(RADIUS, LENGTH), SurfaceOptions(edge_ratio=0.8))
    wall = np.unique(mesh.faces[mesh.label == 0][:, 3:])
    off = np.hypot(*mesh.points[wall, :2].T) - RADIUS
    # The facets themselves lie up to r(1 - cos(π/32)) = 0.48 % inside; middles lie a little out,
    # for an edge's parabola to follow the arc in the mean.
    assert np.abs(off).max() < 3e-3 * RADIUS
    assert np.abs(off.mean()) < 1e-3 * RADIUS


def test_what_has_no_ends_and_what_misses_them_is_refused() -> None:
    points, faces = faceted_tube(RADIUS, LENGTH, 24, -0.2)
    with pytest.raises(FlowError, match=r"doesn't reach node 0 at \(0, 0, 0\) mm"):
        surface_mesh(points, faces, straight(RADIUS, LENGTH))
    one, faces = faceted_tube(RADIUS, 0.6, 24, 0.1)
    both = np.concatenate([one, one + [0.0, 0.0, LENGTH - 0.6]])
    with pytest.raises(FlowError, match="interrupted: its part at node 0 has no outlet"):
        surface_mesh(both, np.concatenate([faces, faces + len(one)]), straight(RADIUS, LENGTH))
    with pytest.raises(FlowError, match="smooth_passes -1"):
        SurfaceOptions(smooth_passes=-1)
    points, faces = faceted_tube(RADIUS, LENGTH, 8, 0.0)
    ring = straight(RADIUS, LENGTH)
    loop = network_of(ring.nodes, [(0, 1), (1, 0)], RADIUS)
    with pytest.raises(FlowError, match="no free ends"):
        surface_mesh(points, faces, loop)
