"""Find a tissue's unconnected parts, the part of each point, and each part's demand share."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from math import ceil

import numpy as np
from manifold3d import Manifold, OpType
from numpy.typing import NDArray

from design.errors import TissueError
from design.geometry import build_triangle_tree
from design.geometry.crossings import find_crossings
from design.geometry.mesh import Edges, connected_parts, edges_of
from design.geometry.surface import Surface
from design.tissue.closed import FaceArray, enclosed_volume
from design.tissue.grid import enclosed, winding_number
from design.tissue.surface import SizeLimits, SpacingRule, tissue_from_surface
from design.tissue.tissue import UNIFORM, Demand, Tissue
from design.tissue.zones import manifold_of, surface_of
from kernels.arrays import FloatArray

SAMPLED_VERTICES = 15
"""Of a shell, whose majority says whether another encloses it: shells may touch or cross."""
MAX_ANGLE_RAD = 1e-7
"""Between faces at an edge that lie on each other: some steps of float32."""
MAX_SHELLS = 2000
"""Of a mesh that isn't rubbish: all pairs are compared."""


def neighbours(
    edges: Edges,
) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.bool_]]:
    """Pairs of faces at edges that have two, and whether they agree on what is outside."""
    order, first = edges.sides()
    pair = edges.uses == 2
    one, two = order[first[pair]] // 3, order[first[pair] + 1] // 3
    return one, two, edges.balance[pair] == 0


def shells_of(points: FloatArray, faces: FaceArray) -> NDArray[np.int64]:
    """Number of the shell that each face belongs to, (m,).

    Joined across edges with two faces; pieces that aren't closed so also where shells touch in an
    edge, across which those faces are joined that have the solid between them.
    """
    edges = edges_of(faces)
    one, two, _ = neighbours(edges)
    piece = connected_parts(np.stack([one, two], axis=1), len(faces))
    here, there = _around_shared_edges(points, faces, edges)
    if not len(here):
        return piece
    loose = _not_closed(edges, piece)
    both = loose[piece[here]] & loose[piece[there]]
    if not both.any():
        return piece
    pairs = [np.stack([one, two], axis=1), np.stack([here, there], axis=1)[both]]
    return connected_parts(np.concatenate(pairs), len(faces))


