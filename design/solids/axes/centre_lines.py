"""Centre lines of a hollow's voxels, each from the farthest place that none has reached yet.

After Sato et al. 2000 (TEASAR, doi 10.1109/PCCGA.2000.883951): a path keeps away from walls and
takes up the voxels around it; what is left gives the next path. A piece left between two places
that are taken up closes a loop, which TEASAR's trees leave open.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import pairwise, product
from typing import Final, NamedTuple

import numpy as np
from manifold3d import Manifold
from scipy import ndimage

from design.geometry.mesh import connected_parts
from design.geometry.polyline import arc_lengths
from kernels.arrays import BoolArray, FloatArray, IntArray


class TracingLimits(NamedTuple):
    """How a hollow is found in a solid's voxels, and paths in the hollow."""

    # A path covers balls of so many times the distance to the wall, and so much more.
    covered_radii: float = 1.3
    covered_voxels: float = 2.0
    # radii: a shorter hollow is a dimple, a shorter branch the rest of a joint.
    min_length: float = 2.0
    min_bubble: float = 2.6  # radii: a shorter hollow without a way in is a bubble
    # Of the 13 through a voxel that meet the solid on both sides, in a hollow. A groove has
    # about 5, a notch 3, space outside a part none.
    lines: int = 11
    lines_at_mouth: int = 3  # The same within ``mouth`` radii of where a hollow opens
    mouth: float = 2.0  # radii


LIMITS: Final = TracingLimits()
ALL_NEIGHBOURS: Final = np.ones((3, 3, 3), dtype=np.bool_)
NO_PATH: Final = np.zeros((0, 3), dtype=np.int64)


@dataclass(frozen=True, eq=False)
class CentreLine:
    """A lumen's way between two nodes.

    Attributes
    ----------
    ends : (int, int)
        Numbers of the nodes.
    line : (n, 3) float64, mm
    radius : (n,) float64, mm
    is_sure : bool
        Whether the lines of its part of the hollow make as many loops as that has, and its
        sections are round.
    """

    ends: tuple[int, int]
    line: FloatArray
    radius: FloatArray
    is_sure: bool = True

    def reversed(self) -> CentreLine:
        """Return the same way from its other end."""
        return CentreLine(self.ends[::-1], self.line[::-1], self.radius[::-1], self.is_sure)


def centre_lines(hollow: Hollow) -> list[CentreLine]:
    """Trace a hollow's lumens; nodes are numbered from 0."""
    # Of the 13 through a voxel that meet the solid on both sides, in a hollow. A groove has
    # about 5, a notch 3, space outside a part none.
    lines: list[CentreLine] = []
    label, _ = ndimage.label(hollow.inside, ALL_NEIGHBOURS)
    for number, box in enumerate(ndimage.find_objects(label), 1):
        own = label[box] == number
        least = LIMITS.min_bubble if hollow.is_closed[box][own].all() else LIMITS.min_length
        own, wall = np.pad(own, 1), np.pad(hollow.wall[box], 1)
        traced = joined(_cut_at_forks(_Tracer(own, wall).paths(least), wall))
        nodes = {node for one in traced for node in one.ends}
        is_sure = len(traced) - len(nodes) + 1 == _loops(own)
        corner = hollow.origin + hollow.pitch * np.array([one.start - 1 for one in box])
        first = max((max(one.ends) for one in lines), default=-1) + 1
        for one in traced:
            place, wide = corner + hollow.pitch * one.line, hollow.pitch * one.radius
            a, b = one.ends
            lines.append(CentreLine((first + a, first + b), place, wide, is_sure))
    return lines


def _loops(own: BoolArray) -> int:
    """Count the independent loops of a connected piece by its Euler number."""
    from skimage.measure import euler_number  # slow to load

    islands = int(ndimage.label(~own)[1]) - 1
    return 1 + islands - int(euler_number(own, connectivity=3))


def _lengths(mask: BoolArray, seeds: IntArray) -> FloatArray:
    """Length of the way through `mask` to each voxel from the nearest of `seeds`; -1 elsewhere."""
    from skimage.graph import MCP_Geometric  # slow to load

    out = MCP_Geometric(np.where(mask, 1.0, -1.0)).find_costs(seeds)[0]
    return np.where(np.isfinite(out) & mask, out, -1.0)


