"""Slow checker of embedded joints, from moves alone.

A later pass holds on to an earlier one where its path runs nearly half the thinner radius inside
the ink of the earlier one, whose ends are taken as flat.
"""

from itertools import pairwise

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import KDTree

from design.toolpath import MoveKind, Toolpath

HELD = 0.45
STEP_MM = 0.005


def bodies(toolpath: Toolpath) -> int:
    """Number of bodies that the passes make."""
    passes = passes_of(toolpath)
    ends = KDTree(np.array([line[k] for line, _ in passes for k in (0, -1)]))
    places = [_sampled(line, radius, ends) for line, radius in passes]
    held = [
        (early, late)
        for late in range(len(passes))
        for early in range(late)
        if _hold(*passes[early], *places[late])
    ]
    rows = np.array(held, dtype=np.int64).reshape(-1, 2).T
    graph = coo_array((np.ones(len(held)), tuple(rows)), shape=(len(passes),) * 2)
    return int(connected_components(graph, directed=False)[0])


def passes_of(toolpath: Toolpath) -> list[tuple[np.ndarray, np.ndarray]]:
    """Corners (k, 3) and radii of the moves (k - 1,) of each pass, mm.

    It lasts until the tip leaves the ink; the plunger may stand, and relieve, meanwhile.
    """
    write = np.flatnonzero(toolpath.kind == MoveKind.WRITE)
    left = np.cumsum(toolpath.kind == MoveKind.TRAVEL)[write]
    found = []
    for moves in np.split(write, np.flatnonzero(np.diff(left)) + 1):
        line = np.vstack([toolpath.start[moves[:1]], toolpath.end[moves]])
        area = toolpath.volume_ul[moves] / toolpath.lengths[moves]
        found.append((line, np.sqrt(area / np.pi)))
    return found


def _sampled(line, radius, ends):
    """Places along a pass near the end of any, and the radius there."""
    points, thick = [], []
    for (a, b), r in zip(pairwise(line), radius, strict=True):
        count = int(np.ceil(np.linalg.norm(b - a) / STEP_MM))
        here = a + (np.arange(count)[:, None] + 0.5) / count * (b - a)
        here = here[ends.query(here)[0] < 4 * radius.max()]
        points.append(here)
        thick.append(np.full(len(here), r))
    return np.concatenate(points), np.concatenate(thick)


def _hold(line, radius, places, thick) -> bool:
    """Whether enough of `places` lies inside the ink along a line."""
    inside = np.zeros(len(places), dtype=bool)
    ahead, behind = line[1] - line[0], line[-2] - line[-1]
    for k, (a, b) in enumerate(pairwise(line)):
        share = np.clip((places - a) @ (b - a) / ((b - a) @ (b - a)), 0, 1)
        within = np.linalg.norm(a + share[:, None] * (b - a) - places, axis=1) < radius[k]
        if k == 0:
            within &= (places - line[0]) @ ahead >= 0
        if k == len(line) - 2:
            within &= (places - line[-1]) @ behind >= 0
        inside |= within
    need = HELD * min(radius.min(), thick.min(initial=np.inf))
    return bool(inside.sum() * STEP_MM >= need)
