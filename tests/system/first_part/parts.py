"""Unseen sound parts, drawn from a seed, with the recipe that a user would write."""

from __future__ import annotations

import csv
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import manifold3d
import numpy as np
import trimesh
import yaml
from numpy.typing import NDArray

from tests.system.first_part.surface import Walls, hits

Points = NDArray[np.float64]

SHAPES = ("ellipsoid", "slant", "L", "T", "tube", "wedge", "organ")
MAX_TRIES = 200

LARGE_MM = 25.0
"""Larger parts get wider lumens and coarser micro-CT."""

CELLS_PER_TERMINAL = 40
"""Room of a terminal and its trunk, in cubes of lumen and wall."""


@dataclass(frozen=True)
class Style:
    """How a part is printed and scanned: facts that follow from the method and the needle."""

    method: str
    needle: str
    lumen_mm: tuple[float, float]
    wall_mm: float
    layer_um: float | None = None
    line_um: float | None = None


FINE = Style("fresh", "fresh_150um", (0.4, 0.8), 0.3)
COARSE = Style("fresh", "27g", (0.8, 1.2), 0.5, layer_um=100, line_um=210)
EMBEDDED = Style("embedded", "30g", (0.4, 0.7), 0.5)


@dataclass(frozen=True)
class Part:
    """A sound part: its surface, its own network if any, and its recipe."""

    name: str
    shape: str
    mesh: trimesh.Trimesh
    network: list[tuple[float, float, float, float, int]] | None
    recipe: dict[str, Any]
    style: Style

    def write(self, folder: Path) -> Path:
        """Write the files that a user would have, and return the recipe's path."""
        folder.mkdir(parents=True, exist_ok=True)
        self.mesh.export(folder / "part.stl")
        if self.network is not None:
            with (folder / "network.csv").open("w", newline="") as file:
                writer = csv.writer(file)
                writer.writerow(["x", "y", "z", "radius", "parent"])
                writer.writerows(self.network)
        path = folder / "recipe.yaml"
        path.write_text(yaml.safe_dump(self.recipe, sort_keys=False))
        return path


def draw(seed: int, index: int, small: bool = False) -> Part:
    """Return part ``index`` of ``seed``; ``small`` keeps it to a few CPU seconds."""
    rng = np.random.default_rng([seed, index])
    shape = str(rng.choice(SHAPES))
    method = "fresh" if rng.random() < 0.5 else "embedded"
    vessels = str(rng.choice(["tree", "tree", "loop", "straight", "wye", "header"]))
    if method == "fresh" and vessels == "loop":
        vessels = "tree"
    for attempt in range(MAX_TRIES):
        if attempt == MAX_TRIES // 2:
            vessels = "straight"  # the simplest network fits anywhere
        fine = rng.random() < 0.75 or small
        style = EMBEDDED if method == "embedded" else FINE if fine else COARSE
        mesh = _body(rng, shape, style, small)
        if vessels in ("tree", "loop"):
            return _grown(rng, seed, index, shape, mesh, style, vessels, small)
        network = _own_network(rng, mesh, style, vessels)
        if network is not None:
            return _part(rng, seed, index, shape, vessels, mesh, style, network, {})
    raise RuntimeError(f"no {vessels} fits into shape {shape} of ({seed}, {index})")


# Bodies


def _body(rng: np.random.Generator, shape: str, style: Style, small: bool) -> trimesh.Trimesh:
    """Return a closed body of the size that this method prints in a minute."""
    if style.method == "embedded":
        longest = rng.uniform(6, 9) if small else float(np.exp(rng.uniform(np.log(6), np.log(40))))
        size = longest * np.array([1.0, rng.uniform(0.5, 0.9), rng.uniform(0.3, 0.6)])
        size[2] = min(size[2], 11.0)  # a half-inch needle
        size = np.maximum(size, [6, 4, 3])
    else:
        grow = 1.0 if style is FINE else 1.7
        longest = grow * (rng.uniform(5.2, 6.0) if small else rng.uniform(5.2, 11))
        size = longest * np.array([1.0, rng.uniform(0.55, 0.9), rng.uniform(0.4, 0.7)])
        size = np.maximum(size, grow * np.array([5.2, 3.6, 2.4]))
        most = grow**3 * (45.0 if small else 120.0)
        excess = (size.prod() / most) ** 0.5
        if excess > 1:  # shorter and flatter, not narrower than its lumens need
            size[1:] = np.maximum(size[1:] / excess, grow * np.array([3.6, 2.4]))
    body = {
        "ellipsoid": _ellipsoid, "slant": _slant, "L": _letter, "T": _letter, "tube": _tube,
        "wedge": _wedge, "organ": _organ,
    }[shape](rng, size, shape)  # fmt: skip
    body.apply_translation(-body.bounds[0])
    return body


