"""Find vessel runs whose walls overlap without a common junction."""

from __future__ import annotations

from typing import Any

import numpy as np

from design.geometry.close_pairs import close_pairs
from design.solids.smooth.layout import Layout
from kernels.arrays import IntArray

_CLEARANCE = 0.03
"""Of the thinner radius: a polygon's corners stand that far over its circle."""

_BEND = 2.5
"""Pieces of one run no farther apart along it than this many times both radii are one bend."""


def overlapping_runs(layout: Layout) -> IntArray:
    """Pairs of runs (k, 2) whose walls overlap away from a common junction.

    A run paired with itself winds into itself.
    """
    starts, ends, radii, nodes, run_of, along = _pieces(layout)
    pairs, _, _ = close_pairs(starts, ends, radii, nodes, 0.0, _CLEARANCE)
    if len(pairs) == 0:
        return np.empty((0, 2), dtype=np.int64)
    both = radii[pairs].sum(axis=1)
    one, two = run_of[pairs].T
    length = np.linalg.norm(ends - starts, axis=1)
    near = np.abs(along[pairs[:, 0]] - along[pairs[:, 1]]) - length[pairs].sum(axis=1) / 2
    bend = (one == two) & (near <= _BEND * both)
    return np.unique(np.stack([one, two], axis=1)[~bend], axis=0)


def _pieces(layout: Layout) -> tuple[Any, Any, Any, Any, Any, Any]:
    """Start, end, radius, end nodes, run and place along it (of the middle) of all pieces."""
    joint_of = layout.joint_of()
    starts, ends, radii, nodes, run_of, along = [], [], [], [], [], []
    free = len(layout.ends)
    for index, run in enumerate(layout.runs):
        count = len(run.points)
        own = free + np.arange(count)
        free += count
        for end in (0, 1):
            own[-end] = joint_of.get((index, end), own[-end])
        starts.append(run.points[:-1])
        ends.append(run.points[1:])
        radii.append(np.maximum(run.radius[:-1], run.radius[1:]))
        nodes.append(np.stack([own[:-1], own[1:]], axis=1))
        run_of.append(np.full(count - 1, index))
        step = np.linalg.norm(np.diff(run.points, axis=0), axis=1)
        along.append(np.cumsum(step) - 0.5 * step)
    arrays = [np.concatenate(x) for x in (starts, ends, radii, nodes, run_of, along)]
    return arrays[0], arrays[1], arrays[2], arrays[3], arrays[4], arrays[5]
