"""Find the lumens of a solid without its network: centre lines and radii, from the mesh alone.

A lumen is empty space that the solid shuts in: of the 13 lines through a place that lead to the 26
neighbours of a voxel, at least `SHUT_IN` meet the solid on both sides. A groove has about 5, a
notch 3, the space around a part none. Bands of equal way through the lumens from one of their ends,
each in its connected parts, give the graph (Reeb's); axes and radii are those of the mesh's own
sections across it, so that voxels decide what hangs together and nothing else.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from itertools import product
from typing import Final

import numpy as np
from manifold3d import Manifold
from scipy import ndimage
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from design.errors import SolidError
from design.geometry.polyline import arc_lengths, places_along
from design.network import VesselKind, VesselNetwork
from design.solids.genus import construct_genus, network_genus
from design.solids.manifolds import solid_manifold
from design.solids.solid import Solid
from design.vasculature.growth.trunk import straighten_line
from kernels.arrays import BoolArray, FloatArray, IntArray

SHUT_IN: Final = 11
SHUT_IN_AT_MOUTH: Final = 3
MOUTH_RADII: Final = 2.0
BAND_VOXELS: Final = 2.0
MAX_VOXELS: Final = (4_000_000, 40_000_000)
"""Of the box around the solid, first and where lumens are too thin for that."""
FINEST_MM: Final = 0.02
MIN_RADIUS_VOXELS: Final = 3.0
MIN_LENGTH_RADII: Final = 2.0
"""A shorter hollow is a dimple."""
ROUND: Final = 1.3
"""A hollow without a way in, its box no longer than so many of its widths, is a bubble."""
JOINT_RADII: Final = 1.2
SPUR_RADII: Final = 2.2
"""Shorter ways from a fork, in its radius, lie within its joint, or lead into a corner."""
WIDER: Final = 1.3
"""A section so many times as wide as the median of its vessel belongs to a joint."""
MAX_JOINT_RADII: Final = 5.0
IN_JOINT: Final = 0.015
MAX_BEND_SECTIONS: Final = 4
"""So far from a joint at most, a section is left out that differs by this share from the next."""
STEEPEST: Final = 0.6
"""Where a radius changes by more of the way it isn't sure where it does."""
MAX_MOVE_RADII: Final = 3.0
"""Farther from where its lumens part a joint isn't laid; its vessels hardly are straight there."""
FAR_MOVE_RADII: Final = 8.0
MEET: Final = 0.15
"""So far, in its radius, a joint may move where all lines pass it within this share of it."""
ROUNDS: Final = 3
"""Of sections across the line through the middles of the last ones."""
STRAIGHT_MM: Final = 0.003
ASIDE: Final = 0.3
"""A lumen's wall may lie by this share of the radius beside its vessel's, or two voxels."""
MOST_LEFT: Final = 0.1
"""Of the volume of lumens that hang together: where more is left, none of their axes is sure."""
MIN_LEFT_RADII: Final = 0.5
"""A piece of lumens that no vessel follows counts from a ball of so many radii on."""


@dataclass(frozen=True)
class FoundLumens:
    """Lumens of a part as a network of channels, and where that may not be what the part has.

    Attributes
    ----------
    network : VesselNetwork
    left : float
        Share of the lumens' volume that lies in pieces that no vessel follows.
    left_at : (n, 3), mm
        A place in each of these, the largest first.
    stretches : tuple of tuples of (from, to), mm
        Of each vessel, where it isn't sure to lie in the middle of its lumen, or to be one.
    """

    network: VesselNetwork
    left: float
    left_at: FloatArray
    stretches: tuple[tuple[tuple[float, float], ...], ...]


def lumen_network(solid: Solid, *, is_lumen: bool = False) -> VesselNetwork:
    """Return the lumens of a part as a network of channels, as `found_lumens` finds them."""
    return found_lumens(solid, is_lumen=is_lumen).network


def found_lumens(solid: Solid, *, is_lumen: bool = False) -> FoundLumens:
    """Find the lumens of a part, and what is unsure of them.

    Parameters
    ----------
    solid : Solid
        The part; or, with `is_lumen`, its lumens as a body.

    Raises
    ------
    SolidError
        When there is none that is at least as long as it is wide.
    """
    body = solid_manifold(solid, "the model")
    extent = np.ptp(solid.vertices, axis=0)
    for most in MAX_VOXELS:
        step = max(FINEST_MM, float((np.prod(extent) / most) ** (1 / 3)))
        voxels = _voxels(body, solid, step, is_lumen)
        graph = _graph(voxels)
        thin = min((float(np.median(edge.radius)) for edge in graph.edges), default=0.0)
        if thin >= MIN_RADIUS_VOXELS * step or step == FINEST_MM:
            break
    if not graph.edges:
        raise SolidError(
            "no lumen was found in the model: no hollow that it shuts in is longer than wide; give "
            "the network of its vessels, or the STL of the whole part with its channels cut out"
        )
    network = _measured(graph, _Sections.of(solid, -1 if not is_lumen else 1))
    ways = len(network.nodes) if is_lumen else body.genus()
    return _checked(network, voxels, all_unsure=network_genus(network) > ways)


