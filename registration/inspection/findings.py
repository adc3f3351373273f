"""Data classes of all that a look at a layer tells."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

from registration.inspection.values import (
    Appearance,
    Blob,
    Gap,
    LumenSeen,
    Shift,
    Stations,
    Stretch,
)

ASKED_MM: Final = 2.0
"""Stretches that may be bare are asked about, and drawn, from there on."""


@dataclass(frozen=True)
class ToldOfInk:
    """What all measures together tell of whether ink came, in the order of writing.

    Attributes
    ----------
    came_mm : float, mm
        Way that isn't seen, along which the picture changed as ink changes it.
    ink_mm : float, mm
        Way on which ink surely lies by any of them.
    head_mm : float, mm
        Way in front of the first such place.
    still : tuple of Gap
        Stretches that aren't seen and didn't change, though others like them did.
    untold, tail : tuple of Gap
        What nothing tells of; and of that, with gaps, what lies behind the last place with ink.
    unseen : tuple of Gap
        What isn't seen, changed or not.
    doubted : tuple of Gap
        Of that, stretches that changed, though their level looks bare.
    thin : tuple of Gap
        Stretches without a width that changed near the middle alone: their ink may be thin.
    thin_untold_mm : float, mm
        Of `came_mm`, at which that isn't told either.
    """

    came_mm: float = 0.0
    ink_mm: float = 0.0
    head_mm: float = 0.0
    still: tuple[Gap, ...] = ()
    untold: tuple[Gap, ...] = ()
    tail: tuple[Gap, ...] = ()
    unseen: tuple[Gap, ...] = ()
    doubted: tuple[Gap, ...] = ()
    thin: tuple[Gap, ...] = ()
    thin_untold_mm: float = 0.0


@dataclass(frozen=True)
class LayerFindings:
    """What a look at a layer told.

    Attributes
    ----------
    stations : Stations
    gaps : tuple of Gap
    stretches : tuple of Stretch
    blobs : tuple of Blob
    lumens : tuple of LumenSeen
    width_ratio, u_width_ratio : float
        Width seen over expected where there is ink, common doubt included; NaN and inf without.
    seen_share : float
        Of the expected way.
    coverage : float
        Ink seen over expected on the way that was seen; NaN where nothing was.
    shift : Shift
    places : int
        Independent places that were tested for gaps.
    contrast : float
        Ink over bath, in standard deviations of a place as long as a tolerated gap.
    appearance : Appearance or None
        None where ink couldn't be told from bath.
    moved_px : float
        By how many pixels the camera moved since the picture before; NaN without one.
    bare : tuple of int
        Strokes of which nothing is seen or stands out: their ink is missing, or too faint.
    unseen : tuple of Gap
        Stretches longer than `SeeingOptions.unseen_mm` of which nothing is told, ink or gap.
    faint_share : float
        Of the expected way, on which ink shows, but gaps longer than a tolerated one alone do.
    unplaced : tuple of Gap
        What is missing by one of two places that the layer may have, and not by the other.
    beside_mm : float, mm
        Way of a line whose ink lies at the layer's height where none should (a profiler's maps).
    aside : bool
        Whether all of its ink lies aside, however unsure by how much.
    least_gap_mm, by_height_share, waver : float
        Of a profiler's map: shortest gap that surely shows, mm; share of the way seen over older
        ink, where no widths are told; standard deviation of ink's height there, thicknesses.
    older_mm, older_step, older_limit : float
        Way over older ink, mm; by what logarithm it changed since the picture before, and by what
        it may without ink; or NaN.
    told : ToldOfInk
    untold_seams : float
        Share of the way that is seen and touches neighbours, so that nothing tells of thin ink.
    """

    stations: Stations
    gaps: tuple[Gap, ...]
    stretches: tuple[Stretch, ...]
    blobs: tuple[Blob, ...]
    lumens: tuple[LumenSeen, ...]
    width_ratio: float
    u_width_ratio: float
    seen_share: float
    coverage: float
    shift: Shift
    places: int
    contrast: float
    appearance: Appearance | None
    moved_px: float = math.nan
    bare: tuple[int, ...] = ()
    unseen: tuple[Gap, ...] = ()
    faint_share: float = 0.0
    unplaced: tuple[Gap, ...] = ()
    beside_mm: float = 0.0
    aside: bool = False
    least_gap_mm: float = 0.0
    by_height_share: float = 0.0
    waver: float = math.nan
    older_mm: float = 0.0
    older_step: float = math.nan
    older_limit: float = math.nan
    told: ToldOfInk = ToldOfInk()
    untold_seams: float = 0.0
