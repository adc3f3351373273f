"""Phantom block with vessels of exactly known walls, and its scan, without product code.

The design is a network of straight pieces in a block with three marks on its face; the print is
that, stretched, with walls moved where a defect is asked for; the scan samples the print's signed
distance voxel by voxel, lets light fade on its way down and adds speckle.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

import manifold3d
import numpy as np
from numpy.typing import NDArray

from benchmarks.registration.light import Light, cells_of, render

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

#: Sides of a vessel's polygon; of the circle's area.
SIDES = 96
#: Pieces that a vessel is cut into where its radius changes.
CUTS = 24


@dataclass(frozen=True)
class Design:
    """Vessels in a block.

    Attributes
    ----------
    name : str
    size : (3,) float64, mm
        The block, from the origin.
    node : (m, 3) float64, mm
    vessel : (n, 2) int64
        First and last node of each.
    radius : (n,) float64, mm
    marks : (k, 3) float64, mm
        Centres of half balls cut out of the block's faces.
    mark_mm : float
        Their radius.
    """

    name: str
    size: FloatArray
    node: FloatArray
    vessel: IntArray
    radius: FloatArray
    marks: FloatArray
    mark_mm: float = 0.3

    def mesh(self) -> tuple[NDArray[np.float32], NDArray[np.int32]]:
        """The block without its lumens and marks."""
        round_up = np.sqrt(np.pi / (0.5 * SIDES * np.sin(2 * np.pi / SIDES)))
        cuts = []
        for (a, b), r in zip(self.node[self.vessel], self.radius, strict=True):
            cuts.append(_rod(a, b, r * round_up))
        last = {int(k): float(r) for v, r in zip(self.vessel, self.radius, strict=True) for k in v}
        for v, r in zip(self.vessel, self.radius, strict=True):
            for k in v.tolist():
                last[k] = max(last[k], float(r))
        cuts += [_ball(self.node[k], r) for k, r in last.items()]
        cuts += [_ball(mark, self.mark_mm) for mark in self.marks]
        block = manifold3d.Manifold.cube(self.size.tolist())
        mesh = manifold3d.Manifold.batch_boolean([block, *cuts], manifold3d.OpType.Subtract)
        found = mesh.to_mesh()
        return np.asarray(found.vert_properties[:, :3]), np.asarray(found.tri_verts, np.int32)

    def csv(self) -> str:
        """The network in the product's own format, a piece a row."""
        head = "vessel,node0,node1,x0,y0,z0,x1,y1,z1,radius0_mm,radius1_mm,kind,tree"
        rows = [head]
        for k, ((a, b), r) in enumerate(zip(self.vessel.tolist(), self.radius, strict=True)):
            xyz = ",".join(
                f"{value!r}" for value in (*self.node[a].tolist(), *self.node[b].tolist())
            )
            rows.append(f"{k},{a},{b},{xyz},{float(r)!r},{float(r)!r},artery,0")
        return "\n".join(rows) + "\n"


@dataclass(frozen=True)
class Defect:
    """What went wrong in one vessel.

    Attributes
    ----------
    kind : "bulge", "stenosis", "occlusion", "leak" or "missing"
    vessel : int
    at : float
        Share of the vessel's length.
    size_mm : float
        How far a bulge's or stenosis' wall stands off; length of an occlusion; radius of a leak.
    """

    kind: str
    vessel: int
    at: float = 0.5
    size_mm: float = 0.06


@dataclass(frozen=True)
class Truth:
    """What the scan was made from; only checkers read it.

    Attributes
    ----------
    scan_from_part : (4, 4) float64
    stretch : (3,) float64
        Size of the print over the design's.
    """

    scan_from_part: FloatArray
    stretch: FloatArray


@dataclass(frozen=True)
class Setting:
    """How a phantom lies and is scanned.

    Attributes
    ----------
    shape : (nx, ny, nz)
    voxel_mm : (dx, dy, dz)
        Geometric.
    turn_deg, tilt_x_deg, tilt_y_deg : float, °
    shift_mm : (3,) float
        Of the part's middle from the field's.
    stretch : (3,) float
    wall_mm : float
        By how much every lumen's radius came out larger.
    light : Light
    defects : tuple of Defect
    """

    shape: tuple[int, int, int] = (1000, 500, 250)
    voxel_mm: tuple[float, float, float] = (0.015, 0.015, 0.012)
    turn_deg: float = 12.0
    tilt_x_deg: float = 0.0
    tilt_y_deg: float = 0.0
    shift_mm: tuple[float, float, float] = (0.0, 0.0, 0.0)
    stretch: tuple[float, float, float] = (0.98, 0.978, 0.975)
    wall_mm: float = 0.0
    light: Light = field(default_factory=Light)
    defects: tuple[Defect, ...] = ()


