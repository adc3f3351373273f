"""Convert the ink at seams of a layer that is seen to thin stretches, ink and what isn't told."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from kernels.arrays import FloatArray, IntArray
from registration.inspection.gaps.gaps import inside
from registration.inspection.ink.seams import straight_seams
from registration.inspection.seen_layer import SeenLayer
from registration.inspection.values import Gap, Stretch, Unseen


@dataclass(frozen=True)
class SeamFindings:
    """What lines that touch tell.

    Attributes
    ----------
    stretches : tuple of Stretch
        Too thin ones.
    ink : (n,) float64
        Of each place, 0 to 1: thin lines leave a part of their way bare.
    share : (m,) float64 or None
        As of `Stations.seam_share`.
    untold : float
        As of `LayerFindings.untold_seams`.
    """

    stretches: tuple[Stretch, ...]
    ink: FloatArray
    share: FloatArray | None
    untold: float


def without_thin(look: SeenLayer, gaps: list[Gap]) -> list[Gap]:
    """Return gaps without those that are thin ink."""
    seams = None if look.bath is None else look.bath.seams
    if seams is None:
        return gaps
    return [gap for gap in gaps if not seams.thins(gap, look.ways, look.present)]


def seam_findings(look: SeenLayer, gaps: list[Gap], why: IntArray) -> SeamFindings:
    """Return what lines that touch tell outside gaps; ``why`` is `Unseen`, (n,)."""
    ways, ink = look.ways, np.clip(look.present, 0.0, 1.0)
    alone = np.isfinite(look.widths.width_mm)[look.group.of]
    untold = (why == Unseen.SEEN) & ~look.over_old & straight_seams(ways) & ~alone
    seams = None if look.bath is None else look.bath.seams
    stretches: tuple[Stretch, ...] = ()
    share = None
    if seams is not None:
        whole = ~inside(gaps, ways) & (why == Unseen.SEEN)
        seams = replace(seams, thin=seams.thin & whole)
        stretches, ink = seams.stretches(ways), np.where(seams.thin, np.fmin(ink, seams.share), ink)
        share = look.group.mean(seams.share, seams.told & whole)
        untold &= ~seams.told
    way = ways.step
    return SeamFindings(stretches, ink, share, float(way[untold].sum()) / float(way.sum()))
