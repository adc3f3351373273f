"""Lay out a FRESH layer's moves head by head, with travels and head changes between.

In a layer the head in use writes first, then the others: a layer costs as many changes as it has
other heads. What is done at a change is the G-code writer's (up, raise, choose, lower, across,
down); the toolpath says where the old head relieves and the new one primes, and both do it beside
a lumen's wall in their own material, as for any other way (`layout`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from manifold3d import CrossSection
from numpy.typing import NDArray

from design.toolpath.fresh.contours import Cells, contours_of
from design.toolpath.fresh.infill import zigzag
from design.toolpath.fresh.layout import Rows, lay_out, obstacles
from design.toolpath.fresh.options import FreshOptions
from design.toolpath.fresh.order import order_paths
from design.toolpath.fresh.paths import Paths
from design.toolpath.toolpath import MoveKind
from kernels.arrays import FloatArray, IntArray

#: From layer to layer, rad: the golden angle, which spreads any number of seams evenly.
SEAM_TURN = np.pi * (3 - np.sqrt(5))


@dataclass(frozen=True)
class Section:
    """What one head writes in a layer.

    Attributes
    ----------
    head : int
    paths : Paths
    bounds : CrossSection
        Of its material: a way that leaves it is lifted, and is never a link.
    """

    head: int
    paths: Paths
    bounds: CrossSection


@dataclass(frozen=True)
class LayerMoves:
    """Moves of one FRESH layer.

    Attributes
    ----------
    start : (3,) float64, mm
        Where the first of them begins.
    rows : Rows
    tool : (n,) int64
        The head that makes each.
    changes : int
        Changes of head, one before the layer included.
    """

    start: FloatArray
    rows: Rows
    tool: IntArray
    changes: int


class Carriage:
    """Writes sections one after the other, from where the last one ended.

    Parameters
    ----------
    heads : sequence of FreshOptions
        Each head's own.
    corner : (2,) float64, mm
        Near which the first line is looked for.
    """

    def __init__(self, heads: Sequence[FreshOptions], corner: FloatArray) -> None:
        self._heads = list(heads)
        self._corner = corner
        self._tip: FloatArray | None = None
        self._below: Cells | None = None
        self._active = 0
        self._used: set[int] = set()
        self._layers = 0

    def write(self, sections: Sequence[Section], tip_mm: float, height_mm: float) -> LayerMoves:
        """Lay sections of a layer with the tip at ``tip_mm``, the one of the head in use first."""
        self._heads = [one.in_layer(height_mm) for one in self._heads]
        start, changes = self._tip, 0
        self._layers += 1
        laid: list[Rows] = []
        tools: list[IntArray] = []
        for section in sorted(sections, key=lambda one: (one.head != self._active, one.head)):
            first, before = self._tip is None, self._active
            rows, tool, begin = self._section(section, tip_mm)
            changes += not first and before != self._active
            start = begin if start is None else start
            laid.append(rows)
            tools.append(tool)
        if start is None:
            start = np.append(self._corner, tip_mm)
        whole = np.concatenate([np.zeros(0, dtype=np.int64), *tools])
        return LayerMoves(start, _joined(laid), whole, changes)

    def _section(self, section: Section, z: float) -> tuple[Rows, IntArray, FloatArray]:
        """Rows of one section, the head of each, and where they begin."""
        options, paths = self._heads[section.head], section.paths
        here = obstacles(contours_of(section.bounds), options.line_width_mm)
        at = self._corner if self._tip is None else self._tip[:2]
        sequence = order_paths(paths, at, options.link_mm, SEAM_TURN * self._layers)
        paths, sequence = zigzag(paths, sequence, here, options.joint_mm, options.least_move_mm)
        if len(paths) and self._tip is None:
            self._tip = np.append(paths.points[sequence.first[0]], z)
            self._active = section.head
        start = np.append(at, z) if self._tip is None else self._tip
        changes = len(paths) > 0 and section.head != self._active
        came = start
        if changes and start[2] == z:
            # From any lower place no way is a link: heads don't change on a level way.
            came = np.array([*start[:2], np.nextafter(z, -np.inf)])
        rows = lay_out(paths, sequence, came, z, (here, self._below or here), options)
        tool = np.full(len(rows.kind), section.head)
        if changes:
            rows, tool = self._handed_over(rows, section.head, start)
        if len(rows.end):
            self._tip, self._active = rows.end[-1], section.head
            self._used.add(section.head)
        self._below = here
        return rows, tool, start

    def _handed_over(self, rows: Rows, new: int, at: FloatArray) -> tuple[Rows, IntArray]:
        """``rows`` of a new head, relieved of the old one first.

        A head that hasn't written yet has nothing to prime: nothing was relieved in it.
        """
        writes = np.flatnonzero(rows.kind == MoveKind.WRITE)
        before = np.arange(len(rows.kind)) < writes[0]
        gone = before & (rows.kind == MoveKind.RETRACT)
        if new not in self._used:
            gone |= before & (rows.kind == MoveKind.PRIME)
        rest, old = _where(rows, ~gone), self._heads[self._active]
        tool = np.full(len(rest.kind), new)
        if old.retract_ul == 0:
            return rest, tool
        relieved = Rows(
            end=at[None],
            volume_ul=np.array([-old.retract_ul]),
            speed_mm_s=np.zeros(1),
            duration_s=np.array([old.retract_ul / old.plunger_ul_s]),
            kind=np.array([int(MoveKind.RETRACT)]),
            travels=0,
            lifted=0,
            links=0,
        )
        return _joined([relieved, rest]), np.append([self._active], tool)


def _where(rows: Rows, keep: NDArray[np.bool_]) -> Rows:
    return replace(
        rows,
        end=rows.end[keep],
        volume_ul=rows.volume_ul[keep],
        speed_mm_s=rows.speed_mm_s[keep],
        duration_s=rows.duration_s[keep],
        kind=rows.kind[keep],
    )


def _joined(parts: Sequence[Rows]) -> Rows:
    return Rows(
        end=np.concatenate([np.zeros((0, 3)), *(part.end for part in parts)]),
        volume_ul=np.concatenate([np.zeros(0), *(part.volume_ul for part in parts)]),
        speed_mm_s=np.concatenate([np.zeros(0), *(part.speed_mm_s for part in parts)]),
        duration_s=np.concatenate([np.zeros(0), *(part.duration_s for part in parts)]),
        kind=np.concatenate([np.zeros(0, dtype=np.int64), *(part.kind for part in parts)]),
        travels=sum(part.travels for part in parts),
        lifted=sum(part.lifted for part in parts),
        links=sum(part.links for part in parts),
    )
