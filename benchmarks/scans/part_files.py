"""Write a design as network.csv (docs/networks.md) and part.stl."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import manifold3d
import numpy as np
import trimesh

from benchmarks.scans.designs import Design

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


def sweep(points: np.ndarray, radius: np.ndarray) -> Any:
    """Return a closed tube along a polyline, its rings halving the angles between pieces."""
    steps = np.diff(points, axis=0)
    steps /= np.linalg.norm(steps, axis=1)[:, None]
    tangent = np.vstack([steps[:1], steps[:-1] + steps[1:], steps[-1:]])
    tangent /= np.linalg.norm(tangent, axis=1)[:, None]
    angle = np.linspace(0, 2 * np.pi, FACETS, endpoint=False)
    side, rings = np.linalg.svd(tangent[:1])[2][1], []
    for point, axis, wide in zip(points, tangent, radius, strict=True):
        side = side - axis * (side @ axis)
        side /= np.linalg.norm(side)
        other = np.cross(axis, side)
        rings.append(
            point + wide * (np.cos(angle)[:, None] * side + np.sin(angle)[:, None] * other)
        )
    vertices = np.vstack([*rings, points[:1], points[-1:]])
    here = np.arange(FACETS)
    after, low, high = (here + 1) % FACETS, len(vertices) - 2, len(vertices) - 1
    faces = [np.column_stack([np.full(FACETS, low), after, here])]
    for k in range(len(points) - 1):
        a, b = k * FACETS, (k + 1) * FACETS
        faces += [
            np.column_stack([a + here, a + after, b + after]),
            np.column_stack([a + here, b + after, b + here]),
        ]
    last = (len(points) - 1) * FACETS
    faces.append(np.column_stack([np.full(FACETS, high), last + here, last + after]))
    mesh = manifold3d.Mesh(vertices.astype(np.float32), np.vstack(faces).astype(np.uint32))
    return manifold3d.Manifold(mesh)


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
