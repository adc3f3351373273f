"""Find where walls lie from the mean light across them, which no speckle moves.

A section's rays stop where a smoothed, capped field crosses halfway: speckle and caps move that by
several micrometres, and by how much depends on the speckle's law. The mean share of gel at a
distance d from the walls, over many sections and before any cap, doesn't. With heights of the wall
spread as a Gaussian about its mean surface (roughness, point spread and voxel: s) it is

    P(d) = liquid + (gel - liquid) (Φ(u) + E φ(u) / s),   u = (d - d₀) / s

where E is the energy of a line that the wall sends back, mm of gel. Without a line d₀ is told to a
micrometre. A line of E below s looks like a wall that lies E further into the liquid. What tells of
it is light above gel's just behind walls that face the light, where a line is strongest. It grows
as E³, so that walls which show none there may still have a line of a fifth of s.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares
from scipy.special import ndtr

from kernels.arrays import FloatArray
from registration.alignment.uncertainty import ScanErrors
from registration.measuring.gauging.trace import VesselTrace
from registration.measuring.gauging.walls.round_walls import with_round_walls
from registration.segmentation import Segmentation

REACH_MM = 0.15
"""Of the profile, to either side of the walls."""
BIN_MM = 0.005
MOST = 240
"""Sections that are looked at, evenly spread."""
FEWEST = 2000
"""Voxels, for a profile."""
FEWEST_BEHIND = 100
"""Voxels just behind walls that face the light, to tell their line."""
GROUPS = 6
"""Of neighbouring sections; what differs between them is chance (delete-a-group jackknife)."""
FLOOR = 0.3
"""Of the gel: what counts beside speckle, or the liquid's few grains would fix the wall's law."""
ALONG_MM = 0.25
"""Outlines are smoothed along a vessel by this standard deviation: one that follows its own
section's speckle would find bright voxels on its one side and dark ones on the other."""
SLANT = np.sqrt(0.5)
"""Walls whose normal has more than this along the light face it, or face away."""
FACING = 0.8
"""The same for walls whose line is looked for."""
LINE, LINE_SPREAD = 0.9, 0.4
"""Light above gel's behind walls that face the light over (E / s)³, E of the mean wall and s of
those, and its relative standard deviation among scans. To first order in E / s a line passes for a
wall that lies elsewhere, to second for a smoother one; only the third shows. 0.8 to 1.6 on five
scans of one generator (E / s 0.4 to 0.6); walls in FRESH, rough by layers (0.3), show next to
nothing, as this says."""
LINES = np.linspace(0.0, 1.5, 601)
"""E / s that a line may have; any is as likely before its light is looked at."""


@dataclass(frozen=True)
class WallProfile:
    """Where a print's walls lie.

    Attributes
    ----------
    place_mm : float, mm
        Of the mean surface beyond the measured walls, into the gel, if walls have no line.
    error_mm : float, mm
        Its standard uncertainty: groups of sections, and walls of three directions.
    facing_mm : float, mm
        s of the module, of walls that face the light.
    excess, excess_error : float
        Light above gel's behind them, of gel's, and its standard error.
    """

    place_mm: float
    error_mm: float
    facing_mm: float
    excess: float
    excess_error: float

    @property
    def line_mm(self) -> tuple[float, float]:
        """Energy of the mean wall's line and its standard uncertainty, mm."""
        shown = LINE * LINES**3
        error = np.hypot(self.excess_error, LINE_SPREAD * shown)
        likely = np.exp(-(((self.excess - shown) / error) ** 2) / 2) / error
        mean = np.average(LINES, weights=likely)
        spread = np.sqrt(np.average((LINES - mean) ** 2, weights=likely))
        return self.facing_mm * float(mean), self.facing_mm * float(spread)


def with_told_walls(
    traces: tuple[VesselTrace, ...], segmentation: Segmentation, errors: ScanErrors, cast: bool
) -> tuple[tuple[VesselTrace, ...], ScanErrors, float]:
    """Return sections with walls where their profile tells, the errors left, and where walls lie.

    The last is how much further into the gel than the field says, mm. A scan without speckle tells
    its walls otherwise (`round_walls`); lumens that are `cast` in a bath are round, those that
    layers leave free have steps, and err by level and blur as well. Without a profile nothing
    changes: half of the most that reflections may be is off (`GelField.faint_mm`). A reference's
    offset is made by the same instrument on diameters moved so: it stands beyond the profile's
    place, and leaves nothing of what isn't known of the line; of a single scan of it the chance of
    its own profile is left too.
    """
    field = segmentation.field
    if segmentation.strength is None:
        traces, error = with_round_walls(traces, field)
        if error is not None and cast:
            level = errors.level_mm if errors.reference is not None else 0.0
            errors = replace(errors, level_mm=level, blur_part=0.0, line_mm=error)
        elif error is not None:
            errors = replace(errors, line_mm=error)
        return traces, errors, field.wall_mm
    profile = wall_profile(traces, segmentation)
    if profile is None:
        return traces, errors, field.wall_mm
    line, unknown = profile.line_mm
    further, reference = profile.place_mm + line, errors.reference
    if reference is not None:
        further += 1e-3 * reference.offset_um
        unknown = profile.error_mm if reference.scans == 1 else 0.0
    left = float(np.hypot(profile.error_mm, unknown))
    return (
        tuple(_widened(trace, 2 * further) for trace in traces),
        replace(errors, faint_mm=0.0, facing_mm=0.0, line_mm=left),
        field.wall_mm + further,
    )