def _ellipsoid(rng: np.random.Generator, size: Points, _: str) -> trimesh.Trimesh:
    ball = trimesh.creation.icosphere(subdivisions=4, radius=0.5)
    ball.apply_scale(size)
    return ball


def _slant(rng: np.random.Generator, size: Points, _: str) -> trimesh.Trimesh:
    box = trimesh.creation.box(size)
    if rng.random() < 0.5:
        box.vertices[:, 0] += np.tan(np.radians(rng.uniform(10, 25))) * box.vertices[:, 2]
    else:
        turn = trimesh.transformations.rotation_matrix(
            np.radians(rng.uniform(8, 20)), [0, 1, rng.uniform(0, 0.5)]
        )
        box.apply_transform(turn)
    return box


def _letter(rng: np.random.Generator, size: Points, shape: str) -> trimesh.Trimesh:
    width, height, _ = size
    arm = rng.uniform(0.45, 0.55)
    if shape == "L":
        outline = [
            (0, 0), (width, 0), (width, arm * height), (arm * width, arm * height),
            (arm * width, height), (0, height),
        ]  # fmt: skip
    else:
        left, right = (0.5 - arm / 2) * width, (0.5 + arm / 2) * width
        low = (1 - arm) * height
        outline = [
            (left, 0), (right, 0), (right, low), (width, low), (width, height), (0, height),
            (0, low), (left, low),
        ]  # fmt: skip
    return _extruded([outline], size[2])


def _tube(rng: np.random.Generator, size: Points, _: str) -> trimesh.Trimesh:
    outer = size[0] / 2
    inner = outer * rng.uniform(0.25, 0.4)
    angles = np.linspace(0, 2 * np.pi, 96, endpoint=False)
    circle = np.column_stack([np.cos(angles), np.sin(angles)])
    return _extruded([outer * circle, (inner * circle)[::-1]], size[2])


def _wedge(rng: np.random.Generator, size: Points, _: str) -> trimesh.Trimesh:
    width, depth, height = size
    top = rng.uniform(0.35, 0.7) * width
    outline = [(0, 0), (width, 0), (top, height), (0, height)]
    body = _extruded([outline], depth)
    body.apply_transform(trimesh.transformations.rotation_matrix(np.pi / 2, [1, 0, 0]))
    return body


def _organ(rng: np.random.Generator, size: Points, _: str) -> trimesh.Trimesh:
    """Return half of a bumpy blob, cut by a plane."""
    ball = trimesh.creation.icosphere(subdivisions=5, radius=0.5)
    units = ball.vertices / np.linalg.norm(ball.vertices, axis=1)[:, None]
    bumps = np.zeros(len(units))
    for _k in range(6):
        wave = rng.normal(size=3)
        bumps += np.sin(
            units @ (wave / np.linalg.norm(wave) * rng.uniform(2, 5)) + rng.uniform(0, 6)
        )
    ball.vertices *= (1 + 0.035 * bumps)[:, None]
    ball.apply_scale(size * [1, 1, 1.6])
    whole = manifold3d.Manifold(
        manifold3d.Mesh(np.array(ball.vertices, np.float32), np.array(ball.faces, np.uint32))
    )
    half = whole.trim_by_plane([0, 0, 1], -0.1 * size[2]).to_mesh()
    return trimesh.Trimesh(half.vert_properties[:, :3], half.tri_verts)


def _extruded(outlines: list[Any], height: float) -> trimesh.Trimesh:
    section = manifold3d.CrossSection([np.asarray(one) for one in outlines])
    solid = manifold3d.Manifold.extrude(section, height).to_mesh()
    return trimesh.Trimesh(solid.vert_properties[:, :3], solid.tri_verts)


# Networks


def _grown(
    rng: np.random.Generator, seed: int, index: int, shape: str, mesh: trimesh.Trimesh,
    style: Style, vessels: str, small: bool,
) -> Part:  # fmt: skip
    smallest = style.lumen_mm[0] if mesh.extents.max() <= LARGE_MM else 0.6
    most = 5 if small else 10 if style.method == "fresh" else 30
    if vessels == "loop":
        most = min(most, 6)
    room = CELLS_PER_TERMINAL * (smallest + style.wall_mm) ** 3
    most = int(np.clip(mesh.volume / room, 2, most))
    grow: dict[str, Any] = {
        "grow": "tree" if vessels == "tree" else "closed_loop",
        "terminals": int(rng.integers(min(most, 4), most + 1)),
        "smallest_diameter_mm": smallest,
    }
    if style.method == "fresh":
        grow["clearance_mm"] = style.wall_mm  # two lines
    return _part(rng, seed, index, shape, vessels, mesh, style, None, grow)


