"""Test parts: convex bodies with channels of many kinds, and their files."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import manifold3d
import numpy as np
import trimesh
from scipy.interpolate import CubicSpline

NO_CYLINDER = (0.0, 0.0, 1e6)
BODY_FACETS = 256


@dataclass(frozen=True)
class Body:
    """A convex body in the part's frame, mm; its bounding box begins at 0.

    ``planes`` (n, 4): outward unit normals and offsets, inside is ``normal @ p <= offset``;
    ``cylinder``: axis' x and y and radius of one along z, 1e6 for none.
    """

    size: np.ndarray
    planes: np.ndarray
    cylinder: tuple[float, float, float] = NO_CYLINDER

    def depth(self, points: np.ndarray) -> np.ndarray:
        """Distance of points (n, 3) outwards beyond the surface, mm; negative inside."""
        flat = (points @ self.planes[:, :3].T - self.planes[:, 3]).max(axis=1)
        x, y, radius = self.cylinder
        return np.asarray(np.maximum(flat, np.hypot(points[:, 0] - x, points[:, 1] - y) - radius))

    def solid(self) -> Any:
        """The body as a manifold."""
        x, y, radius = self.cylinder
        if radius < 1e5:
            whole = manifold3d.Manifold.cylinder(self.size[2], radius, radius, BODY_FACETS)
            whole = whole.translate((x, y, 0.0))
        else:
            whole = manifold3d.Manifold.cube(self.size)
        for *normal, offset in self.planes:
            whole = whole.trim_by_plane([-v for v in normal], -offset)
        return whole


def box_planes(size: np.ndarray) -> np.ndarray:
    """Return the six planes of a box from 0 to `size` (mm)."""
    sides = zip(np.eye(3), size, strict=True)
    return np.array([row for normal, s in sides for row in ([*normal, s], [*-normal, 0.0])])


def block(x: float, y: float, z: float) -> Body:
    """Return a box."""
    size = np.array([x, y, z])
    return Body(size, box_planes(size))


def cylinder(diameter: float, height: float) -> Body:
    """Return a cylinder that stands on its end."""
    size = np.array([diameter, diameter, height])
    return Body(size, box_planes(size)[4:], (diameter / 2, diameter / 2, diameter / 2))


def wedge(x: float, y: float, z: float, drop: float = 0.25, chamfer: float = 1.2) -> Body:
    """Return a box whose top falls by `drop` of its height along x, one upright edge chamfered."""
    size = np.array([x, y, z])
    top = np.array([drop * z / x, 0.0, 1.0])
    top /= np.linalg.norm(top)
    edge = np.array([1.0, 1.0, 0.0]) / np.sqrt(2)
    corner = np.array([x, y, 0.0])
    extra = [[*top, top @ [0, 0, z]], [*edge, edge @ corner - chamfer / np.sqrt(2)]]
    return Body(size, np.vstack([box_planes(size), extra]))


PIECE_MM = 0.25


@dataclass(frozen=True)
class Vessel:
    """A polyline ``points`` (n, 3) with ``radius`` (n,) from node to node, mm."""

    nodes: tuple[int, int]
    points: np.ndarray
    radius: np.ndarray

    @property
    def along(self) -> np.ndarray:
        """Length from the start to each point, mm."""
        steps = np.linalg.norm(np.diff(self.points, axis=0), axis=1)
        return np.append(0.0, np.cumsum(steps))

    def at(self, along: np.ndarray | float) -> np.ndarray:
        """Return points at lengths along it, mm; shape (..., 3)."""
        return np.stack([np.interp(along, self.along, c) for c in self.points.T], axis=-1)

    def radius_at(self, along: np.ndarray | float) -> np.ndarray:
        """Return designed radii at lengths along it, mm."""
        return np.asarray(np.interp(along, self.along, self.radius))


@dataclass
class Design:
    """A body and its vessels; part frame, mm."""

    body: Body
    nodes: list[tuple[float, float, float]] = field(default_factory=list)
    vessels: list[Vessel] = field(default_factory=list)

    def node(self, x: float, y: float, z: float) -> int:
        """Add a node; return its number."""
        self.nodes.append((float(x), float(y), float(z)))
        return len(self.nodes) - 1

    def place(self, *points: tuple[float, float, float]) -> list[int]:
        """Add nodes; return their numbers."""
        return [self.node(*point) for point in points]

    def add(
        self, a: int, b: int, diameters: tuple[float, ...], bend: tuple[float, ...] = ()
    ) -> None:
        """Add a vessel between two nodes.

        Diameters (mm) are spread evenly along it. `bend` (x, y, z, mm) moves the middle of a
        spline aside; without it the vessel is straight.
        """
        ends = np.array([self.nodes[a], self.nodes[b]])
        points = curve(ends, np.array(bend)) if bend else ends
        if len(diameters) > 1 and not bend:
            points = np.linspace(ends[0], ends[1], 9)
        known = np.resize(diameters, max(len(diameters), 2))
        share = np.linspace(0, len(known) - 1, len(points))
        radius = np.interp(share, np.arange(len(known)), known) / 2
        self.vessels.append(Vessel((a, b), points, radius))

    def open_ends(self, vessel: int) -> tuple[bool, bool]:
        """Whether a vessel's start and end lie on the body's surface."""
        ends = self.vessels[vessel].points[[0, -1]]
        first, last = np.abs(self.body.depth(ends)) < 1e-6
        return bool(first), bool(last)


def curve(ends: np.ndarray, bend: np.ndarray) -> np.ndarray:
    """Return points of an S-shaped spline through two ends, its middle moved by `bend`."""
    share = np.array([0, 0.25, 0.5, 0.75, 1])
    knots = ends[0] + share[:, None] * (ends[1] - ends[0])
    knots += np.outer([0, 0.9, 1, 0.35, 0], bend)
    pieces = max(4, int(np.linalg.norm(ends[1] - ends[0]) / PIECE_MM))
    return np.asarray(CubicSpline(share, knots)(np.linspace(0, 1, pieces + 1)))


def curved() -> Design:
    """Return a block with a curved branching tree and a tapering channel, seven vessels."""
    d = Design(block(10, 8, 2.8))
    n = d.place(
        (0, 3.2, 1.3),
        (3, 3.6, 1.4),
        (6, 2.4, 1.6),
        (5.8, 5.2, 1.2),
        (10, 1.2, 1.5),
        (10, 3.4, 1.3),
        (10, 4.9, 1.5),
        (7.6, 8, 1.2),
        (0, 6.3, 1.6),
        (4.6, 6.9, 1.3),
    )
    d.add(n[0], n[1], (0.9, 0.8), (0, 0.35, 0.1))
    d.add(n[1], n[2], (0.7,), (0.1, -0.3, 0))
    d.add(n[1], n[3], (0.66,), (-0.2, 0.2, 0))
    d.add(n[2], n[4], (0.55, 0.45), (0, -0.3, 0.15))
    d.add(n[2], n[5], (0.5,), (0, 0.25, 0))
    d.add(n[3], n[6], (0.52, 0.42), (0, 0.3, -0.1))
    d.add(n[3], n[7], (0.44,), (0.2, 0.1, 0))
    d.add(n[8], n[9], (0.6, 0.35))
    return d


def slanted() -> Design:
    """Return a wedge with a chamfer and five vessels, one bent."""
    d = Design(wedge(9, 7.5, 2.9))
    n = d.place(
        (0, 1.4, 1.2),
        (9, 1.9, 1.0),
        (0, 3.6, 1.6),
        (4.2, 3.4, 1.2),
        (9, 4.6, 0.9),
        (0, 5.9, 1.4),
        (6.2, 7.5, 1.2),
    )
    d.add(n[0], n[1], (0.45,), (0, 0.1, 0.2))
    d.add(n[2], n[3], (0.7,))
    d.add(n[3], n[4], (0.55, 0.4))
    d.add(n[5], n[6], (0.5,), (0.3, -0.4, 0))
    return d


def compact() -> Design:
    """Return a small chunky block that can lie on any face, four vessels."""
    d = Design(block(4.6, 4.0, 3.4))
    n = d.place(
        (0, 1.1, 1.1),
        (2.1, 1.6, 1.5),
        (4.6, 1.0, 2.3),
        (2.6, 4.0, 1.9),
        (0, 2.9, 2.3),
        (1.6, 2.9, 3.4),
    )
    d.add(n[0], n[1], (0.6,))
    d.add(n[1], n[2], (0.45,), (0, -0.2, 0.1))
    d.add(n[1], n[3], (0.4,))
    d.add(n[4], n[5], (0.36,), (0.3, 0, -0.3))
    return d


def rim(degrees: float, z: float) -> tuple[float, float, float]:
    """Return a point on the drum's side, mm."""
    angle = np.radians(degrees)
    return (float(3.75 + 3.75 * np.cos(angle)), float(3.75 + 3.75 * np.sin(angle)), z)


