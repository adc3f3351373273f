"""Centre lines of a hollow's voxels, each from the farthest place that none has reached yet.

After Sato et al. 2000 (TEASAR, doi 10.1109/PCCGA.2000.883951): a path keeps away from walls and
takes up the voxels around it; what is left gives the next path. A piece left between two places
that are taken up closes a loop, which TEASAR's trees leave open.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from scipy import ndimage
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from design.geometry.polyline import arc_lengths
from design.solids.hollow import ALL_NEIGHBOURS, Hollow
from kernels.arrays import BoolArray, FloatArray, IntArray

TAKEN_RADII: Final = 1.3
TAKEN_VOXELS: Final = 2.0
"""A path takes up balls of so many times the distance to the wall, and so much more."""
MIN_LENGTH_RADII: Final = 2.0
"""A shorter hollow is a dimple, a shorter branch the rest of a joint."""
MIN_BUBBLE_RADII: Final = 2.6
"""A shorter hollow without a way in is a bubble."""
JOINT_RADII: Final = 1.2
"""Ways between forks that are shorter, in the radius there, lie within one joint."""


@dataclass(frozen=True, eq=False)
class CentreLine:
    """A lumen's way between two nodes: places (n, 3), mm, and distances to walls (n,), mm."""

    a: int
    b: int
    line: FloatArray
    radius: FloatArray

    @property
    def length(self) -> float:
        """Length along the line, mm."""
        return float(arc_lengths(self.line)[-1])

    def reversed(self) -> CentreLine:
        """Return the same way from its other end."""
        return CentreLine(self.b, self.a, self.line[::-1], self.radius[::-1])


def centre_lines(hollow: Hollow) -> tuple[list[CentreLine], BoolArray]:
    """Trace a hollow's lumens.

    Returns
    -------
    list of CentreLine
        Nodes are numbered from 0.
    (n,) bool
        Whether the lines of the same part make more or fewer loops than its voxels have.
    """
    lines: list[CentreLine] = []
    doubtful: list[bool] = []
    label, _ = ndimage.label(hollow.inside, ALL_NEIGHBOURS)
    for number, box in enumerate(ndimage.find_objects(label), 1):
        own = label[box] == number
        least = MIN_BUBBLE_RADII if hollow.is_closed[box][own].all() else MIN_LENGTH_RADII
        own, wall = np.pad(own, 1), np.pad(hollow.wall[box], 1)
        traced = _joined(_cut_at_forks(_Tracer(own, wall).paths(least), wall))
        corner = hollow.origin + hollow.pitch * np.array([one.start - 1 for one in box])
        first = max((max(one.a, one.b) for one in lines), default=-1) + 1
        for one in traced:
            place, wide = corner + hollow.pitch * one.line, hollow.pitch * one.radius
            lines.append(CentreLine(first + one.a, first + one.b, place, wide))
        nodes = {node for one in traced for node in (one.a, one.b)}
        doubtful += [len(traced) - len(nodes) + 1 != _loops(own)] * len(traced)
    return lines, np.array(doubtful, dtype=np.bool_)


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


