"""Find gaps between printed lines that open a lumen, by trees of lumens."""

from __future__ import annotations

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from design.network import VesselNetwork
from kernels.arrays import FloatArray, IntArray
from printctl.checks.lumens.layer_spaces import (
    TISSUE,
    Pixels,
    block_lines,
    find_runs,
    join_runs,
    label_pieces,
)
from printctl.checks.lumens.lines import WrittenLines

PIXEL_MM: Final = 0.03
MOST_PIXELS: Final = 3e9
OUTSIDE: Final = -1
OUTSIDE_NAME: Final = "outside"
Label = Callable[[int, "Grid", Pixels], None]


@dataclass(frozen=True)
class Leak:
    """A way for ink-free space out of a tree's lumens.

    Attributes
    ----------
    tree : str
    into : str
        ``outside``, or another tree.
    at_mm : (3,) float64, mm
        Where the way leaves the lumen, printer's frame.
    layer : int
    wall_mm : float, optional
        Of the design there: least thickness between the lumen and what it opens into.
    """

    tree: str
    into: str
    at_mm: FloatArray
    layer: int
    wall_mm: float | None = None

    @property
    def text(self) -> str:
        """What opens into what, where, and how thick the design's wall is there."""
        into = self.into if self.into == OUTSIDE_NAME else f"tree {self.into}"
        text = "tree {} into {} at x {:.2f}, y {:.2f}, z {:.2f} mm (layer {})".format(
            self.tree, into, *self.at_mm, self.layer + 1
        )
        if self.wall_mm is None:
            return text
        wall = f"wall {self.wall_mm:.2f} mm" if self.wall_mm > 0 else "no wall in the design"
        return f"{text}, {wall}"

    def as_dict(self) -> dict[str, Any]:
        """For JSON."""
        return {
            "tree": self.tree,
            "into": self.into,
            "at_mm": [float(value) for value in self.at_mm],
            "layer": self.layer,
            **({} if self.wall_mm is None else {"wall_mm": self.wall_mm}),
        }


@dataclass(frozen=True)
class DesignedLumens:
    """Designed lumens, as the search for leaks wants them, in the printer's frame.

    Attributes
    ----------
    label : callable
        Puts 1 + a number into a layer's open pixels that are in a lumen.
    group : (n,) int64
        Tree of each number, from 0.
    names : tuple of str
        Of the trees.
    mouth, reach : (m, 3), (m,) float64, mm
        Where lumens may open: ports, ends, and where trees meet, and how far about. ``label`` gives
        that ball to the lumen.
    """

    label: Label
    group: IntArray
    names: tuple[str, ...]
    mouth: FloatArray
    reach: FloatArray


@dataclass(frozen=True)
class Grid:
    """Pixels of a layer: middle of the first, edge, and count, mm."""

    left: float
    bottom: float
    pixel: float
    nx: int
    ny: int


def find_leaks(lines: WrittenLines, lumens: DesignedLumens, width_mm: float) -> tuple[Leak, ...]:
    """Ways out of the lumens that a ball of ``width_mm`` could take.

    The ball goes sideways within a layer, and up and down where it finds room above or below.
    Ways narrower than it are no leaks; ways wider by a pixel (30 µm) are all found.

    Parameters
    ----------
    lines : WrittenLines
    lumens : Lumens
    width_mm : float, mm

    Returns
    -------
    tuple of Leak
        One for each tree and space that it opens into.
    """
    grid = _grid(lines, width_mm)
    runs = _all_runs(lines, lumens, width_mm, grid)
    first = np.concatenate([[0], np.cumsum([len(layer_runs) for layer_runs in runs])]).astype(
        np.int64
    )
    run = np.concatenate(runs)
    space, touch = _spaces(run, first)
    return _leaks(run, first, space, touch, lumens, grid, lines)


def _grid(lines: WrittenLines, width: float) -> Grid:
    (x0, y0, _), (x1, y1, _) = lines.bounds
    layers = len(lines.low)
    pixel = max(PIXEL_MM, ((x1 - x0) * (y1 - y0) * layers / MOST_PIXELS) ** 0.5)
    edge = width + 2 * pixel
    count = (np.ceil((np.array([x1 - x0, y1 - y0]) + 2 * edge) / pixel) + 1).astype(int)
    return Grid(x0 - edge, y0 - edge, pixel, int(count[0]), int(count[1]))


