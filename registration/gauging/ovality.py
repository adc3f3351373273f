"""Measure how oval a lumen is: its longest less its shortest width, where that is greatest.

A wall r₀ + Re(c e^{2iφ}) is 2 (r₀ + |c|) by 2 (r₀ - |c|) wide. One section's c is mostly noise,
and the length of noise isn't zero: c is averaged, as a vector, over `WINDOW` diameters.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from registration.gauging.sections import RAYS
from registration.gauging.trace import VesselTrace
from registration.uncertainty import ScanErrors, SectionErrors, coverage_factor

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
    rays = trace.sections.rays[counted]
    mean = np.nanmean(np.where(whole[:, None], rays, 1.0), axis=1, keepdims=True)
    turned = np.where(np.isfinite(rays), rays, mean) @ _TWICE
    vector = 2 * turned / RAYS
    # Reflections may be of the walls alone that face the light, both of them. A line's place is the
    # mean over walls of three directions, which the difference of two exceeds √(3 · 3/2) times.
    walls = 2 * (errors.faint_mm + errors.facing_mm), 2 * np.sqrt(4.5) * errors.line_mm
    best = Oval(np.nan, np.nan, np.nan)
    for k in [] if trace.short else np.flatnonzero(whole).tolist():
        reach = WINDOW * trace.radius[counted[k]]
        near = whole & (np.abs(trace.along[counted] - trace.along[counted[k]]) <= reach)
        weights = near / near.sum()
        noise = np.sqrt(8) * own.averaged(weights)
        widths = np.sqrt(max((4 * abs(weights[near] @ vector[near])) ** 2 - 2 * noise**2, 0.0))
        if not 1e3 * widths <= best.widths_um:
            stretched = 2 * trace.radius[counted[k]] * errors.depth
            half = coverage_factor(np.inf) * float(np.linalg.norm([noise, stretched, *walls]))
            best = Oval(1e3 * float(widths), 1e3 * half, float(trace.along[counted[k]]))
    return best
