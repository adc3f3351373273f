"""Compute the volume overlap of designed and printed lumens; tell another part's scan by it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from design.network import VesselNetwork
from registration.alignment import Fit
from registration.alignment.distance import ModelSurface
from registration.measuring.gauging.deviation import near_lumen
from registration.measuring.topology.grid import LumenGrid
from registration.segmentation import Segmentation

SAMPLES: Final = 100_000
CLOSE_MM: Final = 0.25
"""Surface farther from the design doesn't belong to it, and free space so far from a wall is in
designed gel."""
GEL_REACH_MM: Final = 1.0
"""How far around lumens scanned without their construct gel is known to be designed."""
MAX_FOREIGN: Final = 0.12
MIN_OPEN: Final = 0.5
"""Of 14 scans of right parts (up to 4 of 7 vessels missing, half in view, hard light, swollen,
narrowed, leaks with debris) foreign was at most 0.07, and of 23 scans of other parts at least 0.18;
of those the designed lumens were open to at most 0.39."""


@dataclass(frozen=True)
class Overlap:
    """Volumes of the lumens in the field of view.

    Attributes
    ----------
    dice : float
        Twice the common volume over the sum of both (Dice 1945, doi 10.2307/1932409).
    volume_ratio : float
        Printed over designed.
    printed_mm3, designed_mm3 : float, mm³
        By counting voxels; printed is what is free within `near_mm` of a designed wall.
    near_mm : float, mm
    """

    dice: float
    volume_ratio: float
    printed_mm3: float
    designed_mm3: float
    near_mm: float


def overlap(grid: LumenGrid, near_mm: float) -> Overlap:
    """Compare volumes on a grid; NaN where nothing of the design is in view.

    Parameters
    ----------
    grid : LumenGrid
    near_mm : float, mm
        Free space farther from the designed wall is no lumen of this design (but a leak, say).
    """
    designed = grid.known & (grid.wall_mm <= 0)
    printed = grid.known & grid.free & (grid.wall_mm <= near_mm)
    both = int(np.count_nonzero(designed & printed))
    a, b = int(np.count_nonzero(printed)), int(np.count_nonzero(designed))
    cell = grid.step_mm**3
    return Overlap(
        dice=2 * both / (a + b) if a + b else float("nan"),
        volume_ratio=a / b if b else float("nan"),
        printed_mm3=a * cell,
        designed_mm3=b * cell,
        near_mm=near_mm,
    )


@dataclass(frozen=True)
class Agreement:
    """How far a scan's hollows are those of the design; NaN where nothing of it is in view.

    Attributes
    ----------
    foreign_share : float
        Of the volume that is free of gel within the part, what lies in designed gel.
    designed_open : float
        Share of the designed lumens' volume that is free of gel.
    close_share : float
        Share of the scanned surface within `CLOSE_MM` of the design.
    """

    foreign_share: float
    designed_open: float
    close_share: float

    @property
    def other_part(self) -> bool:
        """Whether this is another part: its hollows lie where the design has none.

        A part that lacks vessels has few hollows, but these are the design's.
        """
        return self.foreign_share > MAX_FOREIGN and self.designed_open < MIN_OPEN


def agreement(
    surface: ModelSurface,
    network: VesselNetwork,
    segmentation: Segmentation,
    fit: Fit,
    model_is_lumen: bool,
) -> Agreement:
    """Compare hollows and surface of a scan with the design at random places, always the same."""
    low, high = surface.bounds
    margin = GEL_REACH_MM if model_is_lumen else 0.0
    size = high - low + 2 * margin
    places = low - margin + np.random.default_rng(0).random((SAMPLES, 3)) * size
    value = segmentation.field.above_level(fit.invert(places))
    places, free = places[np.isfinite(value)], value[np.isfinite(value)] < 0
    # Positive in lumens and outside of the part, negative in gel.
    depth = surface.query(places).distance * (-1.0 if model_is_lumen else 1.0)
    lumen = (depth > 0) & near_lumen(places, network)
    gel = depth < -CLOSE_MM
    if model_is_lumen:
        gel &= depth > -GEL_REACH_MM
    foreign, own = int((gel & free).sum()), int((lumen & free).sum())
    scanned = fit.apply(segmentation.surface.vertices[segmentation.seen])
    return Agreement(
        foreign / (foreign + own) if foreign + own else float("nan"),
        own / int(lumen.sum()) if lumen.any() else float("nan"),
        float((np.abs(surface.query(scanned).distance) < CLOSE_MM).mean()),
    )
