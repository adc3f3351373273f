"""Find bulges and stenoses within junctions, where no section has a wall all round.

What wall a vessel has there is held against the design's surface. Walls that lie off by w on
average and make up a share s of the circumference 2 π r change the lumen's area by 2 π r s w, which
is a change of 2 s w in the diameter of the circle of the same area: where the lumen opens into
another there is no wall that could lie off. The same average, taken where whole sections were
measured, says how much 2 w scatters in this very scan; with a part of the wall alone it scatters by
one over the root of that part more, and by `RIM` beside a rim. A lumen that lies aside moves
opposite walls oppositely, which a part of the wall doesn't average out: how far it lies aside is
told by the nearest whole sections.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import ndtri

from kernels.arrays import BoolArray, FloatArray, IntArray
from registration.measuring.gauging.closures import is_missing
from registration.measuring.gauging.defect import Defect
from registration.measuring.gauging.on_walls import near_walls
from registration.measuring.gauging.trace import VesselTrace

LEAST_WALL = 0.2
"""Of a section's usual wall: with less there is nothing to average."""
RIM = 1.5
"""Walls scatter by so much more beside a junction's rim, which a blur rounds (by clean junctions of
a third generator: 4.6 of its whole sections' deviations were seen)."""
LEAST_UM = 25.0
"""A smaller change of a diameter isn't told from a junction's rounded rim."""
LEAST_SECTIONS, LEAST_OWN = 10, 5
"""Whole sections of all vessels, to know the scatter; of a vessel, to be its own level."""
ASIDE_SECTIONS = 8
"""Whole sections nearest to an end of a vessel that tell how far it lies aside there."""
_MAD = 1.4826


@dataclass(frozen=True)
class _Walls:
    """The wall's mean change of the diameter at every station of all vessels, in order.

    Attributes
    ----------
    change : (n,) float64, mm
        NaN without wall.
    points : (n,) int64
        Surface points it is the mean of.
    """

    change: FloatArray
    points: IntArray


def find_junction_changes(
    traces: tuple[VesselTrace, ...],
    wall: FloatArray,
    deviation_mm: FloatArray,
    false_alarm: float,
) -> list[Defect]:
    """Find runs of stations without a whole section whose wall stands out from the rest.

    Parameters
    ----------
    traces : tuple of VesselTrace
    wall : (n, 3) float64, mm
        Points of the scanned surface that were seen, away from sharp edges; part frame.
    deviation_mm : (n,) float64, mm
        Of those, positive where the lumen reaches beyond the design.
    false_alarm : float
        Probability, at most, that a clean scan shows one.
    """
    whole = np.concatenate([trace.counted & (trace.diameter > 0) for trace in traces])
    free = ~_in_closed(traces, wall)
    wall, deviation_mm = wall[free], deviation_mm[free]
    walls = _walls(traces, wall, deviation_mm, whole)
    whole &= np.isfinite(walls.change)
    if whole.sum() < LEAST_SECTIONS:
        return []
    radius = np.concatenate([trace.radius for trace in traces])
    usual = float(np.median(walls.points[whole] / radius[whole]))
    every, spread = _level_and_spread(walls.change[whole])
    least = float(ndtri(1 - false_alarm / (2 * max(1, int((~whole).sum())))))
    ends = np.cumsum([len(trace.along) for trace in traces])
    out = []
    for trace, last in zip(traces, ends.tolist(), strict=True):
        here = slice(last - len(trace.along), last)
        own = walls.change[here][whole[here]]
        share = np.minimum(walls.points[here] / (usual * trace.radius), 1.0)
        error = RIM * spread / np.sqrt(np.maximum(share, LEAST_WALL))
        level = float(np.median(own)) if len(own) >= LEAST_OWN else every
        asked = trace.seen & ~trace.own & (share >= LEAST_WALL)
        asked &= trace.to_end > 2 * trace.radius  # a mouth's rim is no junction
        off = np.where(asked, _lesser(walls.change[here], level, every), 0.0)
        far = (np.abs(off) > least * error) & (np.abs(off) > 1e-3 * LEAST_UM)
        out += _defects(trace, off, error, np.where(far, share, 0.0))
    return out


def _in_closed(traces: tuple[VesselTrace, ...], wall: FloatArray) -> BoolArray:
    """Whether wall points lie within the designed lumen of a vessel where that is closed, (n,).

    The gel that closes it ends the lumens it would lead into; their own walls don't.
    """
    inside = np.zeros(len(wall), dtype=np.bool_)
    for trace in traces:
        for station in np.flatnonzero(_closed(trace)).tolist():
            away = np.linalg.norm(wall - trace.centre[station], axis=1)
            inside |= away < trace.radius[station]
    return inside


def _closed(trace: VesselTrace) -> BoolArray:
    """Closed stations, and the junctions that they reach: only others' lumens are free in them."""
    if is_missing(trace):
        return np.ones(len(trace.along), dtype=np.bool_)
    closed = trace.seen & ~trace.sections.open
    borders = np.flatnonzero(np.diff(trace.own.astype(np.int8))) + 1
    for run in np.split(np.arange(len(closed)), borders):
        if not trace.own[run[0]] and closed[max(run[0] - 1, 0) : run[-1] + 2].any():
            closed[run] = True
    return np.asarray(closed)


