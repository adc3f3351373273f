"""Write a vessel network to a `network.csv` file, in mm."""

from __future__ import annotations

import csv
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from design.errors import NetworkError
from design.files import atomic_replacement
from design.network import VesselKind, VesselNetwork
from design.network_files.csv_format.pieces import COLUMNS, GAP_MM
from kernels.arrays import FloatArray, IntArray

_BATCH_ROWS = 20_000

_KINDS = np.array([kind.name.lower() for kind in VesselKind])


def write_network_csv(path: Path, network: VesselNetwork) -> None:
    """Write ``network`` in mm; every number reads back to the same bits.

    Inner points of the polylines get node numbers after the network's own. A node without a
    vessel has no row.

    Raises
    ------
    NetworkError
        When a polyline doesn't start and end on its vessel's nodes.
    OSError
        When the file can't be written.
    """
    number = _point_numbers(network)
    points = _points_on_nodes(network)
    vessel_of_point = np.repeat(np.arange(network.vessel_count), np.diff(network.offset))
    first = np.flatnonzero(vessel_of_point[:-1] == vessel_of_point[1:])
    with atomic_replacement(path) as draft, draft.open("w", encoding="utf-8", newline="") as out:
        # The csv module writes floats by repr, the shortest text that gives the same bits.
        table = csv.writer(out, lineterminator="\n")
        table.writerow(COLUMNS)
        for batch in np.split(first, range(_BATCH_ROWS, len(first), _BATCH_ROWS)):
            table.writerows(_rows(network, vessel_of_point[batch], batch, number, points))


def _rows(
    network: VesselNetwork, vessel: IntArray, first: IntArray, number: IntArray, points: FloatArray
) -> Iterator[tuple[object, ...]]:
    """Return rows of the pieces that begin at the points ``first``."""
    return zip(
        vessel.tolist(),
        number[first].tolist(),
        number[first + 1].tolist(),
        *points[first].T.tolist(),
        *points[first + 1].T.tolist(),
        network.radius[first].tolist(),
        network.radius[first + 1].tolist(),
        _KINDS[network.kind[vessel]].tolist(),
        network.tree[vessel].tolist(),
        strict=True,
    )


def _ends(network: VesselNetwork) -> IntArray:
    """First and last point of each vessel, (v, 2)."""
    return np.stack([network.offset[:-1], network.offset[1:] - 1], axis=1)


def _point_numbers(network: VesselNetwork) -> IntArray:
    """Node number in the file of each point, (p,)."""
    ends = _ends(network)
    short = ends[:, 1] <= ends[:, 0]
    if short.any():
        raise NetworkError(
            f"vessel {int(np.argmax(short))} has fewer than two points; give it both ends"
        )
    number = np.full(len(network.points), -1, dtype=np.int64)
    number[ends] = network.vessel_nodes
    inner = np.flatnonzero(number < 0)
    number[inner] = len(network.nodes) + np.arange(len(inner))
    return number


def _points_on_nodes(network: VesselNetwork) -> FloatArray:
    """Points with the ends exactly on the nodes, so that the file agrees with itself."""
    ends = _ends(network)
    at_nodes = network.nodes[network.vessel_nodes]
    gap = np.linalg.norm(network.points[ends] - at_nodes, axis=2).max(axis=1)
    if gap.max() > GAP_MM:
        raise NetworkError(
            f"vessel {int(np.argmax(gap))}: an end of its polyline lies {gap.max():g} mm from its "
            f"node (at most {GAP_MM:g} mm); put the node's own coordinates there"
        )
    points = network.points.copy()
    points[ends] = at_nodes
    return points