def _tip(away: FloatArray, wall: FloatArray, inside: BoolArray) -> IntArray:
    """Return the voxel of an end: the middle of a mouth, not its rim."""
    return np.array(np.unravel_index((inside * (away + wall)).argmax(), away.shape))


class _Tracer:
    """Paths through one connected hollow, as voxels (n, 3) each."""

    def __init__(self, own: BoolArray, wall: FloatArray) -> None:
        self._own, self._wall = own, wall
        self._taken = np.zeros_like(own)
        self._on_line = np.zeros_like(own)
        self._margin = int(LIMITS.covered_radii * wall[own].max() + LIMITS.covered_voxels) + 2

    def paths(self, least: float) -> list[IntArray]:
        """Trace until what is left is no lumen; none if the first is below `least` radii."""
        tip = np.argwhere(self._own)[0]
        for _ in range(3):  # the farthest place from any is at an end
            start = tip
            away = _lengths(self._own, start[None])
            tip = _tip(away, self._wall, self._own)
        if away.max() < least * self._wall[self._own].max():
            return []
        paths = [self._route(self._own, self._wall, start[None], tip)]
        self._take(paths[0])
        todo = list(self._pieces(np.argwhere(self._own)))
        while todo:
            piece = todo.pop()
            path = self._branch(piece)
            if len(path):
                paths.append(path)
                self._take(path)
            todo += self._pieces(piece)
        return paths

    def _branch(self, piece: IntArray) -> IntArray:
        """Trace one branch or loop in a piece; take up what is too short or too broad for it."""
        margin = self._margin
        low, box = self._box_around(piece, margin)
        while not self._on_line[box].any():
            margin *= 2
            low, box = self._box_around(piece, margin)
        taken, wall = self._taken[box], self._wall[box]
        inside = np.zeros_like(taken)
        inside[tuple((piece - low).T)] = True
        seeds = np.argwhere(self._on_line[box])
        away = _lengths(inside | taken, seeds)
        near, far = float(away[inside].min()), float(away[inside].max())
        patch, count = ndimage.label(
            ndimage.binary_dilation(inside, ALL_NEIGHBOURS) & taken & (away >= 0), ALL_NEIGHBOURS
        )
        broad = np.sqrt(np.bincount(patch.ravel())[1:].max(initial=0))
        if far < 0 or far - near < broad:
            # No branch is as short as the place where it begins; what is farther off may be one.
            taken |= inside & (away < near + max(1.0, broad / 8))
            return NO_PATH
        path = self._route(inside | taken, wall, seeds, _tip(away, wall, inside))
        ends = [np.argwhere(patch == k) for k in range(1, count + 1)]
        ends = [one[away[tuple(one.T)].argmin()] for one in ends]
        legs = [self._route(taken, wall, seeds, end) for end in ends]
        for end, leg in zip(ends, legs, strict=True):
            one, two = leg[0], legs[0][0]
            if np.linalg.norm(one - two) > wall[tuple(one)] + wall[tuple(two)]:
                through = self._route(inside | (patch > 0), wall, ends[0][None], end)
                path = np.concatenate([legs[0], through[1:-1], leg[::-1]])
                break
        own = inside[tuple(path.T)]
        least = LIMITS.min_length * np.median(wall[tuple(path[own].T)])
        if own.sum() < max(least, wall[tuple(path[0])] / 2):
            taken |= inside
            return NO_PATH
        return path + low

    @staticmethod
    def _route(mask: BoolArray, wall: FloatArray, seeds: IntArray, end: IntArray) -> IntArray:
        """Return the voxels of the way off the walls from the nearest of `seeds` to `end`."""
        from skimage.graph import MCP_Geometric  # slow to load

        way = MCP_Geometric(np.where(mask, np.maximum(wall, 0.5) ** -2.0, -1.0))
        way.find_costs(seeds, [end])
        return np.array(way.traceback(end), dtype=np.int64)

    def _take(self, path: IntArray) -> None:
        """Take up what hangs together with a path in the balls around it."""
        low, box = self._box_around(path, self._margin)
        near = np.zeros_like(self._own[box])
        for place in path:
            reach = LIMITS.covered_radii * float(self._wall[tuple(place)]) + LIMITS.covered_voxels
            paint_ball(near, place - low, reach)
        self._on_line[tuple(path.T)] = True
        # Not the lumen behind the wall.
        label, _ = ndimage.label(near & self._own[box], ALL_NEIGHBOURS)
        self._taken[box] |= label == label[tuple(path[0] - low)]

    @staticmethod
    def _box_around(places: IntArray, margin: int) -> tuple[IntArray, tuple[slice, ...]]:
        """Return a box's first voxel, and its slices."""
        low = np.maximum(places.min(axis=0) - margin, 0)
        high = places.max(axis=0) + margin + 1
        return low, tuple(slice(*one) for one in zip(low, high, strict=True))

    def _pieces(self, piece: IntArray) -> Iterator[IntArray]:
        """Yield the connected pieces that no path has taken up, unless they are tiny."""
        low = piece.min(axis=0)
        mask = np.zeros(piece.max(axis=0) - low + 1, dtype=np.bool_)
        mask[tuple((piece - low).T)] = ~self._taken[tuple(piece.T)]
        label, _ = ndimage.label(mask, ALL_NEIGHBOURS)
        for number, box in enumerate(ndimage.find_objects(label), 1):
            index = np.argwhere(label[box] == number) + low + [one.start for one in box]
            if np.linalg.norm(np.ptp(index, axis=0)) > self._wall[tuple(index.T)].max():
                yield index
            else:
                self._taken[tuple(index.T)] = True


