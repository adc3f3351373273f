"""Plan branches that dive from a heart's epicardial trunks into wall and septum."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.spatial import cKDTree

from design.anatomy.trunk_lines import TrunkLines, with_shares
from design.tissue import Tissue
from design.vasculature.options import GrowthOptions
from kernels.arrays import BoolArray, FloatArray, IntArray

NARROW: Final = 0.2
"""Radius over the root's below which a perforator stays: what is wider is a trunk, and belongs below
the epicardium."""

import os

def LOG(*a):
    if os.environ.get("HV_LOG"):
        with open(os.environ["HV_LOG"], "a") as f:
            print(*a, file=f)

_FILLED: Final = float(os.environ.get("HV_FILL","0.5"))
"""Of what so wide a perforator could feed: part that it is planned for."""

_TRIED: Final = 80
_PIECES: Final = 4
_ROOM: Final = 1.3


@dataclass(frozen=True)
class _Lines:
    """Lines as they grow, with places along all pieces."""

    points: list[FloatArray]
    parent: list[int]


def with_perforators(
    tissue: Tissue,
    lines: TrunkLines,
    radius: FloatArray,
    volume: FloatArray,
    options: GrowthOptions,
) -> tuple[TrunkLines, FloatArray]:
    """The lines with branches to places far from all of them, each narrow; and all radii.

    Each goes straight from a place of a trunk to one of tissue that is farthest from all lines,
    until all is as near as the edge of a cube that such a branch may feed.
    """
    root = float(radius.max())
    limit = _FILLED * NARROW**options.murray_exponent
    trees = np.unique(lines.tree)
    part = {t: lines.share[(lines.tree == t) & (lines.parent < 0)].sum() for t in trees.tolist()}
    apart = (limit * min(part.values()) * tissue.volume_mm3) ** (1.0 / 3.0)
    narrow = root * (limit * min(part.values())) ** (1.0 / options.murray_exponent)
    away, near = cKDTree(lines.points).query(volume)
    clear = options.clearance_mm
    deep = -tissue.grid.distance(volume)
    site_ok = deep > narrow + clear
    starts = _Starts(tissue, lines, radius, narrow, options)
    failed = 0
    while True:
        site = int(np.argmax(np.where(site_ok, away, 0.0)))
        if away[site] < apart or not site_ok[site]:
            break
        path = starts.path_to(volume[site])
        if path is None:
            failed += 1
            site_ok[np.linalg.norm(volume - volume[site], axis=1) < 0.5 * apart] = False
            continue
        away = np.minimum(away, np.linalg.norm(volume - path[-1], axis=1))
        for n in range(1, len(path)):
            away = np.minimum(away, _from_piece(volume, path[n - 1], path[n]))
    whole = starts.whole()
    LOG("perforators", starts.count, "failed", failed, "apart", apart, "narrow", narrow)
    whole = with_shares(whole, volume)
    count = len(lines.parent)
    own = root * whole.share[count:] ** (1.0 / options.murray_exponent)
    LOG("perforator radii/root by tree", np.round(np.sort(own[::_PIECES] / root)[::-1][:12], 3))
    return whole, np.concatenate([radius, own])


def _from_piece(points: FloatArray, a: FloatArray, b: FloatArray) -> FloatArray:
    along = b - a
    t = np.clip((points - a) @ along / max(float(along @ along), 1e-30), 0.0, 1.0)
    found: FloatArray = np.linalg.norm(points - a - t[:, None] * along, axis=1)
    return found


class _Starts:
    def __init__(self, tissue, lines, radius, narrow, options):
        self.tissue, self.lines, self.radius = tissue, lines, radius
        self.narrow, self.options = narrow, options
        child = lines.child_count()
        self.free = (lines.parent >= 0) & (child == 1) & (lines.parent[np.maximum(lines.parent, 0)] >= 0)
        self.free &= radius >= 1.2 * narrow
        self.points = lines.points.copy()
        ends = np.flatnonzero(lines.parent >= 0)
        self.a, self.b = lines.points[lines.parent[ends]], lines.points[ends]
        self.r = radius[ends]
        self.more_points, self.more_parent, self.more_tree = [], [], []
        self.count = 0

    def path_to(self, site):
        away = np.linalg.norm(self.points - site, axis=1)
        cost = np.where(self.free, away, np.inf)
        for start in np.argsort(cost)[:_TRIED].tolist():
            if not np.isfinite(cost[start]):
                break
            path = self.points[start] + np.linspace(0.0, 1.0, _PIECES + 1)[:, None] * (site - self.points[start])
            if self._fits(start, path):
                self._take(start, path)
                return path
        return None

    def _fits(self, start, path):
        o = self.options
        r = self.narrow
        skip = 3.0 * (self.radius[start] + r)
        length = np.linalg.norm(path[-1] - path[0])
        n = max(2, int(np.ceil(length / (0.5 * r))))
        at = np.linspace(0.0, 1.0, n)
        pts = path[0] + at[:, None] * (path[-1] - path[0])
        pts = pts[at * length > self.radius[start]]
        if not len(pts) or (-self.tissue.grid.distance(pts) < r + _ROOM * o.clearance_mm).any():
            return False
        pts = pts[at[-len(pts):] * length > skip]
        if not len(pts):
            return False
        for p in pts:
            along = self.b - self.a
            t = np.clip(((p - self.a) * along).sum(1) / np.maximum((along * along).sum(1), 1e-30), 0, 1)
            d = np.linalg.norm(p - self.a - t[:, None] * along, axis=1)
            if (d < _ROOM * (r + self.r + o.clearance_mm)).any():
                return False
        return True

    def _take(self, start, path):
        base = len(self.points) if False else None
        first = len(self.lines.points) + len(self.more_points)
        for n in range(1, len(path)):
            self.more_parent.append(start if n == 1 else first + n - 2)
            self.more_points.append(path[n])
            self.more_tree.append(int(self.lines.tree[start]))
        # No other begins just beside it.
        close = np.linalg.norm(self.points - self.points[start], axis=1) < 3.0 * self.narrow
        self.free[close] = False
        self.a = np.concatenate([self.a, path[:-1]])
        self.b = np.concatenate([self.b, path[1:]])
        self.r = np.concatenate([self.r, np.full(len(path) - 1, self.narrow)])
        self.count += 1

    def whole(self):
        l = self.lines
        return TrunkLines(
            np.concatenate([l.points, np.array(self.more_points).reshape(-1, 3)]),
            np.concatenate([l.parent, np.array(self.more_parent, dtype=np.int64)]),
            np.concatenate([l.tree, np.array(self.more_tree, dtype=np.int64)]),
            np.zeros(len(l.parent) + len(self.more_parent)),
        )
