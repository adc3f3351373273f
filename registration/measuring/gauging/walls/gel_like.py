"""Judge open sections as gel, liquid or not seen (films, weak gel, sediment)."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter1d, uniform_filter1d

from design.geometry.polyline import places_along
from design.network import VesselNetwork
from kernels.arrays import BoolArray, FloatArray
from registration.alignment import Fit
from registration.measuring.gauging.trace import VesselTrace
from registration.segmentation import GelEvidence, are_separable
from registration.segmentation.evidence import SIGMA_MM

# The mean evidence within 0.7 radii of the axis is held against both gel (1) and liquid. A section
# is called open only where gel is rejected, closed only where liquid is; else it isn't seen.
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
        Places that lack gel as a leak does, but aren't open all along as far as the scan tells.
    blur_um : float, µm
        Standard deviation of the scan's walls, smoothing included; NaN where not known.
    leak_um : float, µm
        Narrower leaks may not show.
    """

    liquid: float
    untold: float
    examined: float
    unresolved: int = 0
    blur_um: float = float("nan")
    leak_um: float = float("nan")


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


LEAST_SHARE = 0.2
"""Of the step from liquid to gel, in the mean over the core, above the vessel's own quiet liquid.
As bright voxels are capped, what scatters a tenth as much as gel has 0.15, a fifth 0.26. Clear
lumens vary by 0.01 to 0.02, a gradient of cells from 2 to 12 % of gel by 0.12; a film of 30 µm at
20 µm voxels has 0.6."""
LEAST_OF_HALF = 0.12
"""More in one half of the core than in the other, over `HALF_MM`: sediment or debris along a
lumen's bottom. What brightens or darkens liquid elsewhere does so on both sides: gel above that
scatters a tenth of its light on lifts the upper half of a lumen 1 mm wide by 0.05, a fifth of it by
0.105, speckle either by 0.04 (sound scans of two generators); debris with 0.15 of the gel's
brightness lifts it by 0.15 to 0.19."""
LEAST_OF_ALL = 0.35
"""The same above the other vessels' liquid, for what fills a vessel all along."""
HALF_MM = 0.5
_LONG_MM = 0.15
"""What is no film is averaged over this length: a quarter of gel is speckle voxel by voxel."""
_SPREADS = 6.0
"""Standard deviations of the quiet part, which are much where contrast is low."""
_MOST_OF_CORE = 0.7
"""Share of the core that must be brightened by half of that: a bubble's rim covers less."""
_NARROWED = 0.6
"""Of the designed diameter: a section as narrow as that is no doubt, but a stenosis."""
_CORE = 0.5
"""Of the lumen's radius: clear of walls and of their blur."""
_BEYOND_MM = (0.1, 0.3)
"""From a mouth on this stretch tells the bath. It looks bright beside a part that takes light away,
and a mouth's last voxels hold some of it."""
_MOUTH_VOXELS = 2.5
_QUIET, _QUIETEST = 20, 5
"""Percentiles of a vessel's profile: its quiet liquid, though most of it be filled."""
_QUIET_SPREADS, _QUIET_BELOW = 0.80, 0.84
"""Standard deviations of a normal distribution between these two, and up to its middle."""
_NOISE = 0.05
"""By how much noise may lift a quiet profile."""
_MAD = 1.4826
"""Standard deviation over median absolute deviation, of normal noise."""
_TILTS = (0.0, 0.4, 0.8)
"""Slopes of a film against the section, from square to the axis to that of a slanted face."""
_ANGLE = 2 * np.pi * np.arange(12) / 12
_CIRCLE = np.stack([np.cos(_ANGLE), np.sin(_ANGLE)], axis=1)
_PATTERN = np.concatenate([np.zeros((1, 2)), 0.5 * _CIRCLE[::2], _CIRCLE])
_ACROSS = 0.75
"""Of the lumen's radius that a strand has to cross; less where walls are blurred farther in."""
_STRAND, _STRAND_DIMMEST = 0.35, 0.1
"""Of the step from liquid to gel, in the mean along a strand and at its dimmest place. A bubble's
rim and what clings to one wall are dark at one end at least."""
_STRAND_MM = 0.075
"""Averaged along the vessel: the thinnest strand."""


