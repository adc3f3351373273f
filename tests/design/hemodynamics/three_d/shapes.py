"""Test networks for 3D meshes, and volumes and areas by independent integrals."""

import numpy as np

from design.hemodynamics.three_d import LumenMesh
from design.network import VesselNetwork
from kernels.arrays import FloatArray
from tests.design.hemodynamics.networks import network_of
from tests.design.networks import polyline

# det J is a cubic, and collapsing takes two degrees: three points are exact.
_AT, _WEIGHT = np.polynomial.legendre.leggauss(3)


def mesh_volume(mesh: LumenMesh) -> float:
    """∫ det J over quadratic tetrahedra, by Gauss's points on a collapsed cube, mm³."""
    a, b, c = (0.5 * (g.ravel() + 1.0) for g in np.meshgrid(_AT, _AT, _AT, indexing="ij"))
    weight = np.einsum("i,j,k->ijk", _WEIGHT, _WEIGHT, _WEIGHT).ravel() / 8.0
    weight *= (1.0 - a) ** 2 * (1.0 - b)
    x, y, z = a, (1.0 - a) * b, (1.0 - a) * (1.0 - b) * c
    total = 0.0
    step = 1e-5
    node = mesh.points[mesh.tets]
    for xi, w in zip(np.stack([x, y, z], axis=1), weight, strict=True):
        moved = xi + step * np.array([1.0, -1.0])[:, None, None] * np.eye(3)
        ahead, back = (np.einsum("cn,tnx->tcx", _quadratic(p), node) for p in moved)
        total += w * float(np.linalg.det((ahead - back) / (2.0 * step)).sum())
    return total


def _quadratic(at: FloatArray) -> FloatArray:
    """VTK's quadratic tetrahedron, (c, 10)."""
    x, y, z = at.T
    w = 1.0 - x - y - z
    corners = [v * (2.0 * v - 1.0) for v in (w, x, y, z)]
    return np.stack([*corners, 4 * w * x, 4 * x * y, 4 * y * w, 4 * w * z, 4 * x * z, 4 * y * z], 1)


def port_area(mesh: LumenMesh, port: int) -> float:
    """By Green's theorem along the rim's parabolas, mm²."""
    faces = mesh.faces[mesh.label == port + 1]
    at = mesh.points - mesh.ports[port].centre
    total = 0.0
    for first, last, middle in ((0, 1, 3), (1, 2, 4), (2, 0, 5)):
        a, b, m = (at[faces[:, k]] for k in (first, last, middle))
        # ½ ∫ r × dr of the parabola through a, m, b; inner edges cancel.
        chord = np.cross(a, b) / 2.0
        bulge = 2.0 / 3.0 * np.cross(m - 0.5 * (a + b), b - a)
        total += float(((chord + bulge) @ mesh.ports[port].outward).sum())
    return total


def straight(radius: float = 0.5, length: float = 4.0, taper: float = 1.0) -> VesselNetwork:
    """One vessel, askew."""
    end = length * np.array([2.0, 1.0, -2.0]) / 3.0
    network = network_of([[1.0, 2.0, 3.0], (end + [1.0, 2.0, 3.0])], [(0, 1)], radius)
    network.radius[1] *= taper
    return network


def bent(pieces: int, radius: float = 0.4, turn: float = 2.0) -> VesselNetwork:
    """A quarter of a ring, drawn by so many pieces."""
    angle = np.linspace(0.0, 0.5 * np.pi, pieces + 1)
    points = turn * np.stack([np.cos(angle), np.sin(angle), np.zeros(pieces + 1)], axis=1)
    return polyline(points, radius)


def cross() -> VesselNetwork:
    """Four vessels at a node."""
    nodes = [[0.0, 0, 0], [-3, 0, 0], [2.6, 1.5, 0], [2.6, -1.5, 0.3], [0.3, 0.2, 3]]
    return network_of(nodes, [(1, 0), (0, 2), (0, 3), (0, 4)], [0.5, 0.4, 0.35, 0.3])


def ring() -> VesselNetwork:
    """A loop with an inlet and an outlet."""
    nodes = [[-3.0, 0, 0], [0, 0, 0], [1.5, 1.5, 0], [1.5, -1.5, 0], [3, 0, 0], [6, 0, 0]]
    ends = [(0, 1), (1, 2), (1, 3), (2, 4), (3, 4), (4, 5)]
    return network_of(nodes, ends, [0.5, 0.35, 0.35, 0.35, 0.35, 0.5])


def thick_and_thin() -> VesselNetwork:
    """A twig of a twentieth of its parent's radius."""
    nodes = [[0.0, 0, 0], [4, 0, 0], [8, 0, 0], [4, 1.6, 0]]
    return network_of(nodes, [(0, 1), (1, 2), (1, 3)], [1.0, 1.0, 0.05])


def crowded() -> VesselNetwork:
    """Two forks nearer to one another than they are wide."""
    nodes = [[0.0, 0, 0], [3, 0, 0], [3.5, 0.1, 0], [5, 2.5, 0], [6.5, 0.4, 0], [5, -2.2, 0.2]]
    return network_of(nodes, [(0, 1), (1, 2), (1, 5), (2, 3), (2, 4)], [0.5, 0.42, 0.3, 0.3, 0.35])


def random_fork(seed: int) -> VesselNetwork:
    """Two to four vessels about a node, with bends and radii of their own."""
    rng = np.random.default_rng(seed)
    count = int(rng.integers(2, 5))
    while True:
        way = rng.normal(size=(count, 3))
        way /= np.linalg.norm(way, axis=1)[:, None]
        apart = way @ way.T - 2.0 * np.eye(count)
        if apart.max() < np.cos(0.6):
            break
    radius = np.exp(rng.uniform(np.log(0.1), np.log(0.5), count))
    far = way * (6.0 * radius.max() + rng.uniform(0.0, 2.0, count))[:, None]
    nodes = np.concatenate([np.zeros((1, 3)), far])
    ends = [(1, 0)] + [(0, k + 1) for k in range(1, count)]
    return network_of(nodes, ends, radius.tolist())
