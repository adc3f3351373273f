"""Two trunks side by side, artery and vein, in place of one."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from design.anatomy.trunk_lines import TrunkLines

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

PARTS = 3
"""Parts of each piece of trunk lines, between which artery and vein turn about each other."""

_TURN = 0.7
"""Way in which a pair turns by one radian, over the distance of artery and vein."""

_TAPER = 3.0
"""Way along a branch, over its parent's offset, in which artery and vein come together."""


@dataclass(frozen=True)
class PairOptions:
    """How an artery and its vein run side by side.

    Attributes
    ----------
    vein_over_artery : float
        Radius of a vein over its artery's.
    gap_ratio : float
        Wall between them over the artery's radius, in wide vessels.
    gap_mm : float, mm
        Least wall between them.
    """

    vein_over_artery: float = 1.2
    gap_ratio: float = 0.5
    gap_mm: float = 0.0

    @property
    def sheath(self) -> float:
        """Radius of what holds both over the artery's."""
        return 1.0 + self.vein_over_artery + 0.5 * self.gap_ratio


def paired_lines(
    lines: TrunkLines, radius: FloatArray, options: PairOptions
) -> tuple[TrunkLines, TrunkLines]:
    """Artery and vein of the same branching, on either side of a tree of trunk lines.

    At a joint they lie above and below the plane of its branches, so that no branch of one
    crosses the other; on the way from joint to joint they turn about the axis.

    Parameters
    ----------
    lines : TrunkLines
        One tree.
    radius : (n,) float64, mm
        Of the artery's piece that ends at each node.
    """
    side, reach = _sides(lines, radius, options)
    gap = np.maximum(options.gap_ratio * reach, options.gap_mm)
    artery = lines.points + (options.vein_over_artery * reach + 0.5 * gap)[:, None] * side
    vein = lines.points - (reach + 0.5 * gap)[:, None] * side
    return (
        TrunkLines(artery, lines.parent, np.zeros_like(lines.tree), lines.share),
        TrunkLines(vein, lines.parent, np.ones_like(lines.tree), lines.share),
    )


def _sides(
    lines: TrunkLines, radius: FloatArray, options: PairOptions
) -> tuple[FloatArray, FloatArray]:
    """Unit vector to the artery at each node (n, 3), and the artery's radius there (n,)."""
    up = np.maximum(lines.parent, 0)
    way = lines.points - lines.points[up]
    length = np.linalg.norm(way, axis=1)
    unit = way / np.maximum(length, 1e-12)[:, None]
    children = [np.flatnonzero(lines.parent == i).tolist() for i in range(len(up))]
    side, reach = np.zeros_like(way), radius.copy()
    offset = options.vein_over_artery + 1.0
    inlet = int(np.flatnonzero(lines.parent < 0)[0])
    ahead = unit[children[inlet][0]]
    side[inlet] = _across(np.eye(3)[np.argmin(np.abs(ahead))], ahead)
    done = [(child, inlet) for child in children[inlet]]
    entering = True
    while done:
        first, node = done.pop()
        run = [first]
        while len(children[run[-1]]) == 1:
            run.append(children[run[-1]][0])
        along = np.cumsum(length[run])
        carried, turned = side[node], []
        for i in run:
            carried = _across(carried, unit[i])
            turned.append(carried)
        below, twist = children[run[-1]], 0.0
        if len(below) == 2:
            plane, end = np.cross(unit[below[0]], unit[below[1]]), unit[run[-1]]
            if np.linalg.norm(plane) > 0.05:
                wanted = _across(plane, end)
                wanted = wanted if wanted @ turned[-1] >= 0 else -wanted
                twist = float(np.arctan2(np.cross(turned[-1], wanted) @ end, turned[-1] @ wanted))
        if entering:
            # The pair enters as its first joint asks for, and so needn't turn on the way.
            side[inlet] = _rotated(side[inlet], unit[first], twist)
            done, entering = [(first, inlet)], False
            continue
        most = along[-1] / (_TURN * offset * max(float(reach[node]), float(radius[first])))
        twist = float(np.clip(twist, -most, most))
        wider = max(float(reach[node] - radius[first]), 0.0)
        taper = _TAPER * offset * wider
        for i, on, here in zip(run, turned, along.tolist(), strict=True):
            part = here / along[-1]
            angle = twist * part * part * (3.0 - 2.0 * part)
            side[i] = _rotated(on, unit[i], angle)
            left = 0.5 * (1.0 + np.cos(np.pi * min(1.0, here / taper))) if taper > 0 else 0.0
            reach[i] = radius[i] + left * wider
        done += [(child, run[-1]) for child in below]
    return side, reach


def refined(
    lines: TrunkLines, values: FloatArray, parts: int
) -> tuple[TrunkLines, FloatArray, IntArray]:
    """The lines with each piece in so many parts, values (n,) of each, and the old nodes' places."""
    count = len(lines.parent)
    place = np.where(lines.parent < 0, 0, parts - 1)
    size = np.where(lines.parent < 0, 1, parts)
    place = np.cumsum(size) - 1
    node = np.repeat(np.arange(count), size)
    step = np.arange(len(node)) - (place - size + 1)[node] + 1
    up = np.maximum(lines.parent, 0)
    part = (step / size[node])[:, None]
    points = lines.points[up[node]] + part * (lines.points[node] - lines.points[up[node]])
    points[place] = lines.points
    begins = step == 1
    parent = np.where(begins, place[up[node]], np.arange(len(node)) - 1)
    parent[place[lines.parent < 0]] = -1
    fine = TrunkLines(points, parent, lines.tree[node], lines.share[node])
    return fine, values[node], place


def _rotated(vector: FloatArray, axis: FloatArray, angle: float) -> FloatArray:
    """A vector across an axis, turned about it."""
    turned: FloatArray = np.cos(angle) * vector + np.sin(angle) * np.cross(axis, vector)
    return turned


def _across(vector: FloatArray, axis: FloatArray) -> FloatArray:
    """A vector's part across an axis, of length 1."""
    found = vector - (vector @ axis) * axis
    size = float(np.linalg.norm(found))
    if size < 1e-6:
        found = np.cross(axis, np.eye(3)[np.argmin(np.abs(axis))])
        size = float(np.linalg.norm(found))
    unit: FloatArray = found / size
    return unit