def _chords() -> FloatArray:
    """Points (8 directions, 5 offsets, 5 places, 2) on chords of the unit disc."""
    turn = np.pi * np.arange(8) / 8
    along = np.stack([np.cos(turn), np.sin(turn)], axis=1)[:, None, None]
    aside = np.stack([-np.sin(turn), np.cos(turn)], axis=1)[:, None, None]
    off = np.linspace(-0.7, 0.7, 5)[None, :, None, None]
    place = np.linspace(-1.0, 1.0, 5)[None, None, :, None]
    return np.asarray(off * aside + place * np.sqrt(1 - off**2) * along)


_CHORDS = _chords()


def without_gel_like(
    network: VesselNetwork, traces: tuple[VesselTrace, ...], evidence: GelEvidence, fit: Fit
) -> tuple[VesselTrace, ...]:
    """Return traces in which open sections whose core is partly like gel are `gel_like`, not seen.

    Parameters
    ----------
    network : VesselNetwork
        The design.
    traces : tuple of VesselTrace
        One a vessel.
    evidence : GelEvidence
        Of the scan.
    fit : Fit
        Scan to part, with which the traces were made.
    """
    step = float(evidence.voxel_mm.min()) / 2
    along = [np.arange(0.0, trace.length + step, step) for trace in traces]
    cores = [
        _core(trace, evidence, fit, at) if _looked_at(trace) else None
        for trace, at in zip(traces, along, strict=True)
    ]
    if all(core is None for core in cores):
        return traces
    own = np.array([_quiet(core) for core in cores])
    liquid = float(np.nanpercentile(own, 25))
    own = np.fmin(own, liquid + (LEAST_OF_ALL - LEAST_SHARE) * (1 - liquid))
    liquids = (
        np.maximum(_usual(network, trace, at, own), _bath(trace, at, evidence, fit))
        for trace, at in zip(traces, along, strict=True)
    )
    return tuple(
        trace
        if core is None
        else _marked(
            trace,
            at,
            _brightened(core, usual, step, trace) | _strands(trace, evidence, fit, at, usual),
        )
        for trace, at, core, usual in zip(traces, along, cores, liquids, strict=True)
    )


def _quiet(core: FloatArray | None) -> float:
    return float("nan") if core is None else float(np.percentile(core.mean(axis=1), _QUIET))


def _usual(
    network: VesselNetwork, trace: VesselTrace, along: FloatArray, own: FloatArray
) -> FloatArray:
    """Liquid along a vessel, (n,): its own; in junctions the brightest that meets there."""
    usual = np.full(len(along), own[trace.vessel])
    clear = trace.along[trace.apart]
    ends = (clear[0], clear[-1]) if len(clear) else (trace.length / 2, trace.length / 2)
    half = trace.spacing / 2
    within = along < ends[0] - half, along > ends[1] + half
    for node, inside in zip(network.vessel_nodes[trace.vessel], within, strict=True):
        meeting = (network.vessel_nodes == node).any(axis=1)
        usual[inside] = np.nanmax(own[meeting])
    return usual


def _looked_at(trace: VesselTrace) -> bool:
    return len(trace.along) > 1 and bool((trace.seen & trace.sections.open).any())


def _marked(trace: VesselTrace, at: FloatArray, bright: BoolArray) -> VesselTrace:
    """Mark the sections that a brightened stretch lies in."""
    sound = trace.seen & trace.sections.open
    narrow = trace.counted & (trace.sections.diameter < _NARROWED * 2 * trace.radius)
    narrowed = trace.seen & (~trace.sections.open | narrow)
    ends = trace.spacing * np.arange(len(trace.along) + 1)
    marked = np.zeros(len(trace.along), dtype=np.bool_)
    for first, last in at[_stretches(bright)]:
        touched = (ends[:-1] <= last) & (ends[1:] >= first)
        # What closes or narrows a section is judged by that, and so are its blurred edges.
        beside = touched | np.roll(touched, 1) | np.roll(touched, -1)
        if not (beside & narrowed).any():
            marked |= touched
    marked &= sound & (trace.to_end > -trace.spacing)
    return replace(
        trace, gel_like=marked, seen=trace.seen & ~marked, counted=trace.counted & ~marked
    )