class _Tracer:
    """Paths through one connected hollow, as voxels (n, 3) each."""

    def __init__(self, own: BoolArray, wall: FloatArray) -> None:
        self._own, self._wall = own, wall
        self._taken = np.zeros_like(own)
        self._on_line = np.zeros_like(own)
        self._margin = int(TAKEN_RADII * wall[own].max() + TAKEN_VOXELS) + 2

    def paths(self, least: float) -> list[IntArray]:
        """Trace until what is left is no lumen; none if the first is below `least` radii."""
        tip = np.argwhere(self._own)[0]
        for _ in range(3):  # the farthest place from any is at an end
            start = tip
            away = _lengths(self._own, start[None])
            tip = np.array(np.unravel_index(away.argmax(), away.shape))
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
        low = np.maximum(piece.min(axis=0) - self._margin, 0)
        high = piece.max(axis=0) + self._margin + 1
        box = tuple(slice(*one) for one in zip(low, high, strict=True))
        taken, wall = self._taken[box], self._wall[box]
        inside = np.zeros_like(taken)
        inside[tuple((piece - low).T)] = True
        seeds = np.argwhere(self._on_line[box])
        away = _lengths(inside | taken, seeds)
        near, far = float(away[inside].min()), float(away[inside].max())
        if far < 0:
            taken |= inside
            return np.zeros((0, 3), dtype=np.int64)
        patch, count = ndimage.label(
            ndimage.binary_dilation(inside, ALL_NEIGHBOURS) & taken & (away >= 0), ALL_NEIGHBOURS
        )
        broad = np.sqrt(np.bincount(patch.ravel())[1:].max(initial=0))
        if far - near < broad:
            # Nothing goes on from here but what is farther off.
            rest = inside & (away < near + max(1.0, broad / 8))
            self._taken[box] |= rest
            return np.zeros((0, 3), dtype=np.int64)
        path = self._route(inside | taken, wall, seeds, np.argwhere(inside & (away == far))[0])
        contact = [np.argwhere(patch == k) for k in range(1, count + 1)]
        contact = [one[away[tuple(one.T)].argmin()] for one in contact]
        legs = [self._route(taken, wall, seeds, one) for one in contact]
        apart = [k for k, leg in enumerate(legs) if self._are_apart(leg[0], legs[0][0], wall)]
        if apart:
            rim = inside | (patch > 0)
            through = self._route(rim, wall, contact[0][None], contact[apart[0]])
            path = np.concatenate([legs[0], through[1:-1], legs[apart[0]][::-1]])
        own = inside[tuple(path.T)]
        radius = np.median(wall[tuple(path[own].T)])
        if own.sum() < MIN_LENGTH_RADII * radius:
            taken |= inside
            return np.zeros((0, 3), dtype=np.int64)
        return path + low

    @staticmethod
    def _are_apart(one: IntArray, other: IntArray, wall: FloatArray) -> bool:
        return bool(np.linalg.norm(one - other) > wall[tuple(one)] + wall[tuple(other)])

    @staticmethod
    def _route(mask: BoolArray, wall: FloatArray, seeds: IntArray, end: IntArray) -> IntArray:
        """Return the voxels of the way off the walls from the nearest of `seeds` to `end`."""
        from skimage.graph import MCP_Geometric  # slow to load

        way = MCP_Geometric(np.where(mask, np.maximum(wall, 0.5) ** -2.0, -1.0))
        way.find_costs(seeds, [end])
        return np.array(way.traceback(end), dtype=np.int64)

    def _take(self, path: IntArray) -> None:
        """Take up what hangs together with a path in the balls around it."""
        low = np.maximum(path.min(axis=0) - self._margin, 0)
        box = tuple(slice(*one) for one in zip(low, path.max(axis=0) + self._margin + 1, strict=True))
        near = np.zeros_like(self._own[box])
        for place in path:
            reach = TAKEN_RADII * float(self._wall[tuple(place)]) + TAKEN_VOXELS
            paint_ball(near, place - low, reach)
        self._on_line[tuple(path.T)] = True
        # Not the lumen behind the wall.
        label, _ = ndimage.label(near & self._own[box], ALL_NEIGHBOURS)
        self._taken[box] |= label == label[tuple(path[0] - low)]

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
    number = [np.ravel_multi_index(tuple(path.T), wall.shape) for path in paths]
    ends = {int(one[k]) for one in number for k in (0, -1)}
    nodes = {voxel: k for k, voxel in enumerate(sorted(ends))}
    out = []
    for path, voxels in zip(paths, number, strict=True):
        at = [k for k, voxel in enumerate(voxels.tolist()) if voxel in nodes]
        for i, j in zip(at[:-1], at[1:], strict=True):
            run = path[i : j + 1]
            out.append(CentreLine(nodes[int(voxels[i])], nodes[int(voxels[j])],
                                  run.astype(np.float64), wall[tuple(run.T)]))  # fmt: skip
    return out


def _joined(lines: list[CentreLine]) -> list[CentreLine]:
    """Make one node of those within a joint, and one line of two where just these meet."""
    if not lines:
        return []
    ends = np.array([(one.a, one.b) for one in lines])
    degree = np.bincount(ends.ravel())
    radius = np.zeros(len(degree))
    for one in lines:
        np.maximum.at(radius, [one.a, one.b], one.radius[[0, -1]])
    length = np.array([one.length for one in lines])
    short = (degree[ends].min(axis=1) > 1) & (length < JOINT_RADII * radius[ends].max(axis=1))
    size = (len(degree), len(degree))
    joint = coo_array((np.ones(short.sum()), tuple(ends[short].T)), shape=size)
    name = connected_components(joint, directed=False)[1]
    lines = [replace(one, a=int(name[one.a]), b=int(name[one.b])) for one in lines]
    lines = [
        one for one in lines if one.a != one.b or one.length > 2 * np.pi * float(one.radius.max())
    ]
    while True:
        degree = np.bincount([end for one in lines for end in (one.a, one.b)])
        for node in np.flatnonzero(degree == 2).tolist():
            pair = [one for one in lines if node in (one.a, one.b)]
            if len(pair) == 2:
                break
        else:
            return lines
        one, two = pair
        lines = [other for other in lines if other is not one and other is not two]
        one = one if one.b == node else one.reversed()
        two = two if two.a == node else two.reversed()
        line, wide = np.vstack([one.line, two.line]), np.concatenate([one.radius, two.radius])
        lines.append(CentreLine(one.a, two.b, line, wide))
