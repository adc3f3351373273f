"""Measure the sections of a vessel's mouth by what part of their wall lies in the gel.

The face cuts sections off where a vessel leaves the part at a slant, and rounds the last of every
vessel. What wall there is lies at r(φ) = ρ(φ) + δ + a cos φ + b sin φ from the middle of the
nearest whole sections, ρ their outline: δ is the change of the radius, (a, b) how far the lumen
lies aside of there. Part of a turn tells these apart badly; how far the lumen wanders over such a
length, by its whole sections, is the prior of a and b.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from kernels.arrays import BoolArray, FloatArray, IntArray
from registration.alignment import Fit
from registration.alignment.distance import ModelSurface
from registration.measuring.gauging.sections import (
    RAYS,
    Planes,
    independent_rays,
    true_diameter,
    wall_distances,
)
from registration.measuring.gauging.trace import VesselTrace
from registration.segmentation import GelField, Segmentation

LEAST_ARC = 0.5
"""Of a turn: there the free a and b make δ's standard error 2.3 times that of known ones, at a
third of a turn 5 times."""
NEAREST = 3
"""Whole sections whose outline and middle are carried on into the mouth."""
LEAST_WHOLE = 5
"""Whole sections of a vessel, to know how far it wanders."""
_ANGLE = 2 * np.pi * np.arange(RAYS) / RAYS
_CIRCLE = np.stack([np.cos(_ANGLE), np.sin(_ANGLE)], axis=1)


def with_mouths(
    traces: Sequence[VesselTrace],
    segmentation: Segmentation,
    fit: Fit,
    part: ModelSurface | None,
) -> tuple[VesselTrace, ...]:
    """Return traces with diameters in the mouths of their vessels.

    `part` is the designed part, in whose frame `fit` lays the scan; without it (lumens alone)
    nothing changes. A section with half of its wall in the designed gel should be measured, and
    so should a stretch longer than the radius with less of it.
    """
    if part is None:
        return tuple(traces)
    out = []
    for trace in traces:
        whole = np.flatnonzero(trace.counted & trace.sections.closed_outline)
        if not trace.short and len(whole) >= LEAST_WHOLE:
            for stations in _mouths(trace):
                told = _in_gel(trace, stations, segmentation.field, fit, part)
                trace = _measured(trace, stations, whole, told, segmentation)
        out.append(trace)
    return tuple(out)


def _mouths(trace: VesselTrace) -> Iterator[IntArray]:
    """Stations between each free end and the first that lies clear of it, outermost first.

    And that one, where the face still cuts it off.
    """
    every = np.arange(len(trace.along))
    for stations in (every, every[::-1]):
        clear = int(np.argmax(trace.apart[stations]))
        first = stations[clear]
        if clear and trace.to_end[stations[0]] < trace.to_end[first]:
            yield stations[: clear + bool(trace.seen[first] and not trace.counted[first])]


def _in_gel(
    trace: VesselTrace, stations: IntArray, field: GelField, fit: Fit, part: ModelSurface
) -> BoolArray:
    """Which rays meet a wall by design, with gel behind it and farther out, (n, `RAYS`)."""
    # Smoothing, and light that comes past an upright face, move walls nearer to it (up to 17 %
    # of 0.4 mm at 2 voxels): as whole sections (`trace`), rays keep twice that.
    border = 2 * float(field.voxel_mm.max())
    across = trace.planes.across[stations] @ fit.rotation.T
    along = np.cross(across[:, 0], across[:, 1])
    outwards = along * np.where(stations < len(trace.along) / 2, -1.0, 1.0)[:, None]
    reach = (trace.radius[stations] + border)[:, None, None]
    behind = trace.centre[stations][:, None] + reach * (_CIRCLE @ across)
    places = np.stack([behind, behind + 2 * border * outwards[:, None]])
    distance = part.query(places.reshape(-1, 3)).distance.reshape(places.shape[:-1])
    return np.asarray((distance < 0).all(axis=0))


def _measured(
    trace: VesselTrace,
    stations: IntArray,
    whole: IntArray,
    told: BoolArray,
    segmentation: Segmentation,
) -> VesselTrace:
    """Return the trace with diameters in a mouth, where enough of the wall was met."""
    field, old = segmentation.field, trace.sections
    nearest = whole[np.argsort(np.abs(whole - stations[-1]), kind="stable")[:NEAREST]]
    middle = np.median(old.shift[nearest], axis=0)
    planes = Planes(
        trace.planes.centre[stations], trace.planes.across[stations], trace.radius[stations]
    )
    rays = wall_distances(field, planes, np.tile(middle, (len(stations), 1)), _CIRCLE)
    rays = np.where(told, rays, np.nan)
    met = np.isfinite(rays).mean(axis=1)
    outline = _outline(old.rays[nearest])
    aside = _wander(old.shift[whole], len(stations))
    count = independent_rays(trace.radius[whole], field.blur_mm)
    usual = float(np.median(old.noise[whole] / 2 * np.sqrt(count - 5.0)))  # `sections._shape`
    arc = (met >= LEAST_ARC) & trace.seen[stations] & old.open[stations]
    diameter, noise, shift, drawn = (
        values.copy() for values in (old.diameter, old.noise, old.shift, old.rays)
    )
    for k in np.flatnonzero(arc).tolist():
        here = stations[k]
        independent = float(independent_rays(trace.radius[here : here + 1], field.blur_mm)[0])
        change, error = _fitted(rays[k] - outline, aside, usual, independent)
        shift[here] = middle + change[1:]
        diameter[here] = 2 * np.sqrt(np.mean((outline + change[0]) ** 2))
        noise[here] = 2 * error
        drawn[here] = rays[k] - _CIRCLE @ change[1:]
    measured = stations[arc]
    moved = Planes(
        trace.planes.centre[measured], trace.planes.across[measured], trace.radius[measured]
    )
    diameter[measured] = true_diameter(diameter[measured], field, moved)
    offset = np.linalg.norm(shift, axis=1)
    sections = replace(
        old, diameter=diameter, noise=noise, shift=shift, rays=drawn,
        offset=np.where(np.isin(np.arange(len(offset)), measured), offset, old.offset),
    )  # fmt: skip
    counted, own = trace.counted.copy(), trace.own.copy()
    counted[measured] = True
    by_design = told.mean(axis=1)
    cut_off = (by_design > 0) & (by_design < LEAST_ARC)
    long = cut_off.sum() * trace.spacing > trace.radius[stations[0]]
    own[stations] |= (by_design >= LEAST_ARC) | (cut_off & long)
    return replace(trace, sections=sections, counted=counted, own=own)


def _outline(rays: FloatArray) -> FloatArray:
    """Return the mean of outlines (n, `RAYS`) about their middle: harmonics 0 and 2, (`RAYS`,)."""
    mean = np.nanmean(rays, axis=0)
    spectrum = np.fft.rfft(np.where(np.isfinite(mean), mean, np.nanmean(mean)))
    spectrum[[1, *range(3, len(spectrum))]] = 0
    return np.asarray(np.fft.irfft(spectrum, RAYS))


def _wander(shift: FloatArray, stations: int) -> float:
    """Return by how much a coordinate of the middles (n, 2) changes over some stations, RMS."""
    lag = min(stations, len(shift) - 1)
    return float(np.sqrt(np.mean((shift[lag:] - shift[:-lag]) ** 2)))


def _fitted(
    off: FloatArray, aside: float, usual: float, independent: float
) -> tuple[FloatArray, float]:
    """Return δ, a, b of rays off an outline (`RAYS`,), mm, and the standard error of δ.

    `usual` is how much single rays scatter elsewhere, `independent` how many of a whole turn err
    independently, `aside` the prior's standard deviation of a and b.
    """
    known = np.isfinite(off)
    terms = np.column_stack([np.ones(known.sum()), _CIRCLE[known]])
    prior = np.diag([0.0, 1.0, 1.0]) / max(aside, 1e-6) ** 2
    scatter = usual
    for _ in range(2):
        weight = independent / RAYS / max(scatter, 1e-6) ** 2
        normal = weight * terms.T @ terms + prior
        fitted = np.linalg.solve(normal, weight * terms.T @ off[known])
        # A wall that is rougher or no oval here tells less.
        scatter = max(usual, float(np.std(off[known] - terms @ fitted)))
    return fitted, float(np.sqrt(np.linalg.inv(normal)[0, 0]))
