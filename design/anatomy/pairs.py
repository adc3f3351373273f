"""Artery and vein side by side within the sheaths of one tree."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from design.vasculature.tree import VesselTree
from design.vasculature.treemath import downward_order, tree_from_topology, tree_radii

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

_TAPER = 3.0
"""Way along a branch, over its parent's offset, in which artery and vein come together."""

_PIECES = 5


@dataclass(frozen=True)
class PairOptions:
    """How an artery and its vein share a sheath.

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
    gap_ratio: float = 0.3
    gap_mm: float = 0.0

    @property
    def sheath(self) -> float:
        """Radius of a sheath over its artery's."""
        return 1.0 + self.vein_over_artery + 0.5 * self.gap_ratio


def paired_trees(
    sheaths: VesselTree, pressure_drop_pa: float, options: PairOptions
) -> tuple[VesselTree, VesselTree, IntArray]:
    """Artery and vein of the same branching, on either side of the sheaths' axes.

    At a joint they lie above and below the plane of its branches, so that no branch of one
    crosses the other; on the way from joint to joint they turn about the axis.

    Parameters
    ----------
    sheaths : VesselTree
        Its radii have room for both.
    pressure_drop_pa : float
        Of the artery's tree; the vein's is less by the fourth power of the radii's ratio.

    Returns
    -------
    artery, vein : VesselTree
    segment : (n,) int64
        Of the sheaths' tree, that each segment of both comes from.
    """
    fine, segment = _in_pieces(sheaths)
    radius = tree_radii(fine) / options.sheath
    side, reach = _sides(fine, radius, options)
    gap = np.maximum(options.gap_ratio * reach, options.gap_mm)
    artery = (options.vein_over_artery * reach + 0.5 * gap)[:, None] * side
    vein = -(reach + 0.5 * gap)[:, None] * side
    drop = pressure_drop_pa / options.vein_over_artery**4
    return _moved(fine, artery, pressure_drop_pa), _moved(fine, vein, drop), segment


def _in_pieces(tree: VesselTree) -> tuple[VesselTree, IntArray]:
    """The tree with each segment parted into pieces of even length, where it is long."""
    radius = tree_radii(tree)
    length = np.linalg.norm(tree.distal - tree.proximal, axis=1)
    parts = np.clip(np.floor(length / (1.2 * radius)), 1, _PIECES).astype(np.int64)
    # The root alone may begin outside, and so stays in one piece.
    parts[0] = 1
    last = np.cumsum(parts) - 1
    size = int(last[-1]) + 1
    segment = np.repeat(np.arange(len(parts)), parts)
    step = np.arange(size) - (last - parts + 1)[segment]
    way = (tree.distal - tree.proximal)[segment]
    part = (step / parts[segment])[:, None]
    begin = tree.proximal[segment] + part * way
    end = tree.proximal[segment] + (part + 1.0 / parts[segment][:, None]) * way
    tail = step == parts[segment] - 1
    end[tail] = tree.distal[segment[tail]]
    above = tree.parent[segment]
    parent = np.where(
        step > 0, np.arange(size) - 1, np.where(above >= 0, last[np.maximum(above, 0)], -1)
    )
    first = last - parts + 1
    children = np.full((size, 2), -1, dtype=np.int32)
    inner = np.flatnonzero(~tail)
    children[inner, 0] = inner + 1
    old = tree.children[segment[tail]]
    children[tail] = np.where(old >= 0, first[np.maximum(old, 0)], -1)
    return _like(tree, begin, end, parent.astype(np.int32), children, segment), segment


def _like(
    tree: VesselTree,
    proximal: FloatArray,
    distal: FloatArray,
    parent: NDArray[np.int32],
    children: NDArray[np.int32],
    segment: IntArray,
    pressure_drop_pa: float | None = None,
) -> VesselTree:
    found = tree_from_topology(
        proximal,
        distal,
        parent,
        children,
        flow_ul_s=float(tree.flow_ul_s[0]),
        pressure_drop_pa=pressure_drop_pa or tree.pressure_drop_pa,
        murray_exponent=tree.murray_exponent,
        viscosity_pa_s=tree.viscosity_pa_s,
        relative_flow=tree.relative_flow[segment],
        haematocrit=tree.haematocrit,
        given=np.zeros(len(parent), dtype=np.bool_),
    )
    return replace(found, notes=tree.notes)


def _moved(tree: VesselTree, by: FloatArray, pressure_drop_pa: float) -> VesselTree:
    """The tree with its nodes moved by ``by`` (n + 1, 3): the inlet's, then each far end's."""
    distal = tree.distal + by[1:]
    begin = np.where(
        (tree.parent >= 0)[:, None],
        distal[np.maximum(tree.parent, 0)],
        tree.proximal + by[0],
    )
    every = np.arange(len(tree.parent))
    return _like(tree, begin, distal, tree.parent, tree.children, every, pressure_drop_pa)


def _sides(
    tree: VesselTree, radius: FloatArray, options: PairOptions
) -> tuple[FloatArray, FloatArray]:
    """Unit vector to the artery at each node (n + 1, 3), and the artery's radius there (n + 1,).

    Node 0 is the inlet, node i + 1 the far end of segment i.
    """
    way = tree.distal - tree.proximal
    length = np.linalg.norm(way, axis=1)
    unit = way / length[:, None]
    side, reach = np.zeros((len(way) + 1, 3)), np.zeros(len(way) + 1)
    side[0] = _across(np.eye(3)[np.argmin(np.abs(unit[0]))], unit[0])
    reach[0] = radius[0]
    offset = options.vein_over_artery + 1.0
    done = [(0, 0)]
    while done:
        first, node = done.pop()
        run = [first]
        while tree.children[run[-1], 0] >= 0 and tree.children[run[-1], 1] < 0:
            run.append(int(tree.children[run[-1], 0]))
        along = np.cumsum(length[run])
        carried, turned = side[node], []
        for s in run:
            carried = _across(carried, unit[s])
            turned.append(carried)
        a, b = tree.children[run[-1]]
        end, twist = unit[run[-1]], 0.0
        if b >= 0:
            plane = np.cross(unit[a], unit[b])
            if np.linalg.norm(plane) > 0.05:
                wanted = _across(plane, end)
                wanted = wanted if wanted @ turned[-1] >= 0 else -wanted
                twist = np.arctan2(np.cross(turned[-1], wanted) @ end, turned[-1] @ wanted)
        taper = _TAPER * offset * max(reach[node] - radius[first], 0.0)
        for s, on, here in zip(run, turned, along.tolist(), strict=True):
            part = here / along[-1]
            angle = twist * part * part * (3.0 - 2.0 * part)
            side[s + 1] = np.cos(angle) * on + np.sin(angle) * np.cross(unit[s], on)
            left = 0.5 * (1.0 + np.cos(np.pi * min(1.0, here / taper))) if taper > 0 else 0.0
            reach[s + 1] = radius[s] + left * max(reach[node] - radius[s], 0.0)
        if b >= 0:
            done += [(int(a), run[-1] + 1), (int(b), run[-1] + 1)]
        elif a >= 0:
            done.append((int(a), run[-1] + 1))
    return side, reach


def _across(vector: FloatArray, axis: FloatArray) -> FloatArray:
    """A vector's part across an axis, of length 1."""
    found = vector - (vector @ axis) * axis
    size = float(np.linalg.norm(found))
    if size < 1e-6:
        found = np.cross(axis, np.eye(3)[np.argmin(np.abs(axis))])
        size = float(np.linalg.norm(found))
    unit: FloatArray = found / size
    return unit