def _all_runs(
    lines: WrittenLines, lumens: DesignedLumens, width: float, grid: Grid
) -> list[Pixels]:
    """Runs of each layer, and of an empty one below and above."""
    order = np.argsort(lines.layer, kind="stable")
    line = np.column_stack([lines.start, lines.end, lines.width / 2])[order]
    at = np.searchsorted(lines.layer[order], np.arange(len(lines.low) + 1))

    def one(k: int) -> Pixels:
        pixels = np.zeros((grid.ny, grid.nx), dtype=np.int32)
        if 0 <= k < len(lines.low):
            corner = (grid.left, grid.bottom, grid.pixel)
            block_lines(line[at[k] : at[k + 1]], width / 2, *corner, pixels)
            lumens.label(k, grid, pixels)
        layer_runs: Pixels = find_runs(pixels, lumens.group)
        return layer_runs

    with ThreadPoolExecutor(max_workers=os.cpu_count() or 1) as pool:
        return list(pool.map(one, range(-1, len(lines.low) + 1)))


def _spaces(run: Pixels, first: IntArray) -> tuple[IntArray, IntArray]:
    """Space of each run (a run's index), and pairs of runs of different groups that touch."""
    room = 1 << 16
    while True:
        parent = np.arange(len(run), dtype=np.int64)
        touch = np.zeros((room, 2), dtype=np.int64)
        used = join_runs(run, first, parent, touch)
        if used <= room:
            return parent, touch[:used]
        room = used


def _leaks(
    run: Pixels,
    first: IntArray,
    space: IntArray,
    touch: IntArray,
    lumens: DesignedLumens,
    grid: Grid,
    lines: WrittenLines,
) -> tuple[Leak, ...]:
    """Judge touching runs: a lumen's first, then tissue or another lumen."""
    swap = run[touch[:, 0], 3] == TISSUE
    touch = np.where(swap[:, None], touch[:, ::-1], touch)
    inner, outer = run[touch[:, 0]], run[touch[:, 1]]
    layer = np.searchsorted(first, touch[:, 0], side="right") - 2
    low = np.maximum(inner[:, 1], outer[:, 1])
    column = np.where(
        low <= np.minimum(inner[:, 2], outer[:, 2]),
        (low + np.minimum(inner[:, 2], outer[:, 2])) / 2,
        low,
    )
    middle = (lines.low + lines.high) / 2
    at = np.column_stack(
        [
            grid.left + column * grid.pixel,
            grid.bottom + inner[:, 0] * grid.pixel,
            middle[np.clip(layer, 0, len(middle) - 1)],
        ]
    )
    edge = 3 * grid.pixel + 1.5 * float((lines.high - lines.low).max())
    counted = ~_at_mouth(at, lumens, edge)
    tree = inner[:, 3].astype(np.int64)
    ways = _direct(np.flatnonzero(counted & (outer[:, 3] != TISSUE)), tree, outer[:, 3])
    loose = np.flatnonzero(counted & (outer[:, 3] == TISSUE))
    # The layer below all others is one space: the outside.
    ways = _by_spaces(loose, tree, space[touch[:, 1]], int(space[0]), at) | ways
    return tuple(
        Leak(
            lumens.names[one],
            OUTSIDE_NAME if into == OUTSIDE else lumens.names[into],
            at[k],
            int(np.clip(layer[k], 0, len(middle) - 1)),
        )
        for (one, into), k in sorted(ways.items())
    )


Ways = dict[tuple[int, int], int]
"""Touch at which a way from a tree into another, or `OUTSIDE`, leaves the first."""


def _direct(touches: IntArray, tree: IntArray, other: NDArray[np.int32]) -> Ways:
    """Trees whose open spaces touch without tissue between."""
    ways: Ways = {}
    for k in touches:
        ways.setdefault((int(tree[k]), int(other[k])), int(k))
        ways.setdefault((int(other[k]), int(tree[k])), int(k))
    return ways


def _by_spaces(
    touches: IntArray, tree: IntArray, space: IntArray, outside: int, at: FloatArray
) -> Ways:
    """Trees that share a space in the tissue, or open into the outside."""
    ways: Ways = {}
    for where in np.unique(space[touches]):
        here = touches[space[touches] == where]
        trees = np.unique(tree[here])
        groups = [here[tree[here] == one] for one in trees]
        for one, group in zip(trees, groups, strict=True):
            if where == outside:
                ways.setdefault((int(one), OUTSIDE), int(group[0]))
            for other, facing in zip(trees, groups, strict=True):
                if other != one:
                    # Where the two are nearest: the space may reach along both of them.
                    away, _ = cKDTree(at[facing]).query(at[group])
                    ways.setdefault((int(one), int(other)), int(group[away.argmin()]))
    return ways