def paint_ball(out: BoolArray, middle: FloatArray | IntArray, reach: float) -> None:
    """Mark the voxels of `out` within `reach` voxels of a place."""
    low = np.maximum(np.ceil(middle - reach).astype(int), 0)
    high = np.minimum(np.floor(middle + reach).astype(int) + 1, out.shape)
    box = tuple(slice(*one) for one in zip(low, np.maximum(high, low), strict=True))
    axes = np.ogrid[box]
    out[box] |= sum((axis - m) ** 2 for axis, m in zip(axes, middle, strict=True)) <= reach**2


def _cut_at_forks(paths: list[IntArray], wall: FloatArray) -> list[CentreLine]:
    """Cut paths where others begin or end on them; nodes are numbers of voxels."""
    number = [np.ravel_multi_index(tuple(path.T), wall.shape).tolist() for path in paths]
    nodes = {one[k]: 0 for one in number for k in (0, -1)}
    nodes = {voxel: k for k, voxel in enumerate(nodes)}
    out = []
    for path, voxels in zip(paths, number, strict=True):
        at = [k for k, voxel in enumerate(voxels) if voxel in nodes]
        for i, j in pairwise(at):
            run, ends = path[i : j + 1], (nodes[voxels[i]], nodes[voxels[j]])
            out.append(CentreLine(ends, run.astype(np.float64), wall[tuple(run.T)]))
    return out


def joined(lines: list[CentreLine]) -> list[CentreLine]:
    """Make one node of those within a joint, and one line of two where just these meet."""
    if not lines:
        return []
    ends = np.array([one.ends for one in lines])
    degree = np.bincount(ends.ravel())
    radius = np.zeros(len(degree))
    np.maximum.at(radius, ends, np.array([one.radius[[0, -1]] for one in lines]))
    length = np.array([arc_lengths(one.line)[-1] for one in lines])
    # In the ball around a joint; at a free end, only the first path's, which begins at a wall.
    short = (degree[ends].max(axis=1) > 2) & (
        length < LIMITS.covered_radii * radius[ends].max(axis=1)
    )
    name = connected_parts(ends[short], len(degree))[ends]
    round_way = 2 * np.pi * np.array([one.radius.max() for one in lines])
    kept = ~short & ((name[:, 0] != name[:, 1]) | (length > round_way))
    lines = [
        replace(lines[k], ends=(int(name[k, 0]), int(name[k, 1]))) for k in np.flatnonzero(kept)
    ]
    while True:
        degree = np.bincount([end for one in lines for end in one.ends])
        for node in np.flatnonzero(degree == 2).tolist():
            pair = [one for one in lines if node in one.ends]
            if len(pair) == 2:
                break
        else:
            return lines
        lines = [one for one in lines if one not in pair]
        one = pair[0] if pair[0].ends[1] == node else pair[0].reversed()
        two = pair[1] if pair[1].ends[0] == node else pair[1].reversed()
        line, wide = np.vstack([one.line, two.line]), np.concatenate([one.radius, two.radius])
        lines.append(
            CentreLine((one.ends[0], two.ends[1]), line, wide, one.is_sure and two.is_sure)
        )