def _own_network(
    rng: np.random.Generator, mesh: trimesh.Trimesh, style: Style, vessels: str
) -> list[tuple[float, float, float, float, int]] | None:
    """Return points of a network well inside the walls, or None where this try doesn't fit."""
    beyond = float(rng.choice([0.0, rng.uniform(0.1, 0.5)]))
    nodes = {"straight": _straight, "wye": _wye, "header": _header}[vessels](
        rng, mesh, style, beyond
    )
    if nodes is None:
        return None
    rows = [
        (*(round(float(v), 4) for v in p), round(float(r), 3), parent) for p, r, parent in nodes
    ]
    return rows if _clear(rows, mesh, style.wall_mm, beyond) else None


def _straight(rng: np.random.Generator, mesh: trimesh.Trimesh, style: Style, beyond: float) -> Any:
    nodes: list[Any] = []
    for _ in range(int(rng.integers(1, 4))):
        direction = rng.normal(scale=[0, 0.05, 0.03], size=3) + [1, 0, 0]
        if rng.random() < 0.4:
            direction[1:] = 0  # level, along an axis
        middle = mesh.bounds[0] + rng.uniform(0.15, 0.85, 3) * mesh.extents
        ends = _through(mesh, middle, direction / np.linalg.norm(direction), beyond)
        if ends is not None:
            radius = _radius(rng, style)
            nodes += [(ends[0], radius, -1), (ends[1], radius, len(nodes))]
    return nodes or None


def _wye(rng: np.random.Generator, mesh: trimesh.Trimesh, style: Style, beyond: float) -> Any:
    fork = mesh.bounds[0] + rng.uniform([0.3, 0.35, 0.35], [0.6, 0.65, 0.65]) * mesh.extents
    back = rng.normal(scale=[0, 0.1, 0.1], size=3) - [1, 0, 0]
    left = np.array([1.0, rng.uniform(0.3, 0.8), rng.uniform(-0.2, 0.2)])
    right = np.array([1.0, -rng.uniform(0.3, 0.8), rng.uniform(-0.2, 0.2)])
    ends = [_exit(mesh, fork, one / np.linalg.norm(one), beyond) for one in (back, left, right)]
    if any(end is None for end in ends):
        return None
    child = _radius(rng, style) * np.array([1.0, rng.uniform(1, 1.2)])
    parent = min(float((child**3).sum() ** (1 / 3)), style.lumen_mm[1] / 2 * 1.3)
    return [
        (ends[0], parent, -1), (fork, parent, 0), (ends[1], child[0], 1), (ends[2], child[1], 1)
    ]  # fmt: skip


def _header(rng: np.random.Generator, mesh: trimesh.Trimesh, style: Style, beyond: float) -> Any:
    """Return a header across the part that feeds two or three channels."""
    rungs = int(rng.integers(2, 4))
    radius = _radius(rng, style)
    head = 1.25 * radius
    low, size = mesh.bounds[0], mesh.extents
    x, z = low[0] + rng.uniform(0.2, 0.3) * size[0], low[2] + rng.uniform(0.3, 0.7) * size[2]
    ys = low[1] + size[1] * np.linspace(0.25, 0.75, rungs) + rng.uniform(-0.03, 0.03, rungs)
    inlet = _exit(mesh, np.array([x, ys[0], z]), np.array([-1.0, 0, 0]), beyond)
    nodes: list[Any] = [(inlet, head, -1)]
    parent = 0
    for y in ys:
        nodes.append((np.array([x, y, z]), head, parent))
        parent = len(nodes) - 1
        nodes.append(
            (_exit(mesh, np.array([x, y, z]), np.array([1.0, 0, 0]), beyond), radius, parent)
        )
    return None if any(place is None for place, _, _ in nodes) else nodes


def _radius(rng: np.random.Generator, style: Style) -> float:
    low, high = style.lumen_mm
    return round(float(rng.uniform(low, low + 0.6 * (high - low))) / 2, 3)


def _exit(mesh: trimesh.Trimesh, start: Points, direction: Points, beyond: float) -> Points | None:
    """Return the only place where a ray leaves the part, at 50 degrees off the face or more."""
    lengths, faces = hits(mesh, start, direction)
    if len(lengths) != 1 or mesh.face_normals[faces[0]] @ direction < np.cos(np.radians(40)):
        return None
    return np.asarray(start + (lengths[0] + beyond) * direction)


