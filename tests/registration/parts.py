"""Test parts for registration: solids by manifold3d, deposits by analytic distance."""

from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import manifold3d
import numpy as np

from design.network import VesselKind, VesselNetwork
from design.solids.solid import Solid
from gcode.deposit.lay import Deposit
from kernels.arrays import FloatArray
from registration.alignment import Fit
from registration.scan import Scan
from registration.segmentation import GelField, Segmentation
from registration.segmentation.mesh import surface_mesh
from sim.devices.scanner.placing import ScannerOutput
from tests.design.networks import network

HERE = Fit(np.eye(3), np.zeros(3), np.ones(3), np.zeros(3))
"""A scan that lies where the part does."""
PLACE = np.array([60.0, 50.0, 0.5])
BLOCK = (16.0, 8.0, 3.0)
DIMPLES = ((1.5, 1.0), (14.5, 1.0), (1.5, 7.0))
CHANNELS = {1.4: 0.4, 3.2: 0.5, 5.0: 0.6, 6.8: 0.8}


def planar_network() -> VesselNetwork:
    ys = [1.4, 3.2, 4.1, 5.0, 6.8]
    nodes = [(0, 4.1), *((3, y) for y in ys), *((13, y) for y in ys), (16, 4.1)]
    vessels = [(0, 3), (3, 2), (2, 1), (3, 4), (4, 5)]
    vessels += [(1, 6), (2, 7), (4, 9), (5, 10)]
    vessels += [(6, 7), (7, 8), (10, 9), (9, 8), (8, 11)]
    radius = [0.5] * 5 + [d / 2 for d in CHANNELS.values()] + [0.5] * 5
    return network([(x, y, 1.5) for x, y in nodes], vessels, radius, VesselKind.CHANNEL)


def bent_network() -> VesselNetwork:
    nodes = [[2, 2, 1], [5, 3, 3], [9, 2, 5], [8, 7, 4], [11, 9, 6], [4, 8, 6]]
    ends = [[0, 1], [1, 2], [1, 3], [3, 4], [3, 5]]
    radius = [0.6, 0.45, 0.5, 0.35, 0.35]
    return network(nodes, ends, radius)


def rod(start: FloatArray, end: FloatArray, radius: float, sides: int = 32) -> manifold3d.Manifold:
    axis = (end - start) / np.linalg.norm(end - start)
    side = np.cross(axis, [0.0, 0.0, 1.0] if abs(axis[2]) < 0.9 else [1.0, 0.0, 0.0])
    side /= np.linalg.norm(side)
    frame = np.column_stack([side, np.cross(axis, side), axis, start])
    length = float(np.linalg.norm(end - start))
    return manifold3d.Manifold.cylinder(length, radius, radius, sides).transform(frame)


def ball(centre: FloatArray, radius: float) -> manifold3d.Manifold:
    return manifold3d.Manifold.sphere(radius, 32).translate(tuple(centre))


def lumens(net: VesselNetwork) -> manifold3d.Manifold:
    shapes = []
    for points, radii in net.polylines():
        for a, b, r in zip(points[:-1], points[1:], radii[:-1], strict=True):
            shapes += [rod(a, b, r), ball(a, r), ball(b, r)]
    return manifold3d.Manifold.batch_boolean(shapes, manifold3d.OpType.Add)


def solid(shape: manifold3d.Manifold) -> Solid:
    mesh = shape.to_mesh()
    vertices = np.asarray(mesh.vert_properties[:, :3], dtype=np.float32).astype(float)
    return Solid(vertices, np.asarray(mesh.tri_verts, dtype=np.int32))


def planar_construct(dimples: tuple[tuple[float, float], ...] = DIMPLES) -> Solid:
    shape = manifold3d.Manifold.cube(BLOCK) - lumens(planar_network())
    for x, y in dimples:
        shape -= ball(np.array([x, y, BLOCK[2]]), 0.3)
    return solid(shape)


