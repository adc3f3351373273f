"""What was planned, in numbers."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from design.toolpath.fresh.coverage import Coverage
from design.toolpath.toolpath import FloatArray, MoveKind, Toolpath


@dataclass(frozen=True)
class FreshReport:
    """FRESH layers in numbers.

    Attributes
    ----------
    layers, lines : int
        Layers with material, and written paths in them.
    written_mm, travel_mm : float, mm
    written_ul, material_ul : float, µL
        Ink of the lines, and the measured sections' mean area times the part's height.
    unfilled : (k,) float64
        Part of a layer's material that no line covers, in the layers where it was measured.
    outside : (k,) float64
        Area that lines cover outside the material, as a part of the layer's material: rounded
        corners never, lines wider than the place they stand in always.
    travels : int
        Travels between paths, links included.
    lifted : int
        Of these, the ones that would have crossed an open lumen and went above it.
    links : int
        Of these, the ones so short that they go without retraction.
    """

    layers: int
    lines: int
    written_mm: float
    travel_mm: float
    written_ul: float
    material_ul: float
    unfilled: FloatArray
    outside: FloatArray
    travels: int
    lifted: int
    links: int

    @property
    def unfilled_fraction(self) -> float:
        """Part of the whole part's material that no line covers (layers weighted alike)."""
        return float(self.unfilled.mean())


class Tally:
    """Adds up a part's numbers, layer by layer."""

    def __init__(self) -> None:
        self.moves = 0
        self._layers = self._lines = self._travels = self._lifted = self._links = 0
        self._written_mm = self._travel_mm = self._written_ul = self._height_mm = 0.0
        self._coverage: list[Coverage] = []

    def add(self, toolpath: Toolpath, *, lines: int, travels: int, lifted: int, links: int) -> None:
        """Count the moves of one layer."""
        length = toolpath.lengths
        self.moves += len(toolpath)
        self._lines += lines
        self._travels += travels
        self._lifted += lifted
        self._links += links
        self._written_mm += float(length[toolpath.kind == MoveKind.WRITE].sum())
        self._travel_mm += float(length[toolpath.kind == MoveKind.TRAVEL].sum())
        self._written_ul += toolpath.written_ul
        self._height_mm = toolpath.layer_height_mm

    def add_layer(self, coverage: Coverage | None) -> None:
        """Count a layer with material, and how well its lines cover it where that was measured."""
        self._layers += 1
        if coverage is not None:
            self._coverage.append(coverage)

    def report(self) -> FreshReport:
        """The numbers of the layers so far."""
        material = np.array([layer.material for layer in self._coverage])
        return FreshReport(
            layers=self._layers,
            lines=self._lines,
            written_mm=self._written_mm,
            travel_mm=self._travel_mm,
            written_ul=self._written_ul,
            material_ul=float(material.mean()) * self._layers * self._height_mm,
            unfilled=np.array([layer.unfilled for layer in self._coverage]) / material,
            outside=np.array([layer.outside for layer in self._coverage]) / material,
            travels=self._travels,
            lifted=self._lifted,
            links=self._links,
        )