def _through(
    mesh: trimesh.Trimesh, middle: Points, direction: Points, beyond: float
) -> tuple[Points, Points] | None:
    first, last = (_exit(mesh, middle, way, beyond) for way in (-direction, direction))
    return None if first is None or last is None else (first, last)


def _clear(rows: list[Any], mesh: trimesh.Trimesh, wall: float, beyond: float) -> bool:
    """Return whether walls to the surface and among vessels that share no node are thick enough."""
    pieces = [(k, row[4]) for k, row in enumerate(rows) if row[4] >= 0]
    place = np.array([row[:3] for row in rows])
    radius = np.array([row[3] for row in rows])
    degree = np.bincount(np.array(pieces).ravel(), minlength=len(rows))
    walls = Walls(mesh)
    tracks = []
    for child, parent in pieces:
        length = float(np.linalg.norm(place[child] - place[parent]))
        if length < 4 * radius[child] + 2 * beyond:
            return False
        share = np.linspace(0, 1, max(int(length / 0.1), 8))[:, None]
        track = place[parent] * (1 - share) + place[child] * share
        room = radius[child] + wall
        keep = np.ones(len(track), bool)
        for end, other in ((child, parent), (parent, child)):
            if degree[end] == 1:  # a mouth: the face may slant by 40 degrees
                if not _opens_in_a_face(mesh, place[other], place[end], radius[child] + wall):
                    return False
                keep &= np.linalg.norm(track - place[end], axis=1) > beyond + 1.8 * room
        inside = track[keep]
        if len(inside) and walls.depth(inside).min() < room:
            return False
        tracks.append((child, parent, track))
    for k, (child, parent, track) in enumerate(tracks):
        for other, origin, beside in tracks[:k]:
            room = radius[child] + radius[other] + wall
            shared = {child, parent} & {other, origin}
            a, b = track, beside
            if shared:
                joint = place[shared.pop()]
                a = a[np.linalg.norm(a - joint, axis=1) > 2 * room]
                b = b[np.linalg.norm(b - joint, axis=1) > 2 * room]
            if len(a) and len(b) and np.linalg.norm(a[:, None] - b, axis=2).min() < room:
                return False
    return True


def _opens_in_a_face(mesh: trimesh.Trimesh, start: Points, end: Points, radius: float) -> bool:
    """Return whether all of a round channel leaves the part through faces that it meets alike."""
    way = (end - start) / np.linalg.norm(end - start)
    start = (start + end) / 2  # the other end may be a mouth as well
    first = np.linalg.svd(way[None])[2][1]
    second = np.cross(way, first)
    for angle in np.arange(0, 2 * np.pi, np.pi / 6):
        rim = start + radius * (np.cos(angle) * first + np.sin(angle) * second)
        lengths, faces = hits(mesh, rim, way)
        if len(lengths) != 1 or mesh.face_normals[faces[0]] @ way < np.cos(np.radians(50)):
            return False
    return True


# Recipes


def _part(
    rng: np.random.Generator, seed: int, index: int, shape: str, vessels: str,
    mesh: trimesh.Trimesh, style: Style, network: Any, grow: dict[str, Any],
) -> Part:  # fmt: skip
    name = f"s{seed}_{index:03d}_{shape}_{vessels}_{style.method[0]}"
    tissue: dict[str, Any] = {"mesh": "part.stl", "unit": "mm"}
    toolpath: dict[str, Any] = {"method": style.method, "needle": style.needle}
    if style.layer_um:
        toolpath |= {"layer_um": style.layer_um, "line_um": style.line_um}
    if style.method == "embedded":
        materials = {"ink": "gelatin_sacrificial", "bath": "cell_matrix"}
    else:
        materials = {"ink": "collagen_fresh", "bath": "gelatin_support"}
    recipe = {
        "schema": 1,
        "name": name,
        "seed": int(rng.integers(1, 1000)),
        "tissue": tissue,
        "vasculature": {"network": "network.csv", "unit": "mm"} if network else grow,
        "flow": {"viscosity_mpa_s": 1.0, "inlet_flow_ml_min": 0.25},
        "toolpath": toolpath,
        "printer": {"profile": "generic_marlin", "port": "simulated", "syringe": "hamilton_1ml"}
        | materials,
        "scan": _scan(rng, mesh, style),
    }
    return Part(name, shape, mesh, network, recipe, style)


def _scan(rng: np.random.Generator, mesh: trimesh.Trimesh, style: Style) -> dict[str, Any]:
    """Return the scanner that sees this part; its voxels are the product's choice."""
    size = mesh.extents
    shallow = style.method == "fresh" and size[2] <= 6 and size.max() <= 12
    return {"simulated": "oct" if shallow and rng.random() < 0.75 else "microct"}