@dataclass(frozen=True, eq=False)
class Hollow:
    """Hollow of a solid on a grid of voxels, (nx, ny, nz).

    Attributes
    ----------
    inside : BoolArray
        Voxels of the hollow.
    wall : float32 array
        Distance to the nearest solid, voxels.
    is_closed : BoolArray
        Voxels of the hollow that no way leads to from outside.
    origin : (3,) float64, mm
        Middle of the first voxel.
    pitch : float, mm
    """

    inside: BoolArray
    wall: FloatArray
    is_closed: BoolArray
    origin: FloatArray
    pitch: float


def hollow_voxels(body: Manifold, pitch: float, *, is_lumen: bool) -> Hollow:
    """Return the hollow of a solid; with `is_lumen`, the solid itself is the hollow."""
    box = np.array(body.bounding_box())
    low = box[:3] - 2.0 * pitch  # no middle of a voxel on a face
    shape = tuple(np.ceil((box[3:] - low) / pitch + 1.6).astype(int).tolist())
    filled = _filled(body, low, pitch, shape)
    free = filled if is_lumen else ~filled
    wall = ndimage.distance_transform_edt(free).astype(np.float32)
    inside = filled if is_lumen else _shut_in(filled, wall)
    label, _ = ndimage.label(free)
    closed = free if is_lumen else inside & (label != label[0, 0, 0])
    return Hollow(inside, wall, closed, low + pitch / 2, pitch)


def _filled(body: Manifold, low: FloatArray, pitch: float, shape: tuple[int, ...]) -> BoolArray:
    """Voxels whose middle lies in the solid, by rays along z."""
    turns = np.zeros(shape, dtype=np.bool_)
    top = float(low[2] + pitch * shape[2])
    for i, j in np.ndindex(shape[:2]):
        x, y = (low[:2] + pitch * (np.array([i, j]) + 0.5)).tolist()
        for hit in body.ray_cast((x, y, float(low[2])), (x, y, top)):
            turns[i, j, int(np.ceil((hit.position[2] - low[2]) / pitch - 0.5))] ^= True
    return np.asarray(np.logical_xor.accumulate(turns, axis=2))


def _shut_in(filled: BoolArray, wall: FloatArray) -> BoolArray:
    """Free voxels in hollows that are shut in all round, out to where they open."""
    count = np.zeros(filled.shape, dtype=np.uint8)
    for way in product((-1, 0, 1), repeat=3):
        if way > (0, 0, 0):
            count += _behind(filled, way) & _behind(filled, tuple(-d for d in way))
    core = ~filled & (count >= LIMITS.lines)
    if not core.any():
        return core
    # Within about a width of its mouth a lumen is shut in less, and by its walls first.
    wall = np.where(core, wall, 0.0)
    size = 2 * int(np.ceil(np.percentile(wall[core], 90))) + 1
    away, nearest = ndimage.distance_transform_edt(~core, return_indices=True)
    reach = LIMITS.mouth * ndimage.maximum_filter(wall, size)[tuple(nearest)]
    near = ~filled & (count >= LIMITS.lines_at_mouth) & (away <= reach)
    label, _ = ndimage.label(near)
    return np.asarray(near & np.isin(label, np.unique(label[core & near])))


def _behind(filled: BoolArray, way: tuple[int, ...]) -> BoolArray:
    """Whether there is solid anywhere behind each voxel, against `way`."""
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