def drum() -> Design:
    """Return a cylinder with a branching and a bent channel."""
    d = Design(cylinder(7.5, 2.8))
    n = d.place(
        rim(180, 1.3), (3.2, 3.5, 1.4), rim(20, 1.6), rim(-50, 1.2), rim(130, 1.5), rim(70, 1.1)
    )
    d.add(n[0], n[1], (0.8, 0.7))
    d.add(n[1], n[2], (0.5,), (0, 0.3, 0))
    d.add(n[1], n[3], (0.6,))
    d.add(n[4], n[5], (0.4,), (0, -0.5, 0.2))
    return d


DESIGNS = {f.__name__: f for f in (curved, slanted, compact, drum)}


HEADER = "vessel,node0,node1,x0,y0,z0,x1,y1,z1,radius0_mm,radius1_mm,kind,tree"
BEYOND_MM = 0.4
FACETS = 96


def write_design(design: Design, folder: Path) -> None:
    """Write both files into a folder; nodes within a vessel get numbers of their own."""
    folder.mkdir(parents=True, exist_ok=True)
    lines, free = [HEADER], len(design.nodes)
    for number, vessel in enumerate(design.vessels):
        inner = list(range(free, free + len(vessel.points) - 2))
        free += len(inner)
        names = [vessel.nodes[0], *inner, vessel.nodes[1]]
        for k in range(len(names) - 1):
            values = [*vessel.points[k], *vessel.points[k + 1], *vessel.radius[k : k + 2]]
            text = ",".join(repr(float(v)) for v in values)
            lines.append(f"{number},{names[k]},{names[k + 1]},{text},channel,0")
    (folder / "network.csv").write_text("\n".join(lines) + "\n")
    write_stl(design.body.solid() - lumens(design), folder / "part.stl")