def planar(*, marked: bool = True) -> Design:
    """Four parallel channels of 0.4 to 0.8 mm between two manifolds; without marks symmetric."""
    size = np.array([11.0, 5.6, 2.2])
    ys, ends = [0.9, 2.1, 2.8, 3.4, 4.8], (1.6, 9.4)
    if not marked:
        ys = [0.9, 2.0, 2.8, 3.6, 4.7]
    node = [(0.0, 2.8)] + [(ends[0], y) for y in ys] + [(ends[1], y) for y in ys] + [(11.0, 2.8)]
    vessel = [(0, 3), (3, 2), (2, 1), (3, 4), (4, 5), (1, 6), (2, 7), (4, 9), (5, 10)]
    vessel += [(6, 7), (7, 8), (10, 9), (9, 8), (8, 11)]
    channels = [0.2, 0.25, 0.3, 0.4] if marked else [0.25, 0.3, 0.3, 0.25]
    radius = np.array([0.3] * 5 + channels + [0.3] * 5)
    marks = [(1.0, 0.8, 2.2), (10.0, 0.8, 2.2), (1.0, 4.8, 2.2)] if marked else []
    return Design(
        "planar" if marked else "symmetric",
        size,
        np.array([(x, y, 1.1) for x, y in node]),
        np.array(vessel),
        radius,
        np.array(marks, dtype=float).reshape(-1, 3),
    )


