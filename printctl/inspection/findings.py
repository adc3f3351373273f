"""Data class of the findings of one look at a layer."""

from __future__ import annotations

import math
from dataclasses import dataclass

from printctl.inspection.values import (
    Appearance,
    Blob,
    Gap,
    LumenFinding,
    Shift,
    Stations,
    Stretch,
)


@dataclass(frozen=True)
class LayerFindings:
    """Findings of one look at a layer.

    Attributes
    ----------
    stations : Stations
    gaps : tuple of Gap
    stretches : tuple of Stretch
    blobs : tuple of Blob
    lumens : tuple of LumenFinding
    width_ratio, u_width_ratio : float
        Width seen over expected where there is ink, common doubt included; NaN and inf without.
    seen_share : float
        Share of the expected lines' length.
    coverage : float
        Ink seen over expected on the way that was seen; NaN where nothing was.
    shift : Shift
    places : int
        Independent places that were tested for gaps.
    contrast : float
        Ink over bath, in standard deviations of a place as long as a tolerated gap.
    appearance : Appearance or None
        None where ink couldn't be distinguished from bath.
    u_width_change : float
        Relative, of its change since the last look in the same light; infinite without one.
    moved_px : float
        Move of the camera since the picture before, px; NaN without one.
    """

    stations: Stations
    gaps: tuple[Gap, ...]
    stretches: tuple[Stretch, ...]
    blobs: tuple[Blob, ...]
    lumens: tuple[LumenFinding, ...]
    width_ratio: float
    u_width_ratio: float
    seen_share: float
    coverage: float
    shift: Shift
    places: int
    contrast: float
    appearance: Appearance | None
    u_width_change: float = math.inf
    moved_px: float = math.nan