def _checked(network: VesselNetwork, voxels: _Voxels, all_unsure: bool) -> FoundLumens:
    """Compare the vessels' tubes with the lumens' voxels; `all_unsure` where loops are too many."""
    step, degree = voxels.step, network.degree()
    covered = np.zeros_like(voxels.inside)
    places: list[FloatArray] = []
    wides: list[FloatArray] = []
    along: list[FloatArray] = []
    off: list[BoolArray] = []
    for vessel, length in enumerate(network.lengths().tolist()):
        line, radius = network.polyline(vessel)
        arc = arc_lengths(line)
        at = np.linspace(0.0, arc[-1], int(np.ceil(arc[-1] / step)) + 2)
        place, wide = places_along(line, arc, at), np.interp(at, arc, radius)
        # A blind end's wall is ahead.
        blind = [degree[k] == 1 for k in network.vessel_nodes[vessel]]
        ahead = np.minimum(at if blind[0] else np.inf, length - at if blind[1] else np.inf)
        core = np.minimum((1 - ASIDE) * wide, ahead) - 2 * step
        beyond = wide + np.maximum(ASIDE * wide, 2 * step)
        between_forks = not any(blind) and length < 2 * wide.max()
        bad = np.abs(np.gradient(wide, at)) > STEEPEST
        bad |= all_unsure or between_forks
        for k in range(len(at)):
            bad[k] |= _painted(covered, voxels, place[k], beyond[k], core[k])
        places, wides, along = [*places, place], [*wides, wide], [*along, at]
        off.append(bad)
    of = np.repeat(np.arange(len(along)), [len(one) for one in along])
    unsure, wide = np.concatenate(off), np.concatenate(wides)
    tree = cKDTree(np.vstack(places))
    label, _ = ndimage.label(voxels.inside & ~covered, np.ones((3, 3, 3)))
    part, count = ndimage.label(voxels.inside, np.ones((3, 3, 3)))
    lost = np.zeros(count + 1)
    left, left_at = [], []
    for number, box in enumerate(ndimage.find_objects(label), 1):
        index = np.argwhere(label[box] == number) + [one.start for one in box]
        near = tree.query(voxels.origin + step * index[:, ::-1])[1]
        ball = 4 / 3 * np.pi * (MIN_LEFT_RADII * float(wide[near].min())) ** 3
        if len(index) * step**3 >= ball:
            unsure[near] = True
            lost[part[tuple(index[0])]] += len(index)
            left.append(len(index))
            left_at.append(voxels.origin + step * index[len(index) // 2, ::-1])
    # Of lumens far from round no vessel is one.
    lost /= np.bincount(part.ravel(), minlength=count + 1)
    sample = np.round((np.vstack(places) - voxels.origin) / step).astype(int)[:, ::-1]
    sample = np.clip(sample, 0, np.array(part.shape) - 1)
    odd = lost[part[tuple(sample.T)]] > MOST_LEFT
    unsure |= np.isin(of, of[odd])
    stretches = tuple(
        _stretches(along[k], unsure[of == k], wides[k]) for k in range(network.vessel_count)
    )
    order = np.argsort(left)[::-1]
    share = sum(left) / int(voxels.inside.sum())
    return FoundLumens(network, share, np.reshape(left_at, (-1, 3))[order], stretches)


def _painted(
    covered: BoolArray, voxels: _Voxels, place: FloatArray, beyond: float, core: float
) -> bool:
    """Mark a ball of voxels as covered; return whether the solid reaches into the inner ball."""
    middle = ((place - voxels.origin) / voxels.step)[::-1]
    reach = beyond / voxels.step
    low = np.maximum(np.ceil(middle - reach).astype(int), 0)
    high = np.maximum(np.floor(middle + reach).astype(int) + 1, low)
    box = tuple(slice(*one) for one in zip(low, high, strict=True))
    axes = np.ogrid[box]
    away = sum((axis - m) ** 2 for axis, m in zip(axes, middle, strict=True))
    away = away[tuple(slice(0, n) for n in covered[box].shape)]
    covered[box] |= away <= reach**2
    return core > 0 and bool((~voxels.free[box] & (away <= (core / voxels.step) ** 2)).any())


def _stretches(
    at: FloatArray, unsure: BoolArray, wide: FloatArray
) -> tuple[tuple[float, float], ...]:
    """Return runs of unsure places, each longer by a radius at both ends, along a vessel."""
    out: list[tuple[float, float]] = []
    for k in np.flatnonzero(unsure):
        first, last = max(0.0, float(at[k] - wide[k])), min(float(at[-1]), float(at[k] + wide[k]))
        if out and first <= out[-1][1]:
            first, last = out[-1][0], max(last, out.pop()[1])
        out.append((first, last))
    return tuple(out)


def unfollowed_ways(solid: Solid, network: VesselNetwork) -> int:
    """Return how many ways through a part its surface has beyond those that a network follows."""
    ends = np.flatnonzero(network.degree() == 1)
    return max(0, solid_manifold(solid, "the model").genus() - construct_genus(network, ends))


@dataclass(frozen=True)
class _Voxels:
    """Space of lumens, (nz, ny, nx), and what is free of the solid there; `origin` as x, y, z."""

    inside: BoolArray
    free: BoolArray
    origin: FloatArray
    step: float


def _voxels(body: Manifold, solid: Solid, step: float, is_lumen: bool) -> _Voxels:
    low, high = solid.vertices.min(axis=0) - 1.5 * step, solid.vertices.max(axis=0) + 1.5 * step
    nx, ny, nz = np.ceil((high - low) / step).astype(int).tolist()
    filled = np.zeros((nz, ny, nx), dtype=np.bool_)
    for k in range(nz):
        filled[k] = _section_pixels(body, low, step, k, (ny, nx))
    origin = low + step / 2
    if is_lumen:
        return _Voxels(filled, filled, origin, step)
    return _Voxels(_shut_in(filled), ~filled, origin, step)


def _section_pixels(
    body: Manifold, low: FloatArray, step: float, k: int, shape: tuple[int, int]
) -> BoolArray:
    """Pixels of one level section whose middle lies in the solid: even-odd, row by row."""
    crossings = np.zeros((shape[0], shape[1] + 1), dtype=np.int64)
    y = low[1] + step * (np.arange(shape[0]) + 0.5)
    for ring in body.slice(float(low[2] + step * (k + 0.5))).to_polygons():
        start = np.asarray(ring, dtype=np.float64)
        end = np.roll(start, -1, axis=0)
        first = np.searchsorted(y, np.minimum(start[:, 1], end[:, 1]))
        last = np.searchsorted(y, np.maximum(start[:, 1], end[:, 1]))
        piece = np.repeat(np.arange(len(start)), last - first)
        count = last - first
        row = np.arange(len(piece)) + np.repeat(first - np.cumsum(count) + count, count)
        a, b = start[piece], end[piece]
        x = a[:, 0] + (y[row] - a[:, 1]) / (b[:, 1] - a[:, 1]) * (b[:, 0] - a[:, 0])
        column = np.clip(np.ceil((x - low[0]) / step - 0.5), 0, shape[1]).astype(np.int64)
        np.add.at(crossings, (row, column), 1)
    return np.asarray(np.cumsum(crossings, axis=1)[:, :-1] % 2 == 1)


def _shut_in(filled: BoolArray) -> BoolArray:
    """Free voxels in hollows that are shut in all round, out to where they open."""
    count = np.zeros(filled.shape, dtype=np.uint8)
    for way in product((-1, 0, 1), repeat=3):
        if way > (0, 0, 0):
            count += _behind(filled, way) & _behind(filled, tuple(-d for d in way))
    core = ~filled & (count >= SHUT_IN)
    if not core.any():
        return core
    # Within about a width of its mouth a lumen is shut in less, and by its walls first.
    wall = np.where(core, ndimage.distance_transform_edt(~filled), 0.0)
    size = 2 * int(np.ceil(np.percentile(wall[core], 90))) + 1
    away, nearest = ndimage.distance_transform_edt(~core, return_indices=True)
    reach = MOUTH_RADII * ndimage.maximum_filter(wall, size)[tuple(nearest)]
    near = ~filled & (count >= SHUT_IN_AT_MOUTH) & (away <= reach)
    return np.asarray(ndimage.binary_propagation(core & near, mask=near))


def _behind(filled: BoolArray, way: tuple[int, ...]) -> BoolArray:
    """Whether there is solid anywhere behind each voxel, against `way` (z, y, x)."""
    axis = next(k for k in range(3) if way[k])
    out = np.moveaxis(filled.copy(), axis, 0)
    others = [way[k] for k in range(3) if k != axis]
    here, before = zip(*(_shifted(d) for d in others), strict=True)
    order = range(1, len(out)) if way[axis] > 0 else range(len(out) - 2, -1, -1)
    for k in order:
        out[k][here] |= out[k - way[axis]][before]
    return np.moveaxis(out, 0, axis)


def _shifted(d: int) -> tuple[slice, slice]:
    """Where a plane's voxels are that have a neighbour at ``-d``, and where those neighbours."""
    if d == 0:
        return slice(None), slice(None)
    return (slice(1, None), slice(None, -1)) if d > 0 else (slice(None, -1), slice(1, None))


@dataclass(frozen=True, eq=False)
class _Edge:
    """A vessel: its ends' nodes, places along it (n, 3), mm, and how far walls are there (n,)."""

    a: int
    b: int
    line: FloatArray
    radius: FloatArray

    @property
    def length(self) -> float:
        return float(arc_lengths(self.line)[-1])

    def to(self, a: int, b: int) -> _Edge:
        return replace(self, a=a, b=b)

    def reversed(self) -> _Edge:
        return _Edge(self.b, self.a, self.line[::-1], self.radius[::-1])


@dataclass
class _Graph:
    """Nodes (m, 3), mm, with how far walls are there (m,), and vessels between them."""

    nodes: FloatArray
    radius: FloatArray
    edges: list[_Edge] = field(default_factory=list)

    def degree(self) -> IntArray:
        ends = [end for edge in self.edges for end in (edge.a, edge.b)]
        return np.bincount(np.array(ends, dtype=np.int64), minlength=len(self.nodes))


def _graph(voxels: _Voxels) -> _Graph:
    """Reduce the lumens to a graph; leave out what is no longer than wide."""
    if not voxels.inside.any():
        return _Graph(np.zeros((0, 3)), np.zeros(0))
    wall = ndimage.distance_transform_edt(np.pad(voxels.free, 1))[1:-1, 1:-1, 1:-1]
    inside = voxels.inside & ~_bubbles(voxels, wall)
    if not inside.any():
        return _Graph(np.zeros((0, 3)), np.zeros(0))
    index = np.argwhere(inside)
    level = (_way_from_ends(inside) / BAND_VOXELS)[inside].astype(np.int64)
    pairs = _neighbours(inside)
    band = _parts(pairs[level[pairs[:, 0]] == level[pairs[:, 1]]], len(index))
    count = np.bincount(band)
    place = np.stack([np.bincount(band, index[:, k]) / count for k in (2, 1, 0)], axis=1)
    wide = np.zeros(len(count))
    np.maximum.at(wide, band, wall[inside])
    joined = np.sort(band[pairs], axis=1)
    joined = np.unique(joined[joined[:, 0] != joined[:, 1]], axis=0)
    graph = _traced(joined, voxels.origin + voxels.step * place, voxels.step * wide)
    _tidy(graph)
    return graph


def _bubbles(voxels: _Voxels, wall: FloatArray) -> BoolArray:
    """Voxels of hollows in the solid that no way leads into, about as long as wide."""
    out = np.zeros_like(voxels.inside)
    label, _ = ndimage.label(voxels.free)
    for number, box in enumerate(ndimage.find_objects(label), 1):
        own = label[box] == number
        if number != label[0, 0, 0] and max(own.shape) < 2 * ROUND * wall[box][own].max():
            out[box] |= own
    return out


def _neighbours(inside: BoolArray) -> IntArray:
    """Pairs (n, 2) of voxels side by side, over faces, edges or corners, by their order."""
    number = np.full(np.array(inside.shape) + 2, -1, dtype=np.int64)
    core = (slice(1, -1),) * 3
    number[core][inside] = np.arange(int(inside.sum()))
    own, out = number[core][inside], []
    for way in product((-1, 0, 1), repeat=3):
        if way > (0, 0, 0):
            moved = [slice(1 + d, n - 1 + d) for d, n in zip(way, number.shape, strict=True)]
            other = number[tuple(moved)][inside]
            out.append(np.stack([own, other], axis=1)[other >= 0])
    return np.concatenate(out)


def _way_from_ends(inside: BoolArray) -> FloatArray:
    """Length of the way through the lumens to each voxel from an end of its part, in voxels."""
    from skimage.graph import MCP_Geometric  # slow to load

    cost = np.where(inside, 1.0, -1.0)
    label, count = ndimage.label(inside, np.ones((3, 3, 3)))
    starts = ndimage.maximum_position(inside, label, range(1, count + 1))
    for _ in range(2):  # the farthest voxel from any is at an end
        way = MCP_Geometric(cost).find_costs(starts)[0]
        way[~inside] = -1.0
        starts = ndimage.maximum_position(way, label, range(1, count + 1))
    return np.asarray(way)


def _traced(pairs: IntArray, place: FloatArray, radius: FloatArray) -> _Graph:
    """Nodes where a chain of places (n, 3) ends or forks, and the ways between them."""
    degree = np.bincount(pairs.ravel(), minlength=len(place))
    is_node = degree != 2
    # A ring without a fork gets a node where it was found first.
    ring = _parts(pairs, len(place))
    for part in np.setdiff1d(ring, ring[is_node]):
        is_node[np.flatnonzero(ring == part)[0]] = True
    both = is_node[pairs].all(axis=1)
    cluster = np.where(is_node, _parts(pairs[both], len(place)), -1)
    names, number = np.unique(cluster[is_node], return_inverse=True)
    of = np.full(len(place), -1)
    of[is_node] = number
    count = np.maximum(np.bincount(number), 1)
    nodes = np.stack([np.bincount(number, place[is_node, k]) / count for k in range(3)], axis=1)
    wide = np.zeros(len(names))
    np.maximum.at(wide, number, radius[is_node])
    graph = _Graph(nodes, wide)
    inner = pairs[~is_node[pairs].any(axis=1)]
    path = _parts(inner, len(place))
    near: dict[int, list[int]] = {}
    for i, j in np.concatenate([pairs, pairs[:, ::-1]]).tolist():
        near.setdefault(i, []).append(j)
    for part in np.unique(path[~is_node]):
        run = _in_order(np.flatnonzero((path == part) & ~is_node), near)
        if ends := _ends_of(run, near, is_node, of):
            a, b = ends
            line = np.vstack([nodes[a], place[run], nodes[b]])
            graph.edges.append(
                _Edge(a, b, line, np.concatenate([wide[[a]], radius[run], wide[[b]]]))
            )
    return graph


def _ends_of(
    run: list[int], near: dict[int, list[int]], is_node: BoolArray, of: IntArray
) -> tuple[int, int] | None:
    first = [int(of[j]) for j in near[run[0]] if is_node[j]]
    last = [int(of[j]) for j in near[run[-1]] if is_node[j]]
    if len(run) == 1:
        last = last[1:] or last
    return (first[0], last[-1]) if first and last else None


def _parts(pairs: IntArray, count: int) -> IntArray:
    graph = coo_matrix((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(count, count))
    return np.asarray(connected_components(graph, directed=False)[1], dtype=np.int64)


def _in_order(run: IntArray, near: dict[int, list[int]]) -> list[int]:
    """Voxels of a way from one end to the other."""
    own = set(run.tolist())
    start = next((i for i in own if sum(j in own for j in near[i]) < 2), min(own))
    out, last = [start], -1
    own.discard(start)
    while True:
        onward = next((j for j in near[out[-1]] if j in own and j != last), None)
        if onward is None:
            return out
        last = out[-1]
        out.append(onward)
        own.discard(onward)


def _tidy(graph: _Graph) -> None:
    """Drop spurs and dimples, merge forks that lie in one joint, and join runs through nodes."""
    while True:
        degree = graph.degree()
        graph.edges[:] = [
            e for e in graph.edges if e.a != e.b or e.length > 2 * np.pi * float(e.radius.max())
        ]
        short = [
            edge
            for edge in graph.edges
            if edge.a != edge.b and edge.length < _least_length(graph, edge, degree)
        ]
        if not short:
            break
        edge = min(short, key=lambda one: one.length)
        graph.edges.remove(edge)
        if min(degree[edge.a], degree[edge.b]) > 1:  # two forks in one joint
            _merge(graph, edge)
        _join_runs(graph)
    _join_runs(graph)


def _merge(graph: _Graph, edge: _Edge) -> None:
    """Make one fork of the two at a vessel's ends."""
    keep, gone = sorted((edge.a, edge.b))
    graph.nodes[keep] = (graph.nodes[keep] + graph.nodes[gone]) / 2
    graph.radius[keep] = max(graph.radius[keep], graph.radius[gone])
    names = {gone: keep}
    graph.edges[:] = [
        one.to(names.get(one.a, one.a), names.get(one.b, one.b)) for one in graph.edges
    ]


def _least_length(graph: _Graph, edge: _Edge, degree: IntArray) -> float:
    if degree[edge.a] == degree[edge.b] == 1:
        return MIN_LENGTH_RADII * float(np.max(edge.radius))
    joint = max(float(graph.radius[end]) for end in (edge.a, edge.b) if degree[end] > 1)
    # A way into a corner of the wall narrows to nothing.
    narrows = min(degree[edge.a], degree[edge.b]) == 1 and np.median(edge.radius) < joint / 2
    return (SPUR_RADII if narrows else JOINT_RADII) * joint


def _join_runs(graph: _Graph) -> None:
    """Make one vessel of two where a node joins just these."""
    while True:
        at = next((int(k) for k in np.flatnonzero(graph.degree() == 2)
                   if sum(k in (e.a, e.b) for e in graph.edges) == 2), None)  # fmt: skip
        if at is None:
            return
        one, two = (edge for edge in graph.edges if at in (edge.a, edge.b))
        one = one if one.b == at else one.reversed()
        two = two if two.a == at else two.reversed()
        graph.edges.remove(next(e for e in graph.edges if at in (e.a, e.b)))
        graph.edges.remove(next(e for e in graph.edges if at in (e.a, e.b)))
        graph.edges.append(
            _Edge(one.a, two.b, np.vstack([one.line, two.line[1:]]),
                  np.concatenate([one.radius, two.radius[1:]]))
        )  # fmt: skip


@dataclass(frozen=True)
class _Sections:
    """Sections across lumens of a mesh; `turn`: -1 where lumens are holes in it, 1 bodies."""

    vertices: FloatArray
    faces: IntArray
    normal: FloatArray
    turn: int

    @staticmethod
    def of(solid: Solid, turn: int) -> _Sections:
        faces = solid.faces.astype(np.int64)
        a, b, c = (solid.vertices[faces[:, k]] for k in range(3))
        return _Sections(solid.vertices, faces, np.cross(b - a, c - a), turn)

    def near(self, line: FloatArray, reach: float) -> _Sections:
        """Faces whose boxes come near a line."""
        corner = self.vertices[self.faces]
        low, high = line.min(axis=0) - reach, line.max(axis=0) + reach
        kept = ((corner.min(axis=1) <= high) & (corner.max(axis=1) >= low)).all(axis=1)
        return replace(self, faces=self.faces[kept], normal=self.normal[kept])

    def at(self, place: FloatArray, way: FloatArray) -> tuple[FloatArray, float] | None:
        """Centre, and radius of the circle of equal area, of the section round a place."""
        away = (self.vertices - place) @ way
        away[away == 0] = 1e-12
        above = away[self.faces] > 0
        cut = np.flatnonzero(above.any(axis=1) & ~above.all(axis=1))
        if not len(cut):
            return None
        face, above = self.faces[cut], above[cut]
        lone = np.where(above.sum(axis=1) == 1, above.argmax(axis=1), (~above).argmax(axis=1))
        row = np.arange(len(cut))
        corner = face[row, lone]
        ends, keys = [], []
        for k in (1, 2):
            other = face[row, (lone + k) % 3]
            share = away[corner] / (away[corner] - away[other])
            here, there = self.vertices[corner], self.vertices[other]
            ends.append(here + share[:, None] * (there - here))
            keys.append(np.minimum(corner, other) * len(self.vertices) + np.maximum(corner, other))
        across = np.cross(ends[1] - ends[0], way)
        flip = (across * self.normal[cut]).sum(axis=1) < 0
        start = np.where(flip[:, None], ends[1], ends[0])
        end = np.where(flip[:, None], ends[0], ends[1])
        edge = np.unique(np.concatenate(keys), return_inverse=True)[1].reshape(2, -1)
        loop = _parts(edge.T, int(edge.max()) + 1)[edge[0]]
        return self._around(place, way, start - place, end - place, loop)

    def to_face(self, place: FloatArray, way: FloatArray, radius: float) -> float:
        """How far ahead the wall of a blind end is, or the face that the lumen opens through."""
        blind = self._ahead(place, way)
        if self.turn > 0:
            return blind
        u = np.cross(way, np.eye(3)[np.abs(way).argmin()])
        u /= np.linalg.norm(u)
        v = np.cross(way, u)
        back = place - 2 * radius * way  # in the solid beside even a slanted mouth
        turn = np.arange(8) * np.pi / 4
        beside = 1.2 * radius * (np.cos(turn)[:, None] * u + np.sin(turn)[:, None] * v)
        away = np.array([self._ahead(back + one, way) for one in beside])
        face = float(np.median((away[:4] + away[4:]) / 2)) - 2 * radius
        return min(blind, face)

    def _ahead(self, start: FloatArray, way: FloatArray) -> float:
        """How far ahead a ray meets the mesh first; inf where it doesn't."""
        a, b, c = (self.vertices[self.faces[:, k]] for k in range(3))
        across = np.cross(way, c - a)
        volume = ((b - a) * across).sum(axis=1)
        with np.errstate(divide="ignore", invalid="ignore"):
            one = ((start - a) * across).sum(axis=1) / volume
            turned = np.cross(start - a, b - a)
            two = turned @ way / volume
            far = ((c - a) * turned).sum(axis=1) / volume
            hit = (one >= 0) & (two >= 0) & (one + two <= 1) & (far > 0)
        return float(far[hit].min(initial=np.inf))

    def _around(
        self, place: FloatArray, way: FloatArray, start: FloatArray, end: FloatArray, loop: IntArray
    ) -> tuple[FloatArray, float] | None:
        """Of closed loops the smallest that goes round the place the right way."""
        u = np.cross(way, np.eye(3)[np.abs(way).argmin()])
        u /= np.linalg.norm(u)
        v = np.cross(way, u)
        a, b = np.stack([start @ u, start @ v], axis=1), np.stack([end @ u, end @ v], axis=1)
        cross = a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]
        turns = np.bincount(loop, np.arctan2(cross, (a * b).sum(axis=1))) / (2 * np.pi)
        area = np.bincount(loop, cross) / 2
        good = np.flatnonzero((np.round(turns) == self.turn) & (np.abs(area) > 0))
        if not len(good):
            return None
        best = good[np.abs(area[good]).argmin()]
        own = loop == best
        flat = ((a + b)[own] * cross[own, None]).sum(axis=0) / (6 * area[best])
        return place + flat[0] * u + flat[1] * v, float(np.sqrt(abs(area[best]) / np.pi))


@dataclass(frozen=True)
class _Axis:
    """Centres (n, 3), mm, and radii (n,), mm, of a vessel's own sections, from end to end."""

    edge: _Edge
    centre: FloatArray
    radius: FloatArray


def _measured(graph: _Graph, sections: _Sections) -> VesselNetwork:
    """Lay the graph's vessels along the middles of their sections."""
    degree, first = graph.degree(), graph.nodes.copy()
    for _ in range(ROUNDS):
        axes = [_axis(graph, edge, sections, degree) for edge in graph.edges]
        for node in np.flatnonzero(degree > 1):
            ways = list(_ways_into(int(node), axes))
            place = _meeting(graph.nodes[node], ways)
            moved, radius = np.linalg.norm(place - first[node]), graph.radius[node]
            # Lines that do meet tell where, however long the joint of an acute fork is.
            most = FAR_MOVE_RADII if _apart(place, ways) < MEET * radius else MAX_MOVE_RADII
            graph.nodes[node] = place if moved <= most * radius else first[node]
        graph.edges[:] = [_along(graph, axis, degree) for axis in axes]
    nodes = graph.nodes
    for edge in graph.edges:
        joint = [edge.a, edge.b]
        apart = float(np.linalg.norm(nodes[edge.a] - nodes[edge.b]))
        in_joint = max(apart, edge.length / 2 / np.pi) < graph.radius[joint].min()
        if edge.a != edge.b and degree[joint].min() > 1 and in_joint:
            graph.edges.remove(edge)
            _merge(graph, edge)
            return _measured(graph, sections)
    lines, radii = [], []
    for axis in axes:
        line, radius = [axis.centre], [axis.radius]
        for at, end in ((axis.edge.a, 0), (axis.edge.b, 1)):
            if degree[at] == 1:
                nodes[at] = axis.centre[-end]
                continue
            line.insert(len(line) * end, nodes[[at]])
            radius.insert(len(radius) * end, axis.radius[[-end]])
        whole = np.column_stack([np.vstack(line), np.concatenate(radius)])
        kept = whole[straighten_line(whole, STRAIGHT_MM)[0]]
        lines.append(kept[:, :3])
        radii.append(kept[:, 3])
    ends = np.array([[axis.edge.a, axis.edge.b] for axis in axes], dtype=np.int64)
    used, number = np.unique(ends, return_inverse=True)
    ends = number.reshape(-1, 2)
    part = _parts(ends, len(used))[ends[:, 0]]
    return VesselNetwork(
        nodes[used],
        ends,
        np.full(len(axes), int(VesselKind.CHANNEL)),
        np.unique(part, return_inverse=True)[1].astype(np.int64),
        np.cumsum([0, *(len(line) for line in lines)]),
        np.vstack(lines),
        np.concatenate(radii),
    )


def _along(graph: _Graph, axis: _Axis, degree: IntArray) -> _Edge:
    """Return a vessel along its axis, from joint to joint or to its end."""
    a, b = axis.edge.a, axis.edge.b
    ends = [graph.nodes[[k]] if degree[k] > 1 else np.zeros((0, 3)) for k in (a, b)]
    return replace(axis.edge, line=np.vstack([ends[0], axis.centre, ends[1]]))


def _axis(graph: _Graph, edge: _Edge, sections: _Sections, degree: IntArray) -> _Axis:
    """Cut a vessel across its line, outside of its joints."""
    wide = float(np.median(edge.radius))
    sections = sections.near(edge.line, 6 * wide)
    arc = arc_lengths(edge.line)
    joint = [graph.radius[k] if degree[k] > 1 else 0.0 for k in (edge.a, edge.b)]
    cut = [1.2 * one for one in joint]
    if arc[-1] - sum(cut) < wide / 2:
        cut = [0.8 * arc[-1] * one / (sum(cut) or 1.0) for one in cut]
    count = max(3, int(np.ceil((arc[-1] - sum(cut)) / (wide / 2))) + 1)
    at = np.linspace(cut[0], arc[-1] - cut[1], count)
    place = places_along(edge.line, arc, at)
    ahead = places_along(edge.line, arc, np.minimum(at + wide, arc[-1]))
    way = ahead - places_along(edge.line, arc, np.maximum(at - wide, 0.0))
    way /= np.linalg.norm(way, axis=1)[:, None]
    found = [sections.at(*one) for one in zip(place, way, strict=True)]
    closed = np.array([one is not None for one in found])
    if closed.sum() < 2:
        return _Axis(edge, edge.line[[0, -1]], np.full(2, wide))
    at = at[closed]
    centre = np.array([one[0] for one in found if one is not None])
    radius = np.array([one[1] for one in found if one is not None])
    # Others belong to a joint or an end, if one is near; else the lumen is wider.
    reach = [max(MAX_JOINT_RADII * one, 1.5 * wide) for one in joint]
    near = (at < reach[0]) | (at > arc[-1] - reach[1])
    alike = ~near | _alike(radius, float(np.median(radius)))
    own = alike.copy()
    own &= _off_joint(radius, at, MAX_JOINT_RADII * joint[0])
    own &= _off_joint(radius[::-1], arc[-1] - at[::-1], MAX_JOINT_RADII * joint[1])[::-1]
    if own.sum() < 2:  # all of it lies in joints
        return _Axis(edge, edge.line[[0, -1]], np.full(2, wide))
    # The middles of a bend's sections are good, though these are too wide.
    within = np.flatnonzero(own)[[0, -1]]
    radius = np.interp(at, at[own], radius[own])
    own[within[0] : within[1] + 1] |= alike[within[0] : within[1] + 1]
    centre, radius = centre[own], radius[own]
    if degree[edge.b] == 1:
        centre, radius = _to_its_end(centre, radius, sections)
    if degree[edge.a] == 1:
        centre, radius = (one[::-1] for one in _to_its_end(centre[::-1], radius[::-1], sections))
    return _Axis(edge, centre, radius)


def _off_joint(radius: FloatArray, at: FloatArray, reach: float) -> BoolArray:
    """Leave out sections that, on the way to a joint at 0, are unlike those before them.

    A bend is wider in a few sections, with even ones behind; else what is behind is left out.
    """
    kept = np.ones(len(radius), dtype=np.bool_)
    first = int(np.searchsorted(at, reach))
    quiet = (k for k in range(first, len(radius) - 4) if _even(radius[k : k + 5], radius[k]))
    first = next(quiet, first)  # no bend's
    before = list(radius[first : first + 3])
    for k in range(first - 1, -1, -1):
        like = float(np.median(before or radius))
        kept[k] = abs(radius[k] - like) < IN_JOINT * radius[k]
        if kept[k]:
            before = [radius[k], *before[:2]]
        elif not kept[k : k + MAX_BEND_SECTIONS + 1].any() and not any(
            _even(radius[j - 3 : j], like) for j in range(k, max(k - MAX_BEND_SECTIONS, 2), -1)
        ):
            kept[:k] = False
            break
    return kept


def _even(radius: FloatArray, like: float) -> bool:
    return bool((np.abs(radius - like) < IN_JOINT * like).all())


def _to_its_end(
    centre: FloatArray, radius: FloatArray, sections: _Sections
) -> tuple[FloatArray, FloatArray]:
    """Go straight on to the last section that the solid shuts in, and to the face or wall."""
    wide = float(radius[-1])
    back = centre[max(-1 - 4, -len(centre))]
    way = (centre[-1] - back) / np.linalg.norm(centre[-1] - back)
    near, far = 0.0, 6 * wide
    for step in np.arange(0.1, 6, 0.1) * wide:
        if not _is_own(sections.at(centre[-1] + step * way, way), wide):
            far = float(step)
            break
        near = float(step)
    for _ in range(6):
        middle = (near + far) / 2
        if _is_own(sections.at(centre[-1] + middle * way, way), wide):
            near = middle
        else:
            far = middle
    spacing = np.linalg.norm(np.diff(centre[-8:], axis=0), axis=1)
    slope = float(np.median(np.diff(radius[-8:]) / spacing))
    onward = sections.to_face(centre[-1] + near * way, way, wide)
    near += onward if 0 < onward <= 6 * wide else 0.0
    return np.vstack([centre, centre[-1] + near * way]), np.append(
        radius, wide + near * float(np.clip(slope, -STEEPEST, STEEPEST))
    )


def _is_own(section: tuple[FloatArray, float] | None, wide: float) -> bool:
    return section is not None and bool(_alike(np.array(section[1]), wide))


def _alike(radius: FloatArray, wide: float) -> BoolArray:
    return np.asarray((radius > wide / 2) & (radius < WIDER * wide))


def _ways_into(node: int, axes: list[_Axis]) -> Iterator[tuple[FloatArray, FloatArray]]:
    """Places and directions of the axes that lead to a node."""
    for axis in axes:
        for end, line in ((axis.edge.a, axis.centre), (axis.edge.b, axis.centre[::-1])):
            if end == node:
                way = line[0] - line[min(3, len(line) - 1)]
                if (size := float(np.linalg.norm(way))) > 0:
                    yield line[0], way / size


def _apart(place: FloatArray, ways: list[tuple[FloatArray, FloatArray]]) -> float:
    """Return how far the farthest of the lines passes by a place."""
    off = (np.cross(way, place - start) for start, way in ways)
    return max((float(np.linalg.norm(one)) for one in off), default=np.inf)


def _meeting(near: FloatArray, ways: list[tuple[FloatArray, FloatArray]]) -> FloatArray:
    """Return the place nearest to all lines; ones that run alike leave it at `near`."""
    pull = 0.01
    left, right = pull * np.eye(3), pull * near
    for place, way in ways:
        off = np.eye(3) - np.outer(way, way)
        left, right = left + off, right + off @ place
    return np.asarray(np.linalg.solve(left, right))