def lumens(design: Design) -> Any:
    """Return the lumens as a manifold that sticks out of the body where a vessel is open."""
    parts = []
    for number, vessel in enumerate(design.vessels):
        points, radius = vessel.points.copy(), vessel.radius
        for is_open, end, inner in zip(design.open_ends(number), (0, -1), (1, -2), strict=True):
            if is_open:
                outwards = points[end] - points[inner]
                points[end] += BEYOND_MM * outwards / np.linalg.norm(outwards)
            else:
                ball = manifold3d.Manifold.sphere(float(radius[end]), FACETS)
                parts.append(ball.rotate((17, 29, 41 + 7 * number)).translate(tuple(points[end])))
        parts.append(sweep(points, radius))
    return manifold3d.Manifold.batch_boolean(parts, manifold3d.OpType.Add)


def sweep(points: np.ndarray, radius: np.ndarray, sides: int = FACETS) -> Any:
    """Return a closed tube along a polyline, its rings halving the angles between pieces."""
    steps = np.diff(points, axis=0)
    steps /= np.linalg.norm(steps, axis=1)[:, None]
    tangent = np.vstack([steps[:1], steps[:-1] + steps[1:], steps[-1:]])
    tangent /= np.linalg.norm(tangent, axis=1)[:, None]
    angle = np.linspace(0, 2 * np.pi, sides, endpoint=False)[:, None]
    side, rings = np.linalg.svd(tangent[:1])[2][1], []
    for point, axis, wide in zip(points, tangent, radius, strict=True):
        side = side - axis * (side @ axis)
        side /= np.linalg.norm(side)
        rings.append(point + wide * (np.cos(angle) * side + np.sin(angle) * np.cross(axis, side)))
    here, low, high = np.arange(sides), sides * len(points), sides * len(points) + 1
    after = (here + 1) % sides
    faces = [np.column_stack([np.full(sides, low), after, here])]
    for a in range(0, low - sides, sides):
        b = a + sides
        faces += [
            np.column_stack([a + here, a + after, b + after]),
            np.column_stack([a + here, b + after, b + here]),
        ]
    last = low - sides
    faces.append(np.column_stack([np.full(sides, high), last + here, last + after]))
    vertices = np.vstack([*rings, points[:1], points[-1:]]).astype(np.float32)
    return manifold3d.Manifold(manifold3d.Mesh(vertices, np.vstack(faces).astype(np.uint32)))


def write_stl(solid: Any, path: Path) -> None:
    """Write a manifold as binary STL; raise ValueError if it isn't closed."""
    # Slivers that float32 would close are taken out first.
    mesh = solid.simplify(5e-4).to_mesh()
    vertices = np.asarray(mesh.vert_properties)[:, :3]
    out = trimesh.Trimesh(vertices, np.asarray(mesh.tri_verts), process=False)
    out.merge_vertices()
    out.update_faces(out.nondegenerate_faces())
    if not out.is_watertight:
        raise ValueError(f"{path} is not closed")
    out.export(path)
