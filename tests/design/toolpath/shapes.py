"""Test solids and networks of closed-form geometry."""

import manifold3d
import numpy as np
import shapely

from design.network import VesselNetwork
from design.solids.solid import Solid
from design.toolpath import MoveKind, Toolpath
from tests.design.networks import network

SEGMENTS = 128


def as_solid(body: manifold3d.Manifold) -> Solid:
    mesh = body.to_mesh()
    return Solid(
        np.asarray(mesh.vert_properties[:, :3], dtype=np.float64),
        np.asarray(mesh.tri_verts, dtype=np.int32),
    )


def block(x: float, y: float, z: float) -> manifold3d.Manifold:
    return manifold3d.Manifold.cube([x, y, z])


def upright(x: float, y: float, diameter: float) -> manifold3d.Manifold:
    """A cylinder along z through everything."""
    return manifold3d.Manifold.cylinder(20, diameter / 2, circular_segments=SEGMENTS).translate(
        [x, y, -10]
    )


def along_x(y: float, z: float, diameter: float) -> manifold3d.Manifold:
    """A cylinder along x through everything."""
    bar = manifold3d.Manifold.cylinder(40, diameter / 2, circular_segments=SEGMENTS)
    return bar.rotate([0, 90, 0]).translate([-20, y, z])


def planar_block() -> manifold3d.Manifold:
    """The planar four-vessel block without its dimples, 16 × 8 × 3 mm."""
    body = block(16, 8, 3)
    for y, diameter in ((1.4, 0.4), (3.2, 0.5), (5.0, 0.6), (6.8, 0.8)):
        body -= along_x(y, 1.5, diameter) ^ block(10, 8, 3).translate([3, 0, 0])
    for x in (3.0, 13.0):
        header = manifold3d.Manifold.cylinder(5.4, 0.5, circular_segments=SEGMENTS)
        body -= header.rotate([-90, 0, 0]).translate([x, 1.4, 1.5])
    for low in (-1.0, 13.0):
        body -= along_x(4.1, 1.5, 1.0) ^ block(4, 8, 3).translate([low, 0, 0])
    return body


def written_area(toolpath: Toolpath, layer: int) -> shapely.Geometry:
    """Everything within half a line of a layer's centrelines: exact stadiums."""
    move = np.flatnonzero((toolpath.source == layer) & (toolpath.kind == MoveKind.WRITE))
    area = toolpath.volume_ul[move] / toolpath.lengths[move]
    width = rounded_width(area, toolpath.layer_height_mm)
    ends = np.stack([toolpath.start[move, :2], toolpath.end[move, :2]], axis=1)
    return shapely.union_all(shapely.buffer(shapely.linestrings(ends), width / 2, quad_segs=64))


def rounded_width(area_mm2: np.ndarray, height_mm: float) -> np.ndarray:
    """Width of lines with round sides: a rectangle between two half circles."""
    round_part = np.pi / 4 * height_mm**2
    assert (area_mm2 > round_part).all()
    return (area_mm2 - round_part) / height_mm + height_mm


def helix(turns: float, radius_mm: float, pitch_mm: float, phase: float = 0.0) -> np.ndarray:
    """Points along a helix, upward."""
    turn = np.linspace(0, 2 * np.pi * turns, int(64 * turns) + 1)
    x, y = radius_mm * np.cos(turn + phase), radius_mm * np.sin(turn + phase)
    return np.column_stack([x, y, pitch_mm * turn / (2 * np.pi)])


def ring(radius_mm: float, tilt: float) -> np.ndarray:
    """Points around a circle, closed exactly, raised on one side by a tilt in rad."""
    turn = np.linspace(0, 2 * np.pi, 65)
    flat = np.cos(tilt) * np.sin(turn)
    line = radius_mm * np.column_stack([np.cos(turn), flat, np.sin(tilt) * np.sin(turn)])
    line[-1] = line[0]
    return line


def cage(bars: int, radius_mm: float, height_mm: float) -> VesselNetwork:
    """Uprights between a ring of straight vessels at the bottom and one at the top."""
    turn = 2 * np.pi * np.arange(bars) / bars
    nodes = [
        (radius_mm * np.cos(t), radius_mm * np.sin(t), z) for z in (0.0, height_mm) for t in turn
    ]
    upright = [(k, k + bars) for k in range(bars)]
    rings = [(low + k, low + (k + 1) % bars) for low in (0, bars) for k in range(bars)]
    return network(nodes, upright + rings, 0.15)


def random_tree(terminals: int, size_mm: float, seed: int, thinnest_mm: float) -> VesselNetwork:
    """A branching tree in a cube; each new terminal joins the nearest segment."""
    rng = np.random.default_rng(seed)
    nodes = [np.array([0, 0, -size_mm / 2]), np.array([0, 0, -size_mm / 4])]
    vessels = [(0, 1)]
    for _ in range(terminals - 1):
        tip = rng.uniform(-size_mm / 2, size_mm / 2, 3)
        gaps = [np.linalg.norm((nodes[a] + nodes[b]) / 2 - tip) for a, b in vessels]
        nearest = int(np.argmin(gaps))
        a, b = vessels[nearest]
        fork = len(nodes)
        nodes += [0.8 * (nodes[a] + nodes[b]) / 2 + 0.2 * tip, tip]
        vessels[nearest] = (a, fork)
        vessels += [(fork, b), (fork, fork + 1)]
    children: dict[int, list[int]] = {}
    for a, b in vessels:
        children.setdefault(a, []).append(b)

    def leaves(node: int) -> int:
        return sum(map(leaves, children[node])) if node in children else 1

    radius = [thinnest_mm * leaves(b) ** (1 / 3) for _, b in vessels]
    return network([tuple(node) for node in nodes], vessels, radius)
