"""Measure the designed lumen in the planes in which the scan's sections are cut.

A network's radii are those of straight tubes: where an axis bends, where tubes meet or end, the
designed surface is wider or missing. What a section is compared with is that surface, along the
same rays.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from kernels.arrays import FloatArray
from registration.alignment import Fit
from registration.alignment.distance import ModelSurface
from registration.measuring.gauging.sections import LEAST_MET, RAYS, REACH
from registration.measuring.gauging.trace import VesselTrace

NEAR_MM = 1e-4
"""A ray has met the wall when it is so near to it."""
MOST_STEPS = 40
"""A ray that runs along a wall stops after so many steps, where it is."""


def with_designed_walls(
    traces: Sequence[VesselTrace], fit: Fit, surface: ModelSurface, is_lumen: bool
) -> tuple[VesselTrace, ...]:
    """Return traces whose designed walls are those of the designed surface.

    Parameters
    ----------
    traces : sequence of VesselTrace
    fit : Fit
        Scan to part, with which the traces were made.
    surface : ModelSurface
        The design: the part, or its lumens (`is_lumen`).
    """
    if not traces:
        return ()
    angle = 2 * np.pi * np.arange(RAYS) / RAYS
    circle = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    centre = np.concatenate([_middles(trace, fit, surface, is_lumen) for trace in traces])
    across = np.concatenate([trace.planes.across for trace in traces]) @ fit.rotation.T
    reach = REACH * np.concatenate([trace.radius for trace in traces])
    walls = cast_rays(surface, is_lumen, centre, circle @ across, reach)
    ends = np.cumsum([len(trace.along) for trace in traces])[:-1]
    return tuple(
        _compared(trace, wall) for trace, wall in zip(traces, np.split(walls, ends), strict=True)
    )


def _middles(trace: VesselTrace, fit: Fit, surface: ModelSurface, is_lumen: bool) -> FloatArray:
    """Return where the scan's rays start, (n, 3), part frame, mm; the axis where that is in gel.

    Beside a bend or a joint a section is no circle: what its rays miss, and so its width, depends
    on where they start.
    """
    aside = (trace.sections.shift[:, None] @ trace.planes.across)[:, 0]
    aside[~trace.sections.closed_outline] = 0.0
    middles = fit.apply(trace.planes.centre + aside)
    free = surface.query(middles).distance * (-1.0 if is_lumen else 1.0)
    return np.where((free > NEAR_MM)[:, None], middles, trace.centre)


def _compared(trace: VesselTrace, wall: FloatArray) -> VesselTrace:
    """Return the trace with its designed walls; open sections without any all round don't count.

    Of those what wall there is is looked at as within a junction.
    """
    whole = np.isfinite(wall).mean(axis=1) >= LEAST_MET
    comparable = whole | trace.short | ~trace.sections.open
    return replace(trace, wall=wall, counted=trace.counted & comparable, own=trace.own & comparable)


def cast_rays(
    surface: ModelSurface, is_lumen: bool, centre: FloatArray, way: FloatArray, reach: FloatArray
) -> FloatArray:
    """Return how far the designed wall lies along each ray, (n, r), mm; NaN beyond `reach`.

    No wall is nearer than the distance to the surface, so that a ray may go on by it.

    Parameters
    ----------
    centre : (n, 3) float64, mm
        Where the rays start.
    way : (n, r, 3) float64
        Their unit directions.
    reach : (n,) float64, mm
    """
    free = -1.0 if is_lumen else 1.0
    count = way.shape[1]
    first = surface.query(centre)
    step = np.repeat(free * first.distance, count)
    guess = np.repeat(first.face, count)
    out = np.maximum(step, 0.0)
    start, way = np.repeat(centre, count, axis=0), way.reshape(-1, 3)
    most = np.repeat(reach, count)
    going = np.flatnonzero((step > NEAR_MM) & (out <= most))
    for _ in range(MOST_STEPS):
        if not len(going):
            break
        near = surface.query(start[going] + out[going, None] * way[going], guess[going])
        step, guess[going] = free * near.distance, near.face
        out[going] += step
        going = going[(step > NEAR_MM) & (out[going] <= most[going])]
    return np.where(out <= most, out, np.nan).reshape(-1, count)