def _at_mouth(at: FloatArray, lumens: DesignedLumens, edge: float) -> NDArray[np.bool_]:
    """Whether each place is where a lumen may open."""
    if len(lumens.mouth) == 0 or len(at) == 0:
        return np.zeros(len(at), dtype=np.bool_)
    tree = cKDTree(lumens.mouth)
    at_mouth = np.zeros(len(at), dtype=np.bool_)
    reach = lumens.reach + edge
    widest = float(reach.max())
    for k, near in enumerate(tree.query_ball_point(at, widest)):
        away = np.linalg.norm(lumens.mouth[near] - at[k], axis=1)
        at_mouth[k] = bool((away <= reach[near]).any())
    return at_mouth


MOUTH: Final = 1.3
"""A port's opening is wider by this than designed, and nothing within it counts as a leak."""


def margin_mm(lines: WrittenLines) -> float:
    """Margin around a designed lumen that counts as inside it: half a layer's step, and a pixel."""
    return float((lines.high - lines.low).max()) / 2 + PIXEL_MM


def network_trees(
    network: VesselNetwork, lines: WrittenLines, place_mm: FloatArray
) -> DesignedLumens:
    """Trees of a network. They may open at nodes where one vessel ends, or where trees meet."""
    start, end, r0, r1, vessel = network.pieces()
    margin = margin_mm(lines)
    numbers, inverse = np.unique(network.tree, return_inverse=True)
    group = inverse.reshape(-1).astype(np.int64)
    mouth, tree, widest = _mouths(network, group)
    at, reach = network.nodes[mouth] + place_mm, MOUTH * widest
    piece = np.vstack(
        [np.column_stack([start + place_mm, end + place_mm, r0, r1]), mouth_pieces(at, reach)]
    )
    middle = (lines.low + lines.high) / 2
    far = piece[:, 6:].max(axis=1) + margin
    low = np.minimum(piece[:, 2], piece[:, 5]) - far
    high = np.maximum(piece[:, 2], piece[:, 5]) + far

    def label(layer: int, grid: Grid, pixels: Pixels) -> None:
        z = float(middle[layer])
        chosen = np.flatnonzero((low <= z) & (z <= high)).astype(np.int64)
        label_pieces(piece, chosen, z, margin, grid.left, grid.bottom, grid.pixel, pixels)

    names = tuple(str(number) for number in numbers)
    return DesignedLumens(label, np.concatenate([group[vessel], tree]), names, at, reach)


def mouth_pieces(at: FloatArray, reach: FloatArray) -> FloatArray:
    """Balls as pieces (m, 8) without length.

    What is open beside a lumen wider than designed would lead out at its mouth; a ball of its own
    tree stops it there.
    """
    return np.column_stack([at, at, reach, reach])


def _mouths(network: VesselNetwork, group: IntArray) -> tuple[IntArray, IntArray, FloatArray]:
    """Nodes at which one vessel ends, or vessels of several trees meet; a tree, and the opening.

    A vessel that leaves at a slant cuts an ellipse into the face, as long as its radius over the
    sine; the face is taken to be that of the part's axes which it meets most squarely.
    """
    count = len(network.nodes)
    lowest = np.full(count, np.iinfo(np.int64).max)
    highest, widest = np.full(count, -1), np.zeros(count)
    first, last = network.offset[:-1], network.offset[1:] - 1
    ends = []
    for end, inner in ((first, first + 1), (last, last - 1)):
        way = network.points[inner] - network.points[end]
        squarely = np.abs(way).max(axis=1) / np.maximum(np.linalg.norm(way, axis=1), 1e-12)
        ends.append(network.radius[end] / np.maximum(squarely, 0.5))
    for side in (0, 1):
        node = network.vessel_nodes[:, side]
        np.minimum.at(lowest, node, group)
        np.maximum.at(highest, node, group)
        np.maximum.at(widest, node, ends[side])
    nodes = np.flatnonzero((network.degree() == 1) | ((highest > lowest) & (highest >= 0)))
    return nodes, lowest[nodes], widest[nodes]