def _stretches(bright: BoolArray) -> NDArray[np.intp]:
    """First and last sample of each, (n, 2)."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], bright, [False]]).astype(np.int8)))
    return edges.reshape(-1, 2) - np.array([0, 1])


def _core(
    trace: VesselTrace,
    evidence: GelEvidence,
    fit: Fit,
    along: FloatArray,
    pattern: FloatArray = _CORE * _PATTERN,
) -> FloatArray:
    """Evidence for gel in the lumen as measured, (n, points); 0 out of the scan.

    `pattern`: (points, 2), in radii of the lumen; its middle.
    """
    known = trace.counted & trace.sections.open & np.isfinite(trace.sections.shift).all(axis=1)
    shift, radius = np.zeros((len(along), 2)), np.interp(along, trace.along, trace.radius)
    if known.any():
        measured = np.interp(along, trace.along[known], trace.sections.diameter[known] / 2)
        radius = np.minimum(radius, measured)
        for axis in range(2):
            shift[:, axis] = np.interp(along, trace.along[known], trace.sections.shift[known, axis])
    # Stations are the sections' middles: the axis goes on half a section at each end.
    # It is looked along beyond its ends, too.
    reach = (_BEYOND_MM[1] + trace.spacing / 2) / trace.spacing
    ends = trace.centre[[0, -1]] + reach * (trace.centre[[0, -1]] - trace.centre[[1, -2]])
    line = np.concatenate([ends[:1], trace.centre, ends[1:]])
    at = np.concatenate([[-_BEYOND_MM[1]], trace.along, [trace.length + _BEYOND_MM[1]]])
    axis_points = places_along(line, at, along)
    flat = shift[:, None] + radius[:, None, None] * pattern
    across = trace.planes.across[_nearest(trace, along)]
    places = fit.invert(axis_points)[:, None] + flat @ across
    return np.nan_to_num(evidence.fine_at(places))


def _nearest(trace: VesselTrace, along: FloatArray) -> NDArray[np.int64]:
    """Return the stations in whose stretches places along a vessel lie, (n,)."""
    return np.clip((along / trace.spacing).astype(np.int64), 0, len(trace.along) - 1)


def _bath(trace: VesselTrace, along: FloatArray, evidence: GelEvidence, fit: Fit) -> FloatArray:
    """Bath in the last voxels before a vessel's mouths, (n,); 0 elsewhere."""
    levels, reach = np.zeros(len(along)), _MOUTH_VOXELS * float(evidence.voxel_mm.max())
    from_end = along, trace.length - along
    beyond = np.linspace(*_BEYOND_MM, 9)
    mouth = trace.to_end[[0, -1]] < trace.spacing
    for free, at, away in zip(mouth, (-beyond, trace.length + beyond), from_end, strict=True):
        if free and len(trace.along) > 1:
            levels[away < reach] = np.median(_core(trace, evidence, fit, at).mean(axis=1))
    return levels


def _brightened(core: FloatArray, usual: FloatArray, step: float, trace: VesselTrace) -> BoolArray:
    """Samples along a vessel whose core something brightens over the usual liquid, (n,)."""
    least = float(usual.min())
    if least >= 1:
        return np.zeros(len(core), dtype=np.bool_)
    share = (core - usual[:, None]) / (1 - least)
    size, half_size = (int(length / step) | 1 for length in (_LONG_MM, HALF_MM))
    long = _lit(uniform_filter1d(share, size, axis=0, mode="nearest"))
    halves = uniform_filter1d(share, half_size, axis=0, mode="nearest") @ _OPPOSED
    noise = (
        _MAD * float(np.median(np.abs(halves - np.roll(halves, half_size, axis=0)))) / np.sqrt(2)
    )
    half = halves.max(axis=1)
    # In a junction halves aren't alike by design, nor where light goes past a mouth's upright face.
    clear = trace.own & (trace.to_end >= HALF_MM / 2)
    half[~clear[_nearest(trace, step * np.arange(len(core), dtype=np.float64))]] = 0.0
    film = _films(share, _CORE * float(trace.radius.mean()) / step)
    own = usual == least
    return (
        _stands_out(film, own, LEAST_SHARE)
        | _stands_out(long, own, LEAST_SHARE)
        | (half > max(LEAST_OF_HALF, _SPREADS * noise))
    )


