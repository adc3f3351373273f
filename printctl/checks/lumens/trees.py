"""Group a network's designed lumens into vessel trees with their mouths, for the leak search."""

from __future__ import annotations

from typing import Final

import numpy as np

from design.network import VesselNetwork
from kernels.arrays import FloatArray, IntArray
from printctl.checks.lumens.leaks import PIXEL_MM, DesignedLumens, Grid, Pixels
from printctl.checks.lumens.lines import WrittenLines
from sim.gcode.lumens.leak_kernels import label_pieces

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