def lumen_distance(net: VesselNetwork, points: FloatArray) -> FloatArray:
    """Signed distance to the lumens' wall, negative inside; plain NumPy."""
    best = np.full(points.shape[:-1], np.inf)
    starts, ends, radii, _, _ = net.pieces()
    # By components: arrays of three-vectors take four times as long.
    for a, b, r in zip(starts, ends, radii, strict=True):
        x, y, z = (points[..., k] - a[k] for k in range(3))
        along = b - a
        t = np.clip((x * along[0] + y * along[1] + z * along[2]) / (along @ along), 0, 1)
        squared = (x - t * along[0]) ** 2 + (y - t * along[1]) ** 2 + (z - t * along[2]) ** 2
        best = np.minimum(best, np.sqrt(squared) - r)
    return best


def planar_distance(points: FloatArray) -> FloatArray:
    """Signed distance to the planar part's material, negative inside (a bound near edges)."""
    half = np.array(BLOCK) / 2
    box = (np.abs(points - half) - half).max(axis=-1)
    void = lumen_distance(planar_network(), points)
    for x, y in DIMPLES:
        centre = np.array([x, y, BLOCK[2]])
        void = np.minimum(void, np.linalg.norm(points - centre, axis=-1) - 0.3)
    return np.maximum(box, -void)


def analytic_deposit(
    distance: Callable[[FloatArray], FloatArray], low: FloatArray, high: FloatArray, voxel: float
) -> Deposit:
    """Voxels filled by the signed distance of their centre; part frame moved by PLACE."""
    count = np.ceil((high - low) / voxel).astype(int) + 2
    origin = low - voxel / 2
    volume = np.empty(count[::-1], dtype=np.uint8)
    y, x = np.meshgrid(*(origin[k] + voxel * np.arange(count[k]) for k in (1, 0)), indexing="ij")
    for k in range(count[2]):
        points = np.stack([x, y, np.full_like(x, origin[2] + voxel * k)], axis=-1)
        volume[k] = 255 * np.clip(0.5 - distance(points) / voxel, 0, 1)
    return Deposit(volume, origin + PLACE, voxel, "layered", 0.0, 0.0)


@cache
def planar_deposit(voxel: float) -> Deposit:
    made = analytic_deposit(planar_distance, np.zeros(3), np.array(BLOCK), voxel)
    made.volume.flags.writeable = False
    return made


def segmented(
    values: FloatArray, voxel_mm: Any, origin_mm: Any, blur_mm: float = 0.0, **more: Any
) -> Segmentation:
    """The scan whose field has these shares of gel, (nz, ny, nx); ``more`` as for Segmentation."""
    voxel = np.broadcast_to(voxel_mm, 3).astype(float)
    share, origin = np.asarray(values, np.float32), np.asarray(origin_mm, float)
    field = GelField(share, 0.5, 1.0, voxel, origin, blur_mm)
    known = {"contrast": 10.0, "strength": None} | more
    return Segmentation(field, *surface_mesh(field, None, 0.3), **known)


def as_scan(scanned: ScannerOutput) -> Scan:
    return Scan(
        volume=scanned.volume,
        voxel_mm=scanned.voxel_mm,
        refractive_index=scanned.refractive_index,
        optical_depth=scanned.optical_depth,
        scale=scanned.scale,
        modality=scanned.modality,
        depth_down=scanned.depth_down,
        came_from=Path("simulated"),
    )


def corners(size: tuple[float, float, float]) -> FloatArray:
    return np.array([[x, y, z] for x in (0, size[0]) for y in (0, size[1]) for z in (0, size[2])])


def target_error(part: FloatArray, scan_to_part: FloatArray, pose_truth: FloatArray) -> float:
    """Largest distance, mm, between part points and where truth and registration put them."""
    scan = (part + PLACE) @ pose_truth[:3, :3].T + pose_truth[:3, 3]
    back = scan @ scan_to_part[:3, :3].T + scan_to_part[:3, 3]
    return float(np.linalg.norm(back - part, axis=1).max())
