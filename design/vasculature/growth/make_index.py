"""Build a growing tree's segment index; make its clearances from the options."""

from __future__ import annotations

import numpy as np

from design.tissue import Tissue
from design.vasculature.growth.clearances import MARGIN, Clearances
from design.vasculature.growth.index import CellIndex, empty_index
from design.vasculature.growth.state import Segments
from design.vasculature.growth.step import list_all, list_from
from design.vasculature.options import GrowthOptions
from kernels.arrays import FloatArray

CELL = 1.2
"""Edge of a cell over the mean spacing of terminals."""


def index_segments(
    bounds: FloatArray, cell_mm: float, segments: Segments, own: int, others: int, room: Clearances
) -> CellIndex:
    """An index of the first ``own`` segments and the last ``others``, with room to spare."""
    end = len(segments)
    entries = 16 * end + 4096
    while True:
        index = empty_index(bounds, cell_mm, entries, end)
        done = list_all(segments, own, index, room)
        done = done and list_from(segments, end - others, end, index, room)
        if done and index.used[0] < 0.5 * entries:
            return index
        entries *= 2


def clearances_of(tissue: Tissue, options: GrowthOptions) -> Clearances:
    """The distances and limits that the options ask for."""
    return Clearances(
        tissue.grid.arrays,
        options.clearance_mm,
        options.clearance_mm,
        options.clearance_ratio,
        options.length_to_radius,
        MARGIN,
        options.limits,
        np.inf,
    )


def just_below(value: float) -> float:
    """A hair below a value: what meets it to rounding passes."""
    return value * (1.0 - 1e-9)