def _walls(
    traces: tuple[VesselTrace, ...], wall: FloatArray, off: FloatArray, whole: BoolArray
) -> _Walls:
    """Mean of 2 w over the wall nearest to each station, within half a radius of the design's.

    A vessel's last station is the nearest to all that lies beyond its end, as the far side of the
    joint: walls count between a station's neighbours alone.
    """
    centre = np.concatenate([trace.centre for trace in traces])
    radius = np.concatenate([trace.radius for trace in traces])
    tangent = np.concatenate([_tangents(trace.centre) for trace in traces])
    half = np.concatenate([np.full(len(trace.along), trace.spacing / 2) for trace in traces])
    which, near = near_walls(centre, radius, wall)
    along = ((wall - centre[which]) * tangent[which]).sum(axis=1)
    near &= np.abs(along) <= half[which] * (1 + 1e-6)
    which, off = which[near], off[near]
    normal = wall[near] - centre[which]
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-9)
    off = off - (normal * _aside(traces, normal, off, which, whole)[which]).sum(axis=1)
    count = np.bincount(which, minlength=len(centre))
    total = np.bincount(which, 2 * off, len(centre))
    with np.errstate(invalid="ignore", divide="ignore"):
        return _Walls(total / count, count.astype(np.int64))


def _tangents(centre: FloatArray) -> FloatArray:
    """Unit vectors along an axis of (n, 3) points, (n, 3); 0 of a single point."""
    if len(centre) < 2:
        return np.zeros_like(centre)
    way = np.gradient(centre, axis=0)
    return np.asarray(way / np.linalg.norm(way, axis=1, keepdims=True))


def _aside(
    traces: tuple[VesselTrace, ...],
    normal: FloatArray,
    off: FloatArray,
    which: IntArray,
    whole: BoolArray,
) -> FloatArray:
    """How far the lumen lies aside of the design at each station, (n, 3), mm.

    Least squares of w = mean + normal · aside over the nearest whole sections of either half of a
    vessel; 0 with fewer than `LEAST_OWN`. Along a straight vessel it isn't known, and 0.
    """
    out, first = np.zeros((len(whole), 3)), 0
    for trace in traces:
        stations = np.arange(first, first + len(trace.along))
        first += len(stations)
        known = stations[whole[stations]]
        if len(known) < LEAST_OWN:
            continue
        halves = np.array_split(stations, 2)
        for half, used in zip(
            halves, (known[:ASIDE_SECTIONS], known[-ASIDE_SECTIONS:]), strict=True
        ):
            chosen = np.isin(which, used)
            terms = np.column_stack([np.ones(chosen.sum()), normal[chosen]])
            out[half] = np.linalg.lstsq(terms, off[chosen], rcond=1e-3)[0][1:]
    return out


def _lesser(change: FloatArray, own: float, every: float) -> FloatArray:
    """Deviation from the vessel's level or the print's, the lesser; 0 between the two.

    Where a whole vessel is off, a wall that it shares with another needn't be.
    """
    from_own, from_every = change - own, change - every
    lesser = np.where(np.abs(from_own) < np.abs(from_every), from_own, from_every)
    return np.asarray(np.where(from_own * from_every > 0, lesser, 0.0))


def _level_and_spread(change: FloatArray) -> tuple[float, float]:
    """Median, and standard deviation of a station with its whole wall, robustly, mm."""
    level = float(np.median(change))
    return level, max(_MAD * float(np.median(np.abs(change - level))), 1e-3)


def _size(off: FloatArray, error: FloatArray, worst: int, first: int, last: int) -> float:
    """Return the mean over the surest station of a run and neighbours that noise sets apart, mm.

    The largest of several is the one that noise made so; a neighbour within the difference's
    95 % is as good.
    """
    near = np.arange(max(first, worst - 1), min(last, worst + 2))
    apart = np.abs(off[near] - off[worst])
    near = near[apart <= 1.96 * np.hypot(error[near], error[worst])]
    return float(np.average(off[near], weights=error[near] ** -2))


def _defects(
    trace: VesselTrace, off: FloatArray, error: FloatArray, share: FloatArray
) -> list[Defect]:
    """Runs of stations that stand out; ``share`` is the part of the wall there, elsewhere 0."""
    sign = np.where(share > 0, np.sign(off), 0).astype(np.int64)
    edges = np.flatnonzero(np.diff(sign, prepend=0, append=0))
    out = []
    for first, last in zip(edges[:-1].tolist(), edges[1:].tolist(), strict=True):
        if sign[first] == 0:
            continue
        worst = first + int(np.argmax(np.abs(off[first:last]) / error[first:last]))
        change = _size(off, error, worst, first, last)
        size = float(share[worst]) * change
        out.append(
            Defect(
                kind="bulge" if change > 0 else "stenosis",
                vessel=trace.vessel,
                other=None,
                from_mm=float(first * trace.spacing),
                to_mm=float(last * trace.spacing),
                at_mm=float(trace.along[worst]),
                point_mm=tuple(trace.centre[worst].tolist()),
                size_um=1e3 * size,
                error_um=1.96e3 * float(share[worst] * error[worst]),
                percent=100 * size / (2 * float(trace.radius[worst])),
                wall_um=500 * change,
                significance=abs(change) / float(error[worst]),
                seen=True,
            )
        )
    return out
