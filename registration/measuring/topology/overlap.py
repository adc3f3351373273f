"""Volume overlap of designed and printed lumens, and whether a scan is of another part."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from design.network import VesselNetwork
from kernels.arrays import FloatArray
from registration.alignment import LEAST_SEEN, Fit
from registration.alignment.distance import ModelSurface
from registration.measuring.gauging.deviation import near_lumen
from registration.measuring.topology.grid import LumenGrid
from registration.segmentation import GelEvidence, Segmentation, are_separable

SAMPLES: Final = 100_000
CLOSE_MM: Final = 0.25
"""Surface farther from the design doesn't belong to it, and free space so far from a wall is in
designed gel."""
GEL_REACH_MM: Final = 1.0
"""How far around lumens scanned without their construct gel is known to be designed."""
LEAST_LIT: Final = 0.3
"""Of the designed lumens' volume: where light shows less, which part it is stays open."""
BELOW_MM: Final = np.arange(1, 13) * 0.1
FEWEST_BELOW: Final = 2
"""Where gel is looked for below a place, beyond the widest lumen; how often it must be there."""
LEAST_PLACES: Final = 50
"""Random places in the designed lumens, or they say nothing."""
MOST_OPEN: Final = 0.6
"""Share of the designed lumens that may be hollow in another part's scan: of 30 scans of other
parts that could be aligned at most 0.53 (``benchmarks identity``). Where more is hollow no gel
contradicts the design; what else is hollow is gel that is missing, as of a print that stopped."""


@dataclass(frozen=True)
class Likelihood:
    """Logarithm of how much likelier numbers of a scan are of another part than of this one.

    A sum of four terms, each growing with what speaks for another part. Weights were set by hand
    near a logistic regression on 24 pairs of scans from ``benchmarks identity`` (three generators).
    Of its first 37 pairs right parts reach -2.4, and of 31 wrong ones that could be aligned one
    lies below 1.5. To be fitted again (``python -m benchmarks.identity.fit``) on all 500.

    Attributes
    ----------
    constant : float
    foreign : float
        Per e-fold of the hollow volume in designed gel over that of the designed lumens.
    closed : float
        Of the share of the designed lumens that is gel.
    far : float
        Per e-fold of the share of the scanned surface that lies far from the design.
    scale : float
        Of the largest fitted scale's distance from 1, which counts up to `MOST_SCALE`.
    decisive : float
        From which on the scan is another part's.
    """

    constant: float = -5.5
    foreign: float = 1.0
    closed: float = 3.5
    far: float = 1.0
    scale: float = 30.0
    decisive: float = 1.5

    def terms(self, foreign: float, opened: float, close: float, scale: float) -> FloatArray:
        """Return the four quantities that the weights multiply."""
        return np.array(
            [
                np.log(foreign + FOREIGN_FLOOR) - np.log(FOREIGN_FLOOR),
                1.0 - opened,
                np.log(1.0 - close + FAR_FLOOR) - np.log(FAR_FLOOR),
                min(scale, MOST_SCALE),
            ]
        )

    def of(self, foreign: float, opened: float, close: float, scale: float) -> float:
        """Return the sum."""
        weights = np.array([self.foreign, self.closed, self.far, self.scale])
        return float(self.constant + weights @ self.terms(foreign, opened, close, scale))