def _not_closed(edges: Edges, piece: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Whether each piece has an edge with an odd number of its own faces."""
    own = edges.of_face * (int(piece.max()) + 1) + np.repeat(piece, 3)
    sides, uses = np.unique(own, return_counts=True)
    loose = np.zeros(int(piece.max()) + 1, dtype=np.bool_)
    loose[sides[uses % 2 == 1] % len(loose)] = True
    return loose


def _around_shared_edges(
    points: FloatArray, faces: FaceArray, edges: Edges
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Pairs of faces with solid between them, at edges of four faces and more."""
    pairs: list[tuple[int, int]] = []
    for face, upward, _ in _shared_edges(points, faces, edges):
        # Begin where most are closed: what is open then is closed later on.
        begin = 1 + int(np.argmin(np.cumsum(np.where(upward, -1, 1))))
        waiting: list[int] = []
        for one, closes in zip(np.roll(face, -begin), np.roll(upward, -begin), strict=True):
            if not closes:
                waiting.append(int(one))
            elif waiting:
                pairs.append((waiting.pop(), int(one)))
    rows = np.array(pairs, dtype=np.int64).reshape(-1, 2)
    return rows[:, 0], rows[:, 1]


def _walls_back_to_back(points: FloatArray, faces: FaceArray) -> NDArray[np.int64]:
    """Faces that lie on others which look the other way, at edges of four faces and more."""
    walls = list[int]()
    for face, upward, angle in _shared_edges(points, faces, edges_of(faces)):
        same = np.abs(np.angle(np.exp(1j * (angle - np.roll(angle, 1))))) < MAX_ANGLE_RAD
        opposite = upward != np.roll(upward, 1)
        walls += face[same & opposite].tolist() + np.roll(face, 1)[same & opposite].tolist()
    return np.unique(np.array(walls, dtype=np.int64))


def _shared_edges(
    points: FloatArray, faces: FaceArray, edges: Edges
) -> Iterator[tuple[NDArray[np.int64], NDArray[np.bool_], FloatArray]]:
    """Around each edge of four faces and more: faces by angle, if they pass it upwards, angles.

    Seen along the edge, a face that passes it upwards has its solid on the clockwise side, one that
    passes it downwards on the other.
    """
    shared = np.flatnonzero((edges.uses > 2) & (edges.balance == 0)).tolist()
    if not shared:
        return
    order, first = edges.sides()
    for edge in shared:
        sides = order[first[edge] : first[edge] + edges.uses[edge]]
        face, corner = sides // 3, sides % 3
        low, high = edges.ends[edge]
        upward = faces[face, corner] == low
        axis = points[high] - points[low]
        axis = axis / max(float(np.linalg.norm(axis)), np.finfo(float).tiny)
        across = points[faces[face, (corner + 2) % 3]] - points[low]
        u = np.cross(axis, np.eye(3)[np.argmin(np.abs(axis))])
        angle = np.arctan2(across @ np.cross(axis, u), across @ u)
        turn = np.lexsort([~upward, angle])
        yield face[turn], upward[turn], angle[turn]


def enclosures(points: FloatArray, faces: FaceArray, shell: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Which shell (first index) holds which (second), (s, s), by most of some vertices.

    Raises
    ------
    TissueError
        When there are more shells than can be compared.
    """
    count = int(shell.max()) + 1
    if count > MAX_SHELLS:
        raise TissueError(
            f"mesh has {count} separate shells, more than {MAX_SHELLS}; remove loose parts and try "
            "again"
        )
    parts = [faces[shell == n] for n in range(count)]
    corners = [points[part] for part in parts]
    low = np.array([c.min(axis=(0, 1)) for c in corners])
    high = np.array([c.max(axis=(0, 1)) for c in corners])
    holds = np.zeros((count, count), dtype=bool)
    for n in range(count):
        within = (low >= low[n]).all(axis=1) & (high <= high[n]).all(axis=1)
        within[n] = False
        if not within.any():
            continue
        tree = build_triangle_tree(points, parts[n])
        for m in np.flatnonzero(within):
            tried = np.unique(parts[m])
            tried = tried[:: max(1, len(tried) // SAMPLED_VERTICES)]
            inside = sum(winding_number(tree, *points[v]) != 0 for v in tried)
            holds[n, m] = 2 * inside > len(tried)
    return holds


def unite_shells(points: FloatArray, faces: FaceArray) -> tuple[FloatArray, FaceArray, int, int]:
    """Unite solids that overlap or lie within one another.

    Each shell that looks inward is a cavity of the smallest one around it.

    Returns
    -------
    points, faces
        Untouched when no two solids overlap.
    united : int
        Shells that took part, 0 for none.
    swallowed : int
        Shells that look outward and lie wholly within solid.
    """
    shell = shells_of(points, faces)
    count = int(shell.max()) + 1
    if count == 1:
        return points, faces, 0, 0
    volume = np.array([enclosed_volume(points, faces[shell == n]) for n in range(count)])
    holds = enclosures(points, faces, shell)
    # Solids less cavities around each: 0 for one that stands free or within a cavity.
    layers = (holds * np.sign(volume)[:, None]).sum(axis=0)
    swallowed = (volume > 0) & (layers > 0)
    pairs = crossing_faces(points, faces)
    crossed = np.unique(
        np.concatenate([shell[pairs].ravel(), shell[_walls_back_to_back(points, faces)]])
    )
    if len(crossed) == 0 and not swallowed.any():
        return points, faces, 0, 0
    whole = Manifold.batch_boolean(_solids(points, faces, shell, volume, holds), OpType.Add)
    union = surface_of(whole, "the union of the mesh's shells", touching=True)
    united = max(len(crossed), int(swallowed.sum()) + 1)
    return union.vertices, union.faces, united, int(swallowed.sum())


def _solids(
    points: FloatArray,
    faces: FaceArray,
    shell: NDArray[np.int64],
    volume: FloatArray,
    holds: NDArray[np.bool_],
) -> list[Manifold]:
    """One solid per shell that looks outward, less its cavities."""
    owner = _owners(volume, holds)
    return [
        manifold_of(Surface(points, faces[owner[shell] == n]), "a shell of the mesh")
        for n in np.flatnonzero(volume > 0)
    ]


def _owners(volume: FloatArray, holds: NDArray[np.bool_]) -> NDArray[np.int64]:
    """The smallest solid around each cavity (a shell of no positive volume); else itself, (s,)."""
    owner = np.arange(len(volume))
    for cavity in np.flatnonzero(volume <= 0):
        around = np.flatnonzero(holds[:, cavity] & (volume > 0))
        if len(around):
            owner[cavity] = around[np.argmin(volume[around])]
    return owner


MIN_HEIGHT_RATIO = 1e-12
"""Of a face's height over its longest edge; below it counts as a line. Float32 resolves 1e-7."""


def crossing_faces(vertices: FloatArray, faces: FaceArray) -> NDArray[np.int64]:
    """Pairs of faces (k, 2) that meet and share no vertex.

    Neighbours aren't tried, nor faces without area: where slivers of a drawing program fold over
    their neighbours by the file's rounding, nothing has to be mended.
    """
    wide = np.flatnonzero(_has_area(vertices[faces]))
    pairs = wide[find_crossings(vertices, faces[wide]).pairs]
    one, two = faces[pairs[:, 0]], faces[pairs[:, 1]]
    return pairs[(one[:, :, None] != two[:, None, :]).all(axis=(1, 2))]


def _has_area(corners: FloatArray) -> NDArray[np.bool_]:
    edges = np.roll(corners, -1, axis=1) - corners
    longest = (edges**2).sum(axis=2).max(axis=1)
    twice = np.linalg.norm(np.cross(edges[:, 0], edges[:, 1]), axis=1)
    return np.asarray(twice > MIN_HEIGHT_RATIO * longest)


DEMAND_SAMPLES = 20_000
"""Points drawn in a part's bounds when its mean demand is measured: 1 % of it."""
MIN_BRICKS = 300
"""Of a part's grid, however small its share: as many as a cube of 7 a side touches."""
MIN_MEAN_WEIGHT = 1e-12
"""A part without demand keeps a mean to divide by."""
_ANY_SIZE = SizeLimits(0.0, float("inf"))


@dataclass(frozen=True)
class Part:
    """A piece of a tissue that doesn't hang together with the rest.

    Attributes
    ----------
    faces : (m, 3) int32
        Of the tissue's vertices: its outer shell and its cavities.
    volume_mm3 : float
        Without its cavities and what lies in them.
    middle_mm : (3,) float64
        Of its bounds.
    """

    faces: FaceArray
    volume_mm3: float
    middle_mm: FloatArray

    def __str__(self) -> str:
        """Size and place, for messages."""
        x, y, z = self.middle_mm
        return f"the part of {self.volume_mm3:.3g} mm³ around ({x:.4g}, {y:.4g}, {z:.4g}) mm"


def parts_of(tissue: Tissue) -> tuple[Part, ...]:
    """The separate parts of a tissue, the largest first; parts that touch in a point are two.

    Raises
    ------
    TissueError
        When the surface has more than 2,000 shells.
    """
    return surface_parts(tissue.surface.vertices, tissue.surface.faces)


def surface_parts(points: FloatArray, faces: FaceArray) -> tuple[Part, ...]:
    """Separate parts of a closed surface, by its vertices (n, 3), mm, and faces (m, 3)."""
    shell = shells_of(points, faces)
    count = int(shell.max()) + 1
    signed = np.array([enclosed_volume(points, faces[shell == n]) for n in range(count)])
    solid = np.flatnonzero(signed > 0)
    if len(solid) == 1:
        owner = np.full(count, solid[0])
    else:
        owner = _owners(signed, enclosures(points, faces, shell))
    volume = np.bincount(owner, weights=signed, minlength=count)
    order = solid[np.argsort(-volume[solid], kind="stable")]
    return tuple(_part(points, faces[owner[shell] == n], float(volume[n])) for n in order)


def without_cavities(surface: Surface) -> Surface:
    """The surface without the walls of closed cavities; as it is where it has none."""
    points, faces = surface.vertices, surface.faces
    shell = shells_of(points, faces)
    signed = [enclosed_volume(points, faces[shell == n]) for n in range(int(shell.max()) + 1)]
    outer = np.array(signed)[shell] > 0
    return surface if outer.all() else replace(surface, faces=np.ascontiguousarray(faces[outer]))


def _part(points: FloatArray, faces: FaceArray, volume_mm3: float) -> Part:
    corners = points[np.unique(faces)]
    middle: FloatArray = 0.5 * (corners.min(axis=0) + corners.max(axis=0))
    return Part(np.ascontiguousarray(faces), volume_mm3, middle)


def part_numbers(tissue: Tissue, parts: Sequence[Part], points: FloatArray) -> NDArray[np.int64]:
    """Number of the part that each of ``points`` (n, 3), mm, lies in; -1 for none."""
    number, points = np.full(len(points), -1), np.ascontiguousarray(points)
    if len(parts) == 1:
        number[tissue.contains(points)] = 0
        return number
    for n, part in enumerate(parts):
        number[enclosed(build_triangle_tree(tissue.surface.vertices, part.faces), points)] = n
    return number


def part_tissue(tissue: Tissue, part: Part) -> Tissue:
    """A part as a tissue of its own, in the same place and with the same demand.

    Raises
    ------
    TissueError
        As `tissue_from_surface`, naming the part.
    """
    surface = tissue.surface
    rule = SpacingRule()
    share = part.volume_mm3 / tissue.volume_mm3
    rule = replace(rule, bricks=max(MIN_BRICKS, ceil(rule.bricks * share ** (2 / 3))))
    try:
        own = tissue_from_surface(surface.vertices, part.faces, limits=_ANY_SIZE, rule=rule)
    except TissueError as error:
        raise TissueError(f"{part} can't be prepared: {error}") from error
    if tissue.demand == UNIFORM:
        return own
    mean = max(_mean_weight(tissue, part), MIN_MEAN_WEIGHT)
    return replace(own, demand=PartDemand(tissue.demand, mean))


@dataclass(frozen=True)
class PartDemand:
    """The demand of a whole tissue, seen from one of its parts."""

    whole: Demand
    mean_weight: float

    def weight(self, points: FloatArray) -> FloatArray:
        """See `Demand`."""
        return self.whole.weight(points)


def part_demands(tissue: Tissue, parts: Sequence[Part]) -> FloatArray:
    """Share of the tissue's demand in each part, (p,): by volume where the demand is uniform."""
    demand = np.array([part.volume_mm3 for part in parts])
    if tissue.demand != UNIFORM:
        demand = demand * [_mean_weight(tissue, part) for part in parts]
    shares: FloatArray = demand / demand.sum()
    return shares


def _mean_weight(tissue: Tissue, part: Part) -> float:
    """Mean of the demand's weight over a part."""
    points, tree = tissue.surface.vertices, build_triangle_tree(tissue.surface.vertices, part.faces)
    corners = points[np.unique(part.faces)]
    low, high = corners.min(axis=0), corners.max(axis=0)
    tried = low + np.random.default_rng(0).random((DEMAND_SAMPLES, 3)) * (high - low)
    tried = tried[enclosed(tree, tried)]
    return float(tissue.demand.weight(tried).mean()) if len(tried) else 1.0
