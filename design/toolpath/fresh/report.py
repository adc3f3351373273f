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


def make_report(
    toolpath: Toolpath,
    coverage: list[Coverage],
    *,
    layers: int,
    lines: int,
    travels: int,
    lifted: int,
    links: int,
) -> FreshReport:
    """Gather the numbers of a planned part."""
    length = toolpath.lengths
    material = np.array([layer.material for layer in coverage])
    return FreshReport(
        layers=layers,
        lines=lines,
        written_mm=float(length[toolpath.kind == MoveKind.WRITE].sum()),
        travel_mm=float(length[toolpath.kind == MoveKind.TRAVEL].sum()),
        written_ul=toolpath.written_ul,
        material_ul=float(material.mean()) * layers * toolpath.layer_height_mm,
        unfilled=np.array([layer.unfilled for layer in coverage]) / material,
        outside=np.array([layer.outside for layer in coverage]) / material,
        travels=travels,
        lifted=lifted,
        links=links,
    )
