"""Measure how oval a lumen is: its longest less its shortest width, where that is greatest.

A wall r₀ + Re(c e^{2iφ}) is 2 (r₀ + |c|) by 2 (r₀ - |c|) wide. One section's c is mostly noise,
and the length of noise isn't zero: c is averaged, as a vector, over `WINDOW` diameters.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from registration.alignment.uncertainty import ScanErrors, SectionErrors, coverage_factor
from registration.measuring.gauging.sections import RAYS
from registration.measuring.gauging.trace import VesselTrace

WINDOW = 2.0
"""Diameters: of an oval of 2 : 1 over a third of them 0.24 diameters are left, beyond the 0.2 of a
± 10 % limit; the noise of single sections would pass for as much in lumens of 0.4 mm."""

_TWICE = np.exp(-4j * np.pi * np.arange(RAYS) / RAYS)


@dataclass(frozen=True)
class Oval:
    """Where a lumen is most oval; NaN where no section is whole.

    Attributes
    ----------
    widths_um, u_um : float, µm
        Longest less shortest width, and half width of its 95 % interval.
    at_mm : float, mm
        From the first node.
    """

    widths_um: float
    u_um: float
    at_mm: float


def ovality(trace: VesselTrace, own: SectionErrors, errors: ScanErrors) -> Oval:
    """Return where a lumen is most oval.

    Each component of c has half the variance of the diameter, and the widths differ by 4 |c|.
    Walls across the light err by reflections and index as those along it don't.

    Parameters
    ----------
    trace : VesselTrace
    own : SectionErrors
        Of its counted sections.
    errors : ScanErrors
    """
    counted = np.flatnonzero(trace.counted)
    whole = trace.sections.closed_outline[counted] & own.open
    best = Oval(np.nan, np.nan, np.nan)
    if trace.short or not whole.any():
        return best
    rays = trace.sections.rays[counted]
    mean = np.nanmean(np.where(whole[:, None], rays, 1.0), axis=1, keepdims=True)
    vector = 2 / RAYS * (np.where(np.isfinite(rays), rays, mean) @ _TWICE)
    along, radius = trace.along[counted], trace.radius[counted]
    first, last = along[whole][[0, -1]]
    # Reflections may be of the walls alone that face the light, both of them. A line's place is the
    # mean over walls of three directions, which the difference of two exceeds √(3 · 3/2) times.
    walls = 2 * (errors.faint_mm + errors.facing_mm), 2 * np.sqrt(4.5) * errors.line_mm
    for k in np.flatnonzero(whole).tolist():
        # The window stays within the vessel: fewer sections at its ends would be noisier.
        reach = min(WINDOW * radius[k], (last - first) / 2)
        middle = float(np.clip(along[k], first + reach, last - reach))
        near = whole & (np.abs(along - middle) <= reach + 1e-9)
        weights = near / near.sum()
        noise = np.sqrt(8) * own.averaged(weights)
        widths = np.sqrt(max((4 * abs(weights[near] @ vector[near])) ** 2 - 2 * noise**2, 0.0))
        if not 1e3 * widths <= best.widths_um:
            terms = [noise, 2 * radius[k] * errors.depth, *walls]
            half = coverage_factor(np.inf) * float(np.linalg.norm(terms))
            best = Oval(1e3 * float(widths), 1e3 * half, middle)
    return best
