"""Resolve overlaps of planned trunk vessels: move forks downstream, or drop thinner branches."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from design.anatomy.trunk_lines import TrunkLines, in_order, without
from design.errors import WideTrunkError
from design.network import VesselKind, VesselNetwork
from design.tissue import Tissue
from design.vasculature.collide import collisions
from design.vasculature.options import GrowthOptions
from kernels.arrays import FloatArray, IntArray

_STUB = 4
_SPACING = 1.25
"""Room between trunks over what their radii and clearance ask for."""

_FORK = 6.0
"""Way from a fork to where its two branches are too near, over their radii, within which they fork
later rather than one is left away."""


@dataclass(frozen=True)
class _Clashes:
    """What of trunk lines is too near or out of the tissue.

    Attributes
    ----------
    pairs : (k, 2) int64
        Nodes at which two pieces end that are too near.
    outside : (m,) int64
        Nodes at which pieces end that leave the tissue.
    """

    pairs: IntArray
    outside: IntArray


def clear_trunks(
    tissue: Tissue,
    laid: TrunkLines,
    lines: TrunkLines,
    radius: FloatArray,
    options: GrowthOptions,
    wider: float = 1.0,
    later: bool = True,
    main: frozenset[bytes] = frozenset(),
) -> tuple[TrunkLines, FloatArray] | None:
    """Lines and radii with less in each other's way; None where nothing is.

    Two branches that are too near just after their fork fork a node later. Of other pairs the
    thinner is left away with all below it, as is what leaves the tissue.

    Parameters
    ----------
    laid : TrunkLines
        Where the nodes lie.
    lines : TrunkLines
        The same nodes, of which the result is made.
    radius : (n,) float64, mm
    wider : float
        Radii by which trunks are kept apart, over theirs.
    later : bool
        Whether branches may fork later.
    main : frozenset of bytes
        Nodes of ``lines``, as bytes, that stay rather than others, however thin they are.

    Raises
    ------
    WideTrunkError
        Where a tree has no trunk left.
    """
    found = _clashes(tissue, laid, wider * radius, options)
    if not len(found.pairs) + len(found.outside):
        return None
    tree = _Branches(lines, laid.points, radius, options.murray_exponent)
    gone = np.zeros(len(radius), dtype=np.bool_)
    gone[found.outside] = True
    stuck: list[tuple[int, int]] = []
    for a, b in found.pairs.tolist():
        if not (later and tree.fork_later(a, b)):
            stuck.append((a, b))
    for a, b in stuck:
        first, second = (lines.points[node].tobytes() in main for node in (a, b))
        a_goes = second if first != second else radius[a] < radius[b]
        thinner = a if a_goes else b
        # What feeds more by now, as another branch was joined on it, is judged once laid anew.
        gone[thinner] |= tree.radius[thinner] <= radius[thinner]
    order, lines = in_order(TrunkLines(tree.points, tree.parent, tree.tree, tree.share))
    gone = np.append(gone, np.zeros(len(order) - len(gone), dtype=np.bool_))
    dropped, gone, radius = tree.dropped[order], gone[order], tree.radius[order]
    lines, gone, radius = without(lines, dropped), gone[~dropped], radius[~dropped]
    gone = _whole_branches(lines, gone)
    return without(lines, gone), radius[~gone]


class _Branches:
    """Trunk lines whose branches can be joined on elsewhere."""

    def __init__(
        self, lines: TrunkLines, laid: FloatArray, radius: FloatArray, exponent: float
    ) -> None:
        self.points, self.laid, self.tree = lines.points, laid, lines.tree
        self.parent, self.share = lines.parent.copy(), lines.share.copy()
        self.count = lines.child_count()
        self.child = lines.main_child()
        self.radius, self.exponent = radius.copy(), exponent
        self.touched = np.zeros(len(radius), dtype=np.bool_)
        self.dropped = np.zeros(len(radius), dtype=np.bool_)

    def fork_later(self, a: int, b: int) -> bool:
        """Join the branch that ends at node ``a`` or ``b`` on a node later; whether it could be.

        A fork is moved once a round.
        """
        up_a, up_b = self._ancestors(a), self._ancestors(b)
        below = set(up_b)
        fork = next((node for node in up_a if node in below), -1)
        if fork in (-1, a, b):
            return False
        one, two = up_a[up_a.index(fork) - 1], up_b[up_b.index(fork) - 1]
        reach = _FORK * float(self.radius[a] + self.radius[b])
        if max(self._way(up_a, fork), self._way(up_b, fork)) > reach:
            return False
        main, branch = (one, two) if self.share[one] >= self.share[two] else (two, one)
        if self.touched[[fork, main, branch]].any():
            return True
        if self.count[main] > 1 and self.count[branch] > 1:
            return self._join_below(fork, main, branch)
        if self.count[main] != 1:
            main, branch = branch, main
        if self.count[main] != 1 or self.count[branch] == 0:
            return False
        self._join_on(main, branch)
        self.touched[[fork, main, branch]] = True
        return True

    def _join_below(self, fork: int, main: int, branch: int) -> bool:
        """Let the branch leave midway from ``main``, itself a fork, to its wider child."""
        heir = int(self.child[main])
        if self.touched[heir]:
            return True
        node = len(self.parent)
        for name in ("points", "laid"):
            places = getattr(self, name)
            middle = 0.5 * (places[main] + places[heir])
            setattr(self, name, np.append(places, middle[None], axis=0))
        for name, value in (("parent", main), ("count", 1), ("child", heir)):
            setattr(self, name, np.append(getattr(self, name), value))
        for name in ("tree", "share", "radius", "touched", "dropped"):
            values = getattr(self, name)
            setattr(self, name, np.append(values, values[heir]))
        self.parent[heir] = node
        self._join_on(node, branch)
        self._carry(main, branch)
        self.touched[[fork, main, branch, heir, node]] = True
        return True

    def _join_on(self, main: int, branch: int) -> None:
        """Let the branch leave from ``main``, without its first node where that is no fork."""
        first = branch
        if self.count[branch] == 1:
            first = int(self.child[branch])
            self.dropped[branch] = True
            self.touched[first] = True
        self.parent[first] = main
        self._carry(main, first)

    def _carry(self, node: int, branch: int) -> None:
        """Let a node feed a branch besides what it feeds."""
        self.share[node] += self.share[branch]
        n = self.exponent
        self.radius[node] = (self.radius[node] ** n + self.radius[branch] ** n) ** (1.0 / n)

    def _ancestors(self, node: int) -> list[int]:
        """The node and all above it, in the lines as they were given or were joined since."""
        above = []
        while node >= 0:
            above.append(node)
            node = int(self.parent[node])
        return above

    def _way(self, above: list[int], fork: int) -> float:
        path = self.laid[above[: above.index(fork) + 1]]
        return float(np.linalg.norm(np.diff(path, axis=0), axis=1).sum())


def _clashes(
    tissue: Tissue, lines: TrunkLines, radius: FloatArray, options: GrowthOptions
) -> _Clashes:
    piece = np.flatnonzero(lines.parent >= 0)
    network = VesselNetwork.from_segments(
        lines.points,
        np.column_stack([lines.parent[piece], piece]),
        radius[piece],
        np.full(len(piece), int(VesselKind.ARTERY)),
        lines.tree[piece],
    )
    clear = _SPACING * options.clearance_mm
    near = collisions(network, clear, _SPACING * options.clearance_ratio)
    pairs = piece[near.vessels] if near.count else np.empty((0, 2), dtype=np.int64)
    # What lacks a little is sunk once its radius is known.
    inside = tissue.grid.capsule_inside(
        lines.points[lines.parent[piece]], lines.points[piece], 0.5 * radius[piece]
    )
    enters = lines.parent[lines.parent[piece]] < 0
    return _Clashes(pairs, piece[~inside & ~enters])


def _whole_branches(lines: TrunkLines, gone: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """All that lies below what is gone, and stubs of less than `_STUB` nodes above it."""
    if not gone.any():
        return gone
    gone = gone.copy()
    count = lines.child_count()
    for i in range(len(gone)):
        if lines.parent[i] >= 0:
            gone[i] |= gone[lines.parent[i]]
    for i in np.flatnonzero(gone).tolist():
        stub = []
        above = int(lines.parent[i])
        while above >= 0 and not gone[above] and count[above] == 1 and lines.parent[above] >= 0:
            stub.append(above)
            above = int(lines.parent[above])
        if len(stub) < _STUB:
            gone[stub] = True
    trees = np.unique(lines.tree[~gone & (lines.parent >= 0)])
    if gone[lines.parent < 0].any() or len(trees) < len(np.unique(lines.tree)):
        raise WideTrunkError("the trunks don't fit with the radii they would have")
    return gone