def branched() -> Design:
    """A tree of 15 vessels through the whole depth of a block 2.6 mm high."""
    size = np.array([11.0, 5.6, 2.6])
    node = [(0.0, 2.8, 1.3), (2.2, 2.8, 1.3)]
    vessel, radius = [(0, 1)], [0.4]
    for k, (y, z) in enumerate([(1.5, 0.8), (4.1, 1.8)]):
        node.append((4.6, y, z))
        vessel.append((1, 2 + k))
        radius.append(0.32)
    for k, (y, z) in enumerate([(0.7, 0.6), (2.2, 1.5), (3.3, 1.2), (4.9, 2.0)]):
        node.append((7.4, y, z))
        vessel.append((2 + k // 2, 4 + k))
        radius.append(0.25)
    tips = [
        (0.5, 1.6),
        (1.3, 0.5),
        (1.9, 2.0),
        (2.7, 0.7),
        (3.0, 1.9),
        (3.9, 0.6),
        (4.5, 1.3),
        (5.1, 2.1),
    ]
    for k, (y, z) in enumerate(tips):
        node.append((11.0, y, z))
        vessel.append((4 + k // 2, 8 + k))
        radius.append(0.2)
    return Design(
        "branched",
        size,
        np.array(node),
        np.array(vessel),
        np.array(radius),
        np.array([(1.0, 0.8, 2.6), (1.0, 4.9, 2.6), (9.8, 0.8, 2.6)]),
    )


def scan_of(design: Design, setting: Setting, seed: int) -> tuple[NDArray[np.uint16], Truth]:
    """The scan, (nz, ny, nx), depth downwards, and what it was made from."""
    truth = _truth(design, setting)
    pieces, radius = _pieces(design, setting)
    balls = np.column_stack([design.marks, np.full(len(design.marks), design.mark_mm)])
    cells = cells_of(design.size, pieces, radius, balls)
    to_part = np.linalg.inv(truth.scan_from_part)
    volume = render(
        setting.shape, setting.voxel_mm, to_part, design.size, pieces, radius, balls,
        _plugs(design, setting), cells, setting.light, seed,
    )  # fmt: skip
    return volume, truth


def _truth(design: Design, setting: Setting) -> Truth:
    turn, x, y = np.deg2rad([setting.turn_deg, setting.tilt_x_deg, setting.tilt_y_deg])
    about_z = np.array(
        [[np.cos(turn), -np.sin(turn), 0], [np.sin(turn), np.cos(turn), 0], [0, 0, 1]]
    )
    about_x = np.array([[1, 0, 0], [0, np.cos(x), -np.sin(x)], [0, np.sin(x), np.cos(x)]])
    about_y = np.array([[np.cos(y), 0, np.sin(y)], [0, 1, 0], [-np.sin(y), 0, np.cos(y)]])
    # The scan's depth runs down, the part's z up.
    rotation = np.diag([1.0, -1.0, -1.0]) @ about_y @ about_x @ about_z
    stretch = np.array(setting.stretch)
    field_mm = (np.array(setting.shape) - 1) * setting.voxel_mm
    middle = field_mm / 2 + np.array(setting.shift_mm)
    matrix = np.eye(4)
    matrix[:3, :3] = rotation * stretch
    matrix[:3, 3] = middle - matrix[:3, :3] @ (design.size / 2)
    return Truth(matrix, stretch)


def _pieces(design: Design, setting: Setting) -> tuple[FloatArray, FloatArray]:
    """Straight pieces (n, 6) with a radius at either end (n, 2), defects in them."""
    pieces, radii = [], []
    wrong: dict[int, list[Defect]] = {}
    for defect in setting.defects:
        wrong.setdefault(defect.vessel, []).append(defect)
    for number, ((a, b), r) in enumerate(
        zip(design.node[design.vessel], design.radius, strict=True)
    ):
        here = wrong.get(number, [])
        if any(defect.kind == "missing" for defect in here):
            continue
        share, radius = _profile(float(np.linalg.norm(b - a)), float(r) + setting.wall_mm, here)
        point = a + share[:, None] * (b - a)
        for k in range(len(share) - 1):
            pieces.append(np.concatenate([point[k], point[k + 1]]))
            radii.append((radius[k], radius[k + 1]))
        for defect in here:
            if defect.kind == "leak":
                at = a + defect.at * (b - a)
                pieces.append(np.concatenate([at, [at[0], at[1], design.size[2] + 1]]))
                radii.append((defect.size_mm, defect.size_mm))
    return np.array(pieces), np.array(radii)


def _plugs(design: Design, setting: Setting) -> FloatArray:
    """Occlusions as rows of middle, direction, half length and reach, (k, 8)."""
    found = [np.zeros((0, 8))]
    for defect in setting.defects:
        if defect.kind == "occlusion":
            a, b = design.node[design.vessel[defect.vessel]]
            way, half = (b - a) / np.linalg.norm(b - a), defect.size_mm / 2
            reach = half + 2 * float(design.radius[defect.vessel])
            found.append(np.array([[*(a + defect.at * (b - a)), *way, half, reach]]))
    return np.concatenate(found)


def _profile(length: float, r: float, defects: list[Defect]) -> tuple[FloatArray, FloatArray]:
    """Places along a vessel and the radius there."""
    bumps = [d for d in defects if d.kind in ("bulge", "stenosis")]
    if not bumps:
        return np.array([0.0, 1.0]), np.array([r, r])
    share = np.linspace(0, 1, 8 * CUTS + 1)
    radius = np.full(len(share), r)
    for d in bumps:
        sign = 1.0 if d.kind == "bulge" else -1.0
        width = max(0.35, 1.5 * r) / length
        radius += sign * d.size_mm * np.exp(-(((share - d.at) / width) ** 2))
    return share, radius


def moved(setting: Setting, **changes: Any) -> Setting:
    """The setting with some of it changed."""
    return replace(setting, **changes)


def _rod(a: FloatArray, b: FloatArray, r: float) -> manifold3d.Manifold:
    axis = (b - a) / np.linalg.norm(b - a)
    side = np.cross(axis, np.eye(3)[np.argmin(np.abs(axis))])
    side /= np.linalg.norm(side)
    frame = np.column_stack([side, np.cross(axis, side), axis, a])
    return manifold3d.Manifold.cylinder(float(np.linalg.norm(b - a)), r, r, SIDES).transform(frame)


def _ball(centre: FloatArray, r: float) -> manifold3d.Manifold:
    return manifold3d.Manifold.sphere(r, SIDES).translate(centre.tolist())