def _strands(
    trace: VesselTrace, evidence: GelEvidence, fit: Fit, along: FloatArray, usual: FloatArray
) -> BoolArray:
    """Samples at which gel reaches across the lumen from wall to wall, (n,), clear of its ends."""
    least, radius = float(usual.min()), float(np.median(trace.radius))
    clear = trace.own & (trace.to_end >= HALF_MM / 2)
    # A wall's blur reaches two voxels in.
    reach = min(_ACROSS, 1 - 2 * float(evidence.voxel_mm.max()) / radius)
    if least >= 1 or reach < _CORE or not clear.any():
        return np.zeros(len(along), dtype=np.bool_)
    pattern = reach * _CHORDS.reshape(-1, 2)
    share = (_core(trace, evidence, fit, along, pattern) - usual[:, None]) / (1 - least)
    size = int(_STRAND_MM / (along[1] - along[0])) | 1
    share = uniform_filter1d(share, size, axis=0, mode="nearest")
    chords = share.reshape(len(share), -1, _CHORDS.shape[2])
    mean = chords.mean(axis=2)
    noise = _MAD * float(np.median(np.abs(mean - np.median(mean))))
    lit = (mean > max(_STRAND, _SPREADS * noise)) & (chords.min(axis=2) > _STRAND_DIMMEST)
    return np.asarray(lit.any(axis=1) & clear[_nearest(trace, along)])


_SIDES = (_PATTERN @ _CIRCLE.T > 0.1).astype(np.float64)
_HALVES = _SIDES / _SIDES.sum(axis=0)
_OPPOSED = _HALVES - np.roll(_HALVES, len(_ANGLE) // 2, axis=1)
"""Weights of the pattern's points, (points, 12): mean of one side of its middle less the other."""


def _stands_out(value: FloatArray, own: BoolArray, least: float) -> BoolArray:
    """Where a profile exceeds its own quiet part by `least` and by `_SPREADS` of its deviations.

    Both are told from the lower quantiles over `own` samples, which what lies in the lumen leaves
    alone. By `_NOISE` at most the quiet part lies above the usual liquid.
    """
    quietest, quiet = np.percentile(value[own], [_QUIETEST, _QUIET])
    spread = (quiet - quietest) / _QUIET_SPREADS
    middle = np.clip(quiet + _QUIET_BELOW * spread, 0.0, _NOISE)
    return np.asarray(value > middle + max(least, _SPREADS * spread))


def _lit(share: FloatArray) -> FloatArray:
    """Mean over the core, or twice what `_MOST_OF_CORE` of it exceeds if that is less, (n,)."""
    dim = np.quantile(share, 1 - _MOST_OF_CORE, axis=1, method="lower")
    return np.asarray(np.minimum(share.mean(axis=1), 2 * dim))


def _films(share: FloatArray, reach: float) -> FloatArray:
    """The brightest plane across the core at each sample, square to the axis or tilted, (n,)."""
    best = _lit(share)
    # No tilted mean exceeds that of the brightest samples in reach.
    most = maximum_filter1d(share, 2 * int(np.ceil(max(_TILTS) * reach)) + 1, axis=0)
    if most.mean(axis=1).max() <= LEAST_SHARE:
        return best
    for slope in _TILTS[1:]:
        for towards in _CIRCLE:
            moved = np.rint(slope * reach * (_PATTERN @ towards)).astype(np.int64)
            rows = np.clip(np.arange(len(share))[:, None] + moved, 0, len(share) - 1)
            best = np.maximum(best, _lit(np.take_along_axis(share, rows, axis=0)))
    return best