def _widened(trace: VesselTrace, wider: float) -> VesselTrace:
    """Trace with its open lumens wider by so much, mm."""
    old = trace.sections
    diameter, median = (
        np.where(d > 0, np.maximum(d + wider, 0.0), d) for d in (old.diameter, old.median)
    )
    return replace(trace, sections=replace(old, diameter=diameter, median=median))


def wall_profile(traces: Sequence[VesselTrace], segmentation: Segmentation) -> WallProfile | None:
    """Return the profile of all measured walls; None where light or sections don't carry one."""
    if segmentation.strength is None:
        return None
    measured = [_measured(trace) for trace in traces]
    every = -(-sum(map(len, measured)) // MOST) or 1
    parts: list[FloatArray] = []
    before = 0
    for trace, which in zip(traces, measured, strict=True):
        parts += _across(trace, which, slice(-before % every, None, every), segmentation)
        before += len(which)
    if len(parts) < 2 * GROUPS or sum(len(part) for part in parts) < FEWEST:
        return None
    groups = np.array_split(np.arange(len(parts)), GROUPS)
    whole = np.concatenate(parts)
    fitted = _fitted(whole)
    seen = {way: _excess(_towards(whole, way), fitted) for way in (-1, 1)}
    way, excess = max(seen.items(), key=lambda item: item[1])
    others, other_excess = [], []
    for group in groups:
        rest = np.concatenate([parts[k] for k in range(len(parts)) if k not in group])
        others.append(_fitted(rest)[0])
        other_excess.append(_excess(_towards(rest, way), fitted))
    if not np.isfinite([excess, *other_excess]).all():
        return None
    chance = np.sqrt((GROUPS - 1) * np.array([np.var(others), np.var(other_excess)]))
    # Walls along the light have no line: what they show is uneven light.
    along = _excess(whole[np.abs(whole[:, 1]) < np.sqrt(1 - FACING**2)], fitted)
    unsure = np.hypot(chance[1], along if np.isfinite(along) else 0.0)
    spread = np.exp(_fitted(_towards(whole, way))[1])
    error = float(np.hypot(chance[0], _by_direction(whole)))
    return WallProfile(fitted[0], error, float(spread), excess, float(unsure))


def _measured(trace: VesselTrace) -> NDArray[np.int64]:
    """Whole open sections clear of junctions and ends."""
    whole = trace.counted & trace.apart & trace.sections.closed_outline
    return np.flatnonzero(whole & (np.nan_to_num(trace.diameter) > 0))


def _across(
    trace: VesselTrace, which: NDArray[np.int64], some: slice, segmentation: Segmentation
) -> list[FloatArray]:
    """Distance into the gel (mm), the normal's part along the light, share of gel, by section.

    Of `some` of the measured sections; all of them smooth each other's outlines.
    """
    if len(which[some]) == 0:
        return []
    field, strength = segmentation.field, segmentation.strength
    assert strength is not None
    shifts, outlines = _smooth_outlines(trace, which)
    angles = np.linspace(0, 2 * np.pi, outlines.shape[1] + 1)
    out = []
    for k, shift, outline in zip(which[some], shifts[some], outlines[some], strict=True):
        across = trace.planes.across[k]
        centre = trace.planes.centre[k] + shift @ across
        cells, away = _around(field.voxel_mm, field.origin_mm, strength.share.shape[::-1], centre,
                              float(outline.max()) + REACH_MM)  # fmt: skip
        slab = np.abs(away @ np.cross(*across)) < trace.spacing / 2
        cells, flat = cells[slab], away[slab] @ across.T
        radius = np.linalg.norm(flat, axis=1)
        turn = np.arctan2(flat[:, 1], flat[:, 0]) % (2 * np.pi)
        depth = radius - np.interp(turn, angles, np.append(outline, outline[0]))
        facing = (flat @ across)[:, 2] / np.maximum(radius, 1e-9)
        share = strength.share[cells[:, 2], cells[:, 1], cells[:, 0]].astype(np.float64)
        near = np.abs(depth) < REACH_MM
        out.append(np.column_stack([depth, facing, share])[near])
    return out


def _smooth_outlines(trace: VesselTrace, which: NDArray[np.int64]) -> tuple[FloatArray, FloatArray]:
    """Centres (n, 2) and radii (n, rays) of sections, mm: harmonics 0 to 2, by local lines."""
    rays = trace.sections.rays[which]
    rays = np.where(np.isfinite(rays), rays, np.nanmean(rays, axis=1, keepdims=True))
    spectrum = np.fft.rfft(rays, axis=1)[:, :3]
    values = np.column_stack(
        [trace.sections.shift[which], trace.diameter[which], spectrum.real, spectrum.imag]
    )
    along = trace.along[which]
    smooth = np.empty_like(values)
    for k, here in enumerate(along):
        root = np.exp(-(((along - here) / (2 * ALONG_MM)) ** 2))
        line = np.column_stack([root, root * (along - here)])
        smooth[k] = (np.linalg.pinv(line) @ (root[:, None] * values))[0]
    radii = np.fft.irfft(smooth[:, 3:6] + 1j * smooth[:, 6:], rays.shape[1], axis=1)
    mean = np.sqrt((radii**2).mean(axis=1))
    return smooth[:, :2], radii * (smooth[:, 2] / 2 / mean)[:, None]


def _around(
    voxel: FloatArray, origin: FloatArray, shape: tuple[int, ...], centre: FloatArray, reach: float
) -> tuple[NDArray[np.int64], FloatArray]:
    """Voxels (x, y, z) of a box about a place, and their way from it, mm, (m, 3) each."""
    low = np.maximum(np.floor((centre - reach - origin) / voxel).astype(np.int64), 0)
    high = np.minimum(np.ceil((centre + reach - origin) / voxel).astype(np.int64) + 1, shape)
    axes = [np.arange(a, max(a, b)) for a, b in zip(low, high, strict=True)]
    cells = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    return cells, cells * voxel + origin - centre


def _by_direction(samples: FloatArray) -> float:
    """Standard error of the mean over walls along the light, facing it, and facing away."""
    facing = samples[:, 1]
    sides = (facing < -SLANT, np.abs(facing) <= SLANT, facing > SLANT)
    places = [_fitted(samples[s])[0] for s in sides if np.count_nonzero(s) > FEWEST / 4]
    return float(np.std(places, ddof=1) / np.sqrt(len(places))) if len(places) > 1 else 0.0


def _towards(samples: FloatArray, way: int) -> FloatArray:
    """Samples of the walls that face the light, or (the other `way`) away from it."""
    return samples[way * samples[:, 1] > FACING]


def _excess(samples: FloatArray, fitted: FloatArray) -> float:
    """Return light above gel's from s to 2 s and two bins behind walls; -inf where few are.

    A line lies up to half a voxel beside its wall, and shows where that is within the gel: of
    floors and roofs, on those that show more.
    """
    depth, _, share = samples.T
    place, spread = fitted[0], np.exp(fitted[1])
    behind = (depth > place + spread) & (depth < place + 2 * spread + 2 * BIN_MM)
    gel = depth > min(place + 4 * spread, REACH_MM / 2)
    if min(np.count_nonzero(behind), np.count_nonzero(gel)) < FEWEST_BEHIND:
        return -np.inf
    step = ndtr((depth[behind] - place) / spread).mean()
    return float(share[behind].mean() / max(share[gel].mean(), 1e-6) - step)


def _fitted(samples: FloatArray) -> FloatArray:
    """Return d₀, ln s, gel, liquid by least squares; speckle is as strong as its mean."""
    edges = np.arange(-REACH_MM, REACH_MM + BIN_MM / 2, BIN_MM)
    count, _ = np.histogram(samples[:, 0], edges)
    total, _ = np.histogram(samples[:, 0], edges, weights=samples[:, 2])
    known = count > 0
    middle, number = (edges[1:] + edges[:-1])[known] / 2, count[known]
    mean = total[known] / number
    weight = np.sqrt(number) / np.hypot(mean, FLOOR)

    def off(at: FloatArray) -> FloatArray:
        share = ndtr((middle - at[0]) / np.exp(at[1]))
        return np.asarray((at[3] + (at[2] - at[3]) * share - mean) * weight)

    low = np.array([-REACH_MM, np.log(BIN_MM), 0.2, -1.0])
    high = np.array([REACH_MM, np.log(REACH_MM), 5.0, 0.8])
    fit = least_squares(off, np.array([0.0, np.log(0.02), 1.0, 0.0]), bounds=(low, high))
    return np.asarray(fit.x)
