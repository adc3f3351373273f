"""Data class of a vessel network: nodes, and vessels as polylines with radii; loops allowed.

Every stage after vasculature (flow, solids, toolpath, registration) takes this value.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from enum import IntEnum
from typing import Any, ClassVar, Final

import numpy as np
from numpy.typing import NDArray

from design.errors import NetworkError
from design.notebook import NotebookView, draw_lines, span
from kernels.arrays import FloatArray, IntArray

MAX_MM: Final = 1e6
"""Largest coordinate or radius that is taken: no tissue is a kilometre wide."""


class VesselKind(IntEnum):
    """What a vessel carries; the lower-case name stands in files."""

    ARTERY = 0
    VEIN = 1
    LYMPH = 2
    CONNECTION = 3
    CHANNEL = 4


@dataclass(frozen=True, repr=False)
class VesselNetwork(NotebookView):
    """Nodes, and vessels between them, each a polyline with a radius at each point.

    Attributes
    ----------
    nodes : (m, 3) float64, mm
        Where vessels meet or end.
    vessel_nodes : (v, 2) int64
        First and last node of each vessel; designed flow runs from first to last.
    kind : (v,) int64
        A `VesselKind` each.
    tree : (v,) int64
        Number of the tree (or network) the vessel belongs to.
    offset : (v + 1,) int64
        Points of vessel ``i`` are ``offset[i]:offset[i + 1]`` of the arrays below.
    points : (p, 3) float64, mm
        Polylines; each starts and ends on its vessel's nodes.
    radius : (p,) float64, mm
        Lumen radius at each point.
    """

    nodes: FloatArray
    vessel_nodes: IntArray
    kind: IntArray
    tree: IntArray
    offset: IntArray
    points: FloatArray
    radius: FloatArray

    projection: ClassVar[str | None] = "3d"

    def _facts(self) -> Mapping[str, str]:
        return {
            "vessels": f"{self.vessel_count}",
            "nodes": f"{len(self.nodes)}",
            "kinds": ", ".join(sorted(set(self.kind_names().tolist()))),
            "diameters": span(2.0 * self.radius, "mm"),
            "size": f"{' × '.join(f'{mm:.4g}' for mm in np.ptp(self.points, axis=0))} mm",
        }

    def _columns(self) -> Mapping[str, Any]:
        return {
            "node0": self.vessel_nodes[:, 0],
            "node1": self.vessel_nodes[:, 1],
            "kind": self.kind_names(),
            "tree": self.tree,
            "length_mm": self.lengths(),
            "mean_radius_mm": self.mean_radius(),
        }

    def _draw(self, axes: Any) -> None:
        start, end, r0, r1, _ = self.pieces()
        draw_lines(axes, np.stack([start, end], axis=1), r0 + r1, "diameter (mm)")

    def __post_init__(self) -> None:
        check_shapes(self)

    @property
    def vessel_count(self) -> int:
        """Number of vessels."""
        return len(self.vessel_nodes)

    def polyline(self, vessel: int) -> tuple[FloatArray, FloatArray]:
        """Points (k, 3) and radii (k,) of one vessel, mm."""
        where = slice(int(self.offset[vessel]), int(self.offset[vessel + 1]))
        return self.points[where], self.radius[where]

    def polylines(self) -> Iterator[tuple[FloatArray, FloatArray]]:
        """Points and radii of each vessel in turn, mm."""
        return (self.polyline(vessel) for vessel in range(self.vessel_count))

    def pieces(self) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray, IntArray]:
        """All straight pieces: start (n,3), end (n,3), start radius, end radius, vessel (n,)."""
        vessel_of_point = np.repeat(np.arange(self.vessel_count), np.diff(self.offset))
        first = np.flatnonzero(vessel_of_point[:-1] == vessel_of_point[1:])
        return (
            self.points[first],
            self.points[first + 1],
            self.radius[first],
            self.radius[first + 1],
            vessel_of_point[first],
        )

    def lengths(self) -> FloatArray:
        """Length of each vessel along its polyline, (v,), mm."""
        start, end, _, _, vessel = self.pieces()
        steps = np.linalg.norm(end - start, axis=1)
        lengths: FloatArray = np.zeros(self.vessel_count)
        np.add.at(lengths, vessel, steps)
        return lengths

    def mean_radius(self) -> FloatArray:
        """Length-weighted mean radius of each vessel, (v,), mm."""
        start, end, r0, r1, vessel = self.pieces()
        steps = np.linalg.norm(end - start, axis=1)
        weighted = np.bincount(vessel, weights=steps * (r0 + r1) / 2, minlength=self.vessel_count)
        return weighted / self.lengths()

    def degree(self) -> IntArray:
        """Number of vessel ends at each node, (m,)."""
        return np.bincount(self.vessel_nodes.ravel(), minlength=len(self.nodes))

    def kind_names(self) -> NDArray[np.str_]:
        """What each vessel carries, as files say it, (v,)."""
        return np.array([kind.name.lower() for kind in VesselKind])[self.kind]

    def inlets(self) -> IntArray:
        """Nodes that vessels leave and none enters."""
        return self._ends(leaving=0, entering=1)

    def outlets(self) -> IntArray:
        """Nodes that vessels enter and none leaves."""
        return self._ends(leaving=1, entering=0)

    def _ends(self, leaving: int, entering: int) -> IntArray:
        used = np.bincount(self.vessel_nodes[:, leaving], minlength=len(self.nodes)) > 0
        never = np.bincount(self.vessel_nodes[:, entering], minlength=len(self.nodes)) == 0
        return np.flatnonzero(used & never)

    def moved(self, offset_mm: FloatArray) -> VesselNetwork:
        """The same network translated by ``offset_mm`` (3,)."""
        return VesselNetwork(
            self.nodes + offset_mm,
            self.vessel_nodes,
            self.kind,
            self.tree,
            self.offset,
            self.points + offset_mm,
            self.radius,
        )

    @staticmethod
    def from_segments(
        nodes: FloatArray,
        vessel_nodes: IntArray,
        radius: FloatArray,
        kind: IntArray,
        tree: IntArray,
    ) -> VesselNetwork:
        """Build a network of straight vessels of constant radius ``radius`` (v,), mm."""
        vessel_nodes = np.asarray(vessel_nodes, dtype=np.int64)
        return VesselNetwork(
            nodes=np.asarray(nodes, dtype=np.float64),
            vessel_nodes=vessel_nodes,
            kind=np.asarray(kind, dtype=np.int64),
            tree=np.asarray(tree, dtype=np.int64),
            offset=2 * np.arange(len(vessel_nodes) + 1, dtype=np.int64),
            points=np.asarray(nodes, dtype=np.float64)[vessel_nodes.ravel()],
            radius=np.repeat(np.asarray(radius, dtype=np.float64), 2),
        )


def check_shapes(network: VesselNetwork) -> None:
    """Raise `NetworkError` when arrays disagree in length or hold impossible numbers."""
    vessels, points = len(network.vessel_nodes), len(network.points)
    lengths = [len(network.kind), len(network.tree), len(network.offset) - 1]
    if lengths != [vessels] * 3 or len(network.radius) != points or network.offset[-1] != points:
        raise NetworkError("network arrays differ in length; build it from segments or a CSV file")
    if vessels == 0:
        raise NetworkError("network has no vessels; give at least one")
    for name, values in (("position", network.points), ("radius", network.radius)):
        bad = np.flatnonzero(~(np.abs(values) <= MAX_MM).reshape(points, -1).all(axis=1))
        if len(bad):
            vessel = int(np.searchsorted(network.offset, bad[0], side="right")) - 1
            raise NetworkError(
                f"vessel {vessel}: {name} is NaN, infinite or beyond {MAX_MM:g} mm (point "
                f"{int(bad[0])}, {len(bad)} such points); mend the network file or its unit"
            )
    thin = np.flatnonzero(network.radius <= 0)
    if len(thin):
        vessel = int(np.searchsorted(network.offset, thin[0], side="right")) - 1
        raise NetworkError(
            f"vessel {vessel}: radius {network.radius[thin[0]]:g} mm isn't above 0; "
            "give every point a positive radius"
        )
