"""Decompose a network into touching cylinders, cones and balls, for STEP files."""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass

import numpy as np

from design.network import VesselNetwork
from design.solids.chains import Chain
from design.solids.facets import Facets
from design.solids.runs import split_runs
from design.solids.smooth.overlap_group import CLEAR_OF_TUBES
from kernels.arrays import FloatArray, IntArray

_OFF_AXIS = 0.02
"""Of the radius: how far a curved vessel's axis and radius may be from its straight pieces'."""

_MITRED_MM = 1e-3


@dataclass(frozen=True)
class Piece:
    """A cylinder or cone between two points, or a ball where they are one.

    Attributes
    ----------
    start, end : (3,) float64, mm
    radius0, radius1 : float, mm
    """

    start: FloatArray
    end: FloatArray
    radius0: float
    radius1: float

    @property
    def is_ball(self) -> bool:
        """Whether it has no length."""
        return bool(np.array_equal(self.start, self.end))


def step_pieces(network: VesselNetwork) -> list[Piece]:
    """Return frusta of all vessels, and balls at junctions, bends and free ends.

    Each touches one before it: in other orders Open CASCADE's union loses most of some networks.
    """
    runs, _ = split_runs(network, Facets(_MITRED_MM))
    runs = [simpler(run) for run in runs]
    at: dict[bytes, list[tuple[int, int]]] = defaultdict(list)
    for index, run in enumerate(runs):
        for end in (0, -1):
            at[_key(run.points[end])].append((index, end))
    widest = {key: max(float(runs[i].radius[e]) for i, e in ends) for key, ends in at.items()}
    pieces: list[Piece] = []
    filled: set[bytes] = set()
    for index, first in _walk(runs, at):
        run = runs[index] if first == 0 else runs[index].reversed()
        for k, (point, radius) in enumerate(zip(run.points, run.radius.tolist(), strict=True)):
            inner = 0 < k < len(run.points) - 1
            key = _key(point)
            if k:
                before = float(run.radius[k - 1])
                pieces.append(Piece(run.points[k - 1], point, before, radius))
            if inner or key not in filled:
                ball = CLEAR_OF_TUBES * (radius if inner else widest[key])
                pieces.append(Piece(point, point, ball, ball))
                filled.add(key)
    return pieces


def _key(point: FloatArray) -> bytes:
    return (point + 0.0).tobytes()


def _walk(runs: list[Chain], at: dict[bytes, list[tuple[int, int]]]) -> list[tuple[int, int]]:
    """Every run and the end from which it is met, each at a run before it where there is one."""
    order: list[tuple[int, int]] = []
    seen: set[int] = set()
    for start in range(len(runs)):
        stack = [(start, 0)]
        while stack:
            index, end = stack.pop()
            if index in seen:
                continue
            seen.add(index)
            order.append((index, end))
            stack += reversed(
                at[_key(runs[index].points[-1 - end])] + at[_key(runs[index].points[end])]
            )
    return order


def simpler(run: Chain) -> Chain:
    """A polyline's points that are needed to stay near it, in place and in radius.

    Ramer, Douglas and Peucker: the farthest point is kept while it is too far.
    """
    kept = np.zeros(len(run.points), dtype=bool)
    kept[[0, -1]] = True
    stack = [(0, len(run.points) - 1)]
    while stack:
        first, last = stack.pop()
        inner = np.arange(first + 1, last)
        if len(inner) == 0:
            continue
        off = _off(run, first, last, inner)
        worst = int(np.argmax(off))
        if off[worst] > _OFF_AXIS:
            kept[inner[worst]] = True
            stack += [(first, int(inner[worst])), (int(inner[worst]), last)]
    return Chain(run.points[kept], run.radius[kept], run.node[kept])


def _off(run: Chain, first: int, last: int, inner: IntArray) -> FloatArray:
    """How far inner points are from the cone between two others, over their radii."""
    step = run.points[last] - run.points[first]
    square = float(step @ step)
    away = run.points[inner] - run.points[first]
    share = np.clip(away @ step / square, 0.0, 1.0) if square > 0.0 else np.zeros(len(inner))
    gap = np.linalg.norm(away - share[:, None] * step, axis=1)
    radius = run.radius[first] + share * (run.radius[last] - run.radius[first])
    off: FloatArray = np.maximum(gap, np.abs(run.radius[inner] - radius)) / run.radius[inner]
    return off
