"""Independent reader of `network.csv`."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

COLUMNS = {
    "vessel": "i8",
    "node0": "i8",
    "node1": "i8",
    "x0": "f8",
    "y0": "f8",
    "z0": "f8",
    "x1": "f8",
    "y1": "f8",
    "z1": "f8",
    "radius0_mm": "f8",
    "radius1_mm": "f8",
    "kind": "U12",
    "tree": "i8",
}


@dataclass(frozen=True)
class Pieces:
    """Straight pieces of vessels, nodes numbered from 0 without gaps.

    Attributes
    ----------
    vessel, tree : (n,) int64
    kind : (n,) str
    node : (n, 2) int64
        At the start and end of each piece; designed flow runs from the first to the second.
    start, end : (n, 3) float64, mm
    radius : (n, 2) float64, mm
        At start and end.
    """

    vessel: IntArray
    tree: IntArray
    kind: NDArray[np.str_]
    node: IntArray
    start: FloatArray
    end: FloatArray
    radius: FloatArray

    @property
    def count(self) -> int:
        """Number of pieces."""
        return len(self.node)

    @property
    def node_count(self) -> int:
        """Number of nodes."""
        return int(self.node.max()) + 1

    @property
    def length(self) -> FloatArray:
        """(n,), mm."""
        length: FloatArray = np.linalg.norm(self.end - self.start, axis=1)
        return length

    @property
    def widest(self) -> FloatArray:
        """Larger radius of each piece, (n,), mm."""
        widest: FloatArray = self.radius.max(axis=1)
        return widest

    def inlets(self) -> IntArray:
        """Nodes that pieces leave and none enters."""
        return np.setdiff1d(self.node[:, 0], self.node[:, 1])

    def outlets(self) -> IntArray:
        """Nodes that pieces enter and none leaves."""
        return np.setdiff1d(self.node[:, 1], self.node[:, 0])


def read_network(path: Path) -> Pieces:
    """Read the pieces of a file in mm.

    Raises
    ------
    ValueError
        When a column is missing, a number can't be read, or pieces that share a node number don't
        meet within a nanometre.
    """
    with path.open(encoding="utf-8") as lines:
        names = [name.strip() for name in lines.readline().split(",")]
        missing = set(COLUMNS) - set(names)
        if missing:
            raise ValueError(f"{path}: no column {', '.join(sorted(missing))}")
        row = np.dtype([(name, COLUMNS.get(name, "U64")) for name in names])
        table = np.loadtxt(lines, delimiter=",", dtype=row, ndmin=1)
    return pieces_of(
        start=np.column_stack([table["x0"], table["y0"], table["z0"]]),
        end=np.column_stack([table["x1"], table["y1"], table["z1"]]),
        radius=np.column_stack([table["radius0_mm"], table["radius1_mm"]]),
        node=np.column_stack([table["node0"], table["node1"]]),
        vessel=table["vessel"].copy(),
        tree=table["tree"].copy(),
        kind=table["kind"].copy(),
    )


def pieces_of(
    start: FloatArray,
    end: FloatArray,
    radius: FloatArray,
    node: IntArray,
    vessel: IntArray | None = None,
    tree: IntArray | None = None,
    kind: NDArray[np.str_] | None = None,
) -> Pieces:
    """Pieces from arrays; refuses what isn't a network (see `read_network`).

    ``radius`` may be (n,) where pieces don't taper.
    """
    start, end = np.asarray(start, dtype=np.float64), np.asarray(end, dtype=np.float64)
    radius = np.asarray(radius, dtype=np.float64)
    if radius.ndim == 1:
        radius = np.column_stack([radius, radius])
    _, number = np.unique(np.asarray(node), return_inverse=True)
    number = number.reshape(-1, 2).astype(np.int64)
    _check(start, end, radius, number)
    n = len(start)
    return Pieces(
        vessel=np.arange(n) if vessel is None else vessel,
        tree=np.zeros(n, dtype=np.int64) if tree is None else tree,
        kind=np.full(n, "artery") if kind is None else kind,
        node=number,
        start=start,
        end=end,
        radius=radius,
    )


def _check(start: FloatArray, end: FloatArray, radius: FloatArray, node: IntArray) -> None:
    if not (np.isfinite(start).all() and np.isfinite(end).all()):
        raise ValueError("a coordinate is NaN or infinite")
    if not (np.isfinite(radius).all() and (radius > 0).all()):
        raise ValueError("a radius is NaN, infinite or not above 0")
    place = np.empty((int(node.max()) + 1, 3))
    place[node[:, 0]] = start
    place[node[:, 1]] = end
    apart = max(np.abs(place[node[:, 0]] - start).max(), np.abs(place[node[:, 1]] - end).max())
    if apart > 1e-6:
        raise ValueError(f"pieces that share a node lie {apart:g} mm apart")