FOREIGN_FLOOR: Final = 0.02
FAR_FLOOR: Final = 0.01
"""Below these the shares are noise."""
MOST_SCALE: Final = 0.1
"""A wrong voxel size fits any scale, and speaks for no other part by that."""
LIKELIHOOD: Final = Likelihood()


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

    Volumes count where light tells gel from nothing (`are_separable`) and comes back from gel
    farther down: below the last of it, dark gel looks hollow.

    Attributes
    ----------
    foreign_share : float
        Of the volume that is free of gel within the part, what lies in designed gel.
    foreign_ratio : float
        The same volume over that of the designed lumens.
    designed_open : float
        Share of the designed lumens' volume that is free of gel.
    close_share : float
        Share of the scanned surface within `CLOSE_MM` of the design.
    lit_share : float
        Share of the designed lumens' volume in view where light tells.
    scale_off : float
        Largest distance of a fitted scale from 1.
    surface_lit : float
        Share of the scanned surface that light reached.
    explained : bool
        The scan fits the design as far as it was printed, or with layers that were shifted.
    """

    foreign_share: float
    foreign_ratio: float
    designed_open: float
    close_share: float
    lit_share: float
    scale_off: float
    surface_lit: float
    explained: bool = False

    @property
    def likelihood(self) -> float:
        """Logarithm of the likelihood ratio of another part against this one; NaN if not known."""
        return LIKELIHOOD.of(
            self.foreign_ratio, self.designed_open, self.close_share, self.scale_off
        )

    @property
    def other_part(self) -> bool:
        """Whether this is another part: gel in the designed lumens, and lumens in the designed gel.

        Either alone is a defect: clogged lumens, or gel that is missing. Where light doesn't tell
        gel from liquid nothing is proven.
        """
        lit = self.lit_share >= LEAST_LIT and self.surface_lit >= LEAST_SEEN
        contradicted = not self.explained and lit and self.designed_open <= MOST_OPEN
        return contradicted and self.likelihood > LIKELIHOOD.decisive


@dataclass(frozen=True)
class Landed:
    """A scan that lies on its design.

    Attributes
    ----------
    surface : ModelSurface
    network : VesselNetwork
    segmentation : Segmentation
    evidence : GelEvidence
        Of the segmentation.
    fit : Fit
    model_is_lumen : bool
    depth_down : bool
        Whether light runs towards the scan's larger z.
    explained : bool
        See `Agreement`.
    """

    surface: ModelSurface
    network: VesselNetwork
    segmentation: Segmentation
    evidence: GelEvidence
    fit: Fit
    model_is_lumen: bool
    depth_down: bool
    explained: bool = False

    def lit(self, scanned: FloatArray) -> NDArray[np.bool_]:
        """Whether gel and liquid are told apart at places (n, 3) of the scan, mm."""
        told = are_separable(1.0, 0.0, self.evidence.scatter_at(scanned))
        if self.segmentation.strength is None:
            return told
        gel = np.zeros(len(scanned), dtype=np.int64)
        for deeper in BELOW_MM if self.depth_down else -BELOW_MM:
            gel += self.segmentation.field.above_level(scanned + [0.0, 0.0, deeper]) > 0
        return np.asarray(told & (gel >= FEWEST_BELOW))


def agreement(landed: Landed) -> Agreement:
    """Compare hollows and surface of a scan with the design at random places, always the same."""
    surface, fit, segmentation = landed.surface, landed.fit, landed.segmentation
    low, high = surface.bounds
    margin = GEL_REACH_MM if landed.model_is_lumen else 0.0
    size = high - low + 2 * margin
    places = low - margin + np.random.default_rng(0).random((SAMPLES, 3)) * size
    scanned = fit.invert(places)
    value = segmentation.field.above_level(scanned)
    known = np.isfinite(value)
    places, scanned, free = places[known], scanned[known], value[known] < 0
    # Positive in lumens and outside of the part, negative in gel.
    depth = surface.query(places).distance * (-1.0 if landed.model_is_lumen else 1.0)
    inside = (depth > 0) & near_lumen(places, landed.network)
    gel = depth < -CLOSE_MM
    if landed.model_is_lumen:
        gel &= depth > -GEL_REACH_MM
    lit = landed.lit(scanned)
    lumen = inside & lit
    foreign, own = int((gel & lit & free).sum()), int((lumen & free).sum())
    whole, told = int(inside.sum()), int(lumen.sum())
    near = np.abs(
        surface.query(fit.apply(segmentation.surface.vertices[segmentation.seen])).distance
    )
    enough = told >= LEAST_PLACES
    return Agreement(
        foreign_share=foreign / (foreign + own) if foreign + own else float("nan"),
        foreign_ratio=foreign / told if enough else float("nan"),
        designed_open=own / told if enough else float("nan"),
        close_share=float((near < CLOSE_MM).mean()),
        lit_share=told / whole if whole >= LEAST_PLACES else float("nan"),
        scale_off=float(np.abs(fit.scale - 1).max()),
        surface_lit=float(segmentation.seen.mean()),
        explained=landed.explained,
    )
