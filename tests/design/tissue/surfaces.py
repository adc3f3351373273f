"""Test surfaces: spheres, tori, shells; whether one is closed."""

import numpy as np
import trimesh
from manifold3d import Manifold

from design.tissue import Surface


def surface(solid):
    mesh = solid.to_mesh64()
    return Surface(
        np.array(mesh.vert_properties, dtype=np.float64)[:, :3],
        np.array(mesh.tri_verts, dtype=np.int32),
    )


def closed(shape):
    mesh = trimesh.Trimesh(shape.vertices, shape.faces, process=False)
    return mesh.is_watertight and mesh.is_winding_consistent


def joined(*shapes):
    """Vertices and faces of several surfaces as one."""
    first = np.cumsum([0, *(len(one.vertices) for one in shapes)])
    faces = [one.faces + k for one, k in zip(shapes, first, strict=False)]
    return np.concatenate([one.vertices for one in shapes]), np.concatenate(faces)


def sphere(radius, sides=64):
    return Manifold.sphere(radius, sides)


def hollow_sphere(outer=10.0, inner=6.0):
    return surface(sphere(outer) - sphere(inner))


def torus(large=8.0, small=3.0, sides=64):
    angle = 2 * np.pi * np.arange(sides) / sides
    i, j = np.meshgrid(angle, angle, indexing="ij")
    ring = large + small * np.cos(j)
    points = np.stack([ring * np.cos(i), ring * np.sin(i), small * np.sin(j)], -1).reshape(-1, 3)
    a, b = np.meshgrid(np.arange(sides), np.arange(sides), indexing="ij")
    here, right = a * sides + b, a * sides + (b + 1) % sides
    up, across = (a + 1) % sides * sides + b, (a + 1) % sides * sides + (b + 1) % sides
    faces = np.concatenate([np.stack([here, up, across], -1), np.stack([here, across, right], -1)])
    return Surface(points, faces.reshape(-1, 3).astype(np.int32))


def nested_shells():
    """Shell from radius 10 to 8, and in its cavity another from 6 to 3."""
    return surface(sphere(10.0) - sphere(8.0) + (sphere(6.0) - sphere(3.0)))


def thin_box(wall=0.3):
    """Box of 12 mm with 3 mm walls, but for the one at high z: ``wall``."""
    outer = Manifold.cube((12.0, 12.0, 12.0))
    inner = Manifold.cube((6.0, 6.0, 9.0 - wall)).translate((3.0, 3.0, 3.0))
    return surface(outer - inner)


def slit_block():
    """Block of 12 mm with a slanted slit far thinner than a cell, and a slanted needle hole."""
    slit = Manifold.cube((0.004, 9.0, 8.0)).rotate((0.0, 20.0, 10.0)).translate((5.0, 1.0, 5.0))
    hole = Manifold.cylinder(7.0, 0.3, 0.01, 8).rotate((0.0, 35.0, 0.0)).translate((1.0, 6.0, 0.0))
    return surface(Manifold.cube((12.0, 12.0, 12.0)) - slit - hole)
