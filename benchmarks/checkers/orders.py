"""Count elements by diameter-defined order, and read the published figures to hold them against."""

from __future__ import annotations

import json
from typing import Any

import numpy as np

from benchmarks.checkers.networks import FloatArray, IntArray, Pieces
from benchmarks.common import ROOT

Measures = dict[str, float]


def elements_by_diameter(net: Pieces, bounds_mm: FloatArray) -> dict[int, Measures]:
    """Elements of each diameter-defined order: their number, mean diameter and length, mm.

    An element is a series of vessels of one order, as Kassab et al. 1993 count; where both
    branches have their parent's order the wider one goes on with it.
    """
    count = int(net.vessel.max()) + 1
    long: FloatArray = np.asarray(np.bincount(net.vessel, net.length, count), np.float64)
    wide = np.bincount(net.vessel, net.length * net.radius.sum(axis=1), count) / long
    order = 1 + np.searchsorted(bounds_mm, wide, side="right")
    first, last = (
        _ends(net, net.node[:, 0], net.node[:, 1]),
        _ends(net, net.node[:, 1], net.node[:, 0]),
    )
    return _by_order(order, wide, long, _elements(order, wide, first, last))


def _ends(net: Pieces, at: IntArray, other: IntArray) -> dict[int, int]:
    """The node of each vessel that is at that side of a piece and at the other of none."""
    base = net.node_count
    keys = np.setdiff1d(net.vessel * base + at, net.vessel * base + other)
    return {int(key) // base: int(key) % base for key in keys}


def _elements(
    order: IntArray, wide: FloatArray, first: dict[int, int], last: dict[int, int]
) -> IntArray:
    """Number of the element that each vessel belongs to: that of its first vessel."""
    ending = {node: vessel for vessel, node in last.items()}
    goes_on: dict[int, int] = {}
    for vessel in np.argsort(wide, kind="stable").tolist():
        parent = ending.get(first[vessel])
        if parent is not None and order[parent] == order[vessel]:
            goes_on[parent] = vessel
    before = {child: parent for parent, child in goes_on.items()}
    element = np.arange(len(order))
    for vessel in range(len(order)):
        begin = vessel
        while begin in before:
            begin = before[begin]
        element[vessel] = begin
    return element


def _by_order(
    order: IntArray, wide: FloatArray, long: FloatArray, element: IntArray
) -> dict[int, Measures]:
    _, number = np.unique(element, return_inverse=True)
    length = np.bincount(number, long)
    across = np.bincount(number, long * wide) / length
    of = np.zeros(len(length), dtype=np.int64)
    of[number] = order
    return {
        int(one): {
            "elements": int((of == one).sum()),
            "diameter_mm": float(across[of == one].mean()),
            "length_mm": float(length[of == one].mean()),
        }
        for one in np.unique(of)
    }


def _arteries() -> list[list[dict[str, Any]]]:
    path = ROOT / "design" / "measures" / "published" / "coronary.json"
    return list(json.loads(path.read_text())["arteries"].values())


def published_table() -> FloatArray:
    """Mean and deviation of diameter, length (mm), slenderness by order, (n, 6); NaN: unknown."""
    found = []
    for lines in zip(*_arteries(), strict=False):
        pairs: list[list[tuple[float, float]]] = [[], [], []]
        for line in lines:
            wide, wide_sd, long, long_sd = (
                np.nan if line.get(key) is None else float(line[key])
                for key in ("diameter_um", "diameter_sd_um", "length_mm", "length_sd_mm")
            )
            pairs[0].append((wide / 1e3, wide_sd / 1e3))
            pairs[1].append((long, long_sd))
            pairs[2].append((1e3 * long / wide, 1e3 * long_sd / wide))
        found.append([value for pair in pairs for value in _mixture(np.array(pair))])
    return np.array(found)


def _mixture(pairs: FloatArray) -> tuple[float, float]:
    """Mean and deviation of equal parts of each artery that has both."""
    both = pairs[np.isfinite(pairs).all(axis=1)]
    if not len(both):
        return float(np.nanmean(pairs[:, 0])) if np.isfinite(pairs[:, 0]).any() else np.nan, np.nan
    return float(both[:, 0].mean()), float(np.sqrt((both[:, 1] ** 2).mean() + both[:, 0].var()))
