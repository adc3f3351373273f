"""Judge section centres as gel or liquid; mark sections where neither is certain as not seen.

The mean evidence within 0.7 radii of the axis is held against both gel (1) and liquid. A section
is called open only where gel is rejected, closed only where liquid is; else it isn't seen.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from kernels.arrays import BoolArray, FloatArray
from registration.alignment import Fit
from registration.measuring.gauging.trace import VesselTrace
from registration.segmentation import GelEvidence, are_separable
from registration.segmentation.evidence import SIGMA_MM

CORE = 0.7
"""Of the designed radius: clear of walls that lie somewhat elsewhere."""
REJECTED = 3.0
"""Standard deviations: of a true one in 700 is rejected."""
SLAB_MM = 0.075
"""Half the length of what is averaged along the vessel: the shortest plug looked for."""
LANDED = 0.15
"""Prints shrink and swell by less."""


@dataclass(frozen=True)
class ContrastGauge:
    """How well gel and liquid are told apart.

    Attributes
    ----------
    liquid : float
        Evidence for gel in liquid; gel's is 1.
    untold : float
        Share of the sections in light and view that can be called neither open nor closed.
    examined : float
        Share of the designed gel, clear of walls, that was examined for leaks and bridges.
    unresolved : int
        Places that look like a leak with gel left in it, too thin for this scan to tell.
    """

    liquid: float
    untold: float
    examined: float
    unresolved: int = 0


def liquid_level(traces: tuple[VesselTrace, ...], evidence: GelEvidence, fit: Fit) -> float:
    """Return the evidence for gel in liquid; 1 (nothing can be told) where the fit is no landing.

    The lower quartile of the vessels' medians along their axes. A scale off by more than
    `LANDED` means that the axes lie anywhere.
    """
    if np.abs(fit.scale - 1).max() > LANDED:
        return 1.0
    medians = [
        np.nanmedian(known)
        for trace in traces
        if np.isfinite(known := evidence.at(trace.planes.centre[trace.seen])).any()
    ]
    return float(np.percentile(medians, 25)) if medians else 1.0


def withdraw_sections(
    traces: tuple[VesselTrace, ...], evidence: GelEvidence, liquid: float
) -> tuple[VesselTrace, ...]:
    """Return traces in which sections that can't be called open or closed aren't seen."""
    return tuple(_withdrawn(trace, evidence, liquid) for trace in traces)


def _withdrawn(trace: VesselTrace, evidence: GelEvidence, liquid: float) -> VesselTrace:
    reliable = reliable_sections(trace, evidence, liquid)
    return replace(trace, seen=trace.seen & reliable, counted=trace.counted & reliable)


def reliable_sections(trace: VesselTrace, evidence: GelEvidence, liquid: float) -> BoolArray:
    """Return which sections are rightly called what they are called, (n,)."""
    mean, error = core_means(trace, evidence)
    scatter = evidence.scatter_at(trace.planes.centre)
    sides = np.where(
        trace.sections.open, mean < 1 - REJECTED * error, mean > liquid + REJECTED * error
    )
    return np.asarray(sides & are_separable(1.0, liquid, np.minimum(scatter, error)))


def core_means(trace: VesselTrace, evidence: GelEvidence) -> tuple[FloatArray, FloatArray]:
    """Return the mean evidence in the middle of each section, and its standard deviation in gel.

    A mean over a volume V of averages whose own is U = (2 √π σ)³ has √(U/(U + V)) of their scatter.
    """
    planes, half = trace.planes, max(trace.spacing / 2, SLAB_MM)
    angle = 2 * np.pi * np.arange(6) / 6
    circle = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    flat = np.concatenate([np.zeros((1, 2)), 0.45 * CORE * circle, 0.9 * CORE * circle])
    across = planes.radius[:, None, None] * (flat @ planes.across)
    along = np.cross(planes.across[:, 0], planes.across[:, 1])
    shift = np.array([-0.7, 0.0, 0.7]) * half
    places = (
        planes.centre[:, None, None]
        + across[:, None]
        + shift[None, :, None, None] * along[:, None, None]
    )
    values = evidence.at(places.reshape(len(places), -1, 3))
    own = (2 * np.sqrt(np.pi) * SIGMA_MM) ** 3
    volume = np.pi * (CORE * planes.radius) ** 2 * 2 * half
    error = evidence.scatter_at(planes.centre) * np.sqrt(own / (own + volume))
    return np.nan_to_num(values, nan=1.0).mean(axis=1), error
