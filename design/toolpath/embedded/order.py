"""Order pieces so that the shaft meets as little of what is written as the rules allow."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import connected_components

from design.toolpath.embedded.pieces import Piece
from design.toolpath.embedded.shaft import Conflicts
from design.toolpath.toolpath import IntArray


def order_pieces(
    pieces: list[Piece], conflicts: Conflicts, head: IntArray | None = None
) -> list[Piece]:
    """Topological order (Kahn), the nearest free piece first.

    Of several heads (``head`` of each piece) the one in use goes on as long as a piece of its own
    is free: a change takes longer than any way. Where only cycles are left, the piece of a
    foremost cycle (a strong component that waits for no other) with the least harm goes first.
    Level pieces are turned to where they begin nearer.
    """
    start = np.array([piece.points[0] for piece in pieces])
    finish = np.array([piece.points[-1] for piece in pieces])
    either = np.array([piece.reversible for piece in pieces])
    rules = _rules_by_first(len(pieces), conflicts)
    waiting = np.bincount(conflicts.second, minlength=len(pieces))
    left = np.ones(len(pieces), dtype=bool)
    tip = start[np.argmin(start[:, 2])]
    in_use = None if head is None else int(head.min(initial=0))
    placed: list[Piece] = []
    for _ in pieces:
        free = np.flatnonzero(left & (waiting == 0))
        if len(free) == 0:
            free = np.array([_least_harm(left, conflicts)])
        if head is not None and (own := free[head[free] == in_use]).size:
            free = own
        gap = np.linalg.norm(start[free] - tip, axis=1)
        back = np.where(either[free], np.linalg.norm(finish[free] - tip, axis=1), np.inf)
        best = int(np.argmin(np.minimum(gap, back)))
        chosen, turn = int(free[best]), bool(back[best] < gap[best])
        placed.append(pieces[chosen].reversed() if turn else pieces[chosen])
        tip = placed[-1].points[-1]
        in_use = None if head is None else int(head[chosen])
        left[chosen] = False
        waiting[conflicts.second[rules[chosen]]] -= 1
    return placed


def _rules_by_first(count: int, conflicts: Conflicts) -> list[IntArray]:
    by_first = np.argsort(conflicts.first, kind="stable")
    ends = np.cumsum(np.bincount(conflicts.first, minlength=count))
    return np.split(by_first, ends[:-1])


def _least_harm(left: NDArray[np.bool_], conflicts: Conflicts) -> int:
    live = left[conflicts.first] & left[conflicts.second]
    first, second = conflicts.first[live], conflicts.second[live]
    harm = np.bincount(second, weights=conflicts.harm_mm[live], minlength=len(left))
    graph = csr_matrix((np.ones(len(first)), (first, second)), shape=(len(left),) * 2)
    _, component = connected_components(graph, directed=True, connection="strong")
    follows = np.zeros(component.max() + 1, dtype=bool)
    follows[component[second[component[first] != component[second]]]] = True
    foremost = np.flatnonzero(left & ~follows[component])
    return int(foremost[np.argmin(harm[foremost])])
