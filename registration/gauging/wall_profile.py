"""Locate lumen walls by the mean intensity profile across them, beneath their bright reflection.

A wall sends light back where gel meets liquid. A rough wall's line is as wide as its roughness, in
voxels that are each no brighter than gel's speckle, so that no voxel tells (`reflections`): the
half level is met up to the line's energy too far out. The mean over a print's walls tells. With
heights of the wall spread as a Gaussian about its mean surface (roughness and point spread, s) the
share of gel at the distance d is Φ(d/s), and as much wall lies at d as that rises:

    P(d) = liquid + (gel - liquid) (Φ(u) + E φ(u) / s),   u = (d - d₀) / s

with E the line's energy, mm of gel, and d₀ the mean surface: linear in intensity, whatever the
speckle. A line of E below s can't be told from a wall that lies further out: the cumulants of P'
(mean d₀ - E, variance s² - E², third -2 E³) are those of a skew roughness elsewhere, and walls of
round beads are as skew. From E = s on P exceeds gel by more than 8 %, which no roughness does.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares
from scipy.special import ndtr

from kernels.arrays import FloatArray
from registration.gauging.trace import VesselTrace
from registration.segmentation import Segmentation

REACH_MM = 0.15
"""Of the profile, to either side; gel's own level is asked for from `GEL_MM` to `FAR_MM`."""
GEL_MM, FAR_MM = 0.1, 0.25
BIN_MM = 0.005
MOST = 240
"""Sections that are looked at, evenly spread."""
FEWEST = 2000
"""Voxels, for a profile."""
FEWEST_GEL = 15
"""Voxels of gel beside a wall, for its level."""
GROUPS = 6
"""Of neighbouring sections; what differs between them is chance (delete-a-group jackknife)."""
FLOOR = 0.3
"""Of the gel: what counts beside speckle, or the liquid's few grains would fix the wall's law."""
SLANT = np.sqrt(0.5)
"""Walls whose normal has more than this along the light face it, or face away."""


@dataclass(frozen=True)
class WallProfile:
    """Mean surface and bright line of a print's walls.

    Attributes
    ----------
    place_mm : float, mm
        Of the mean surface beyond the measured walls, into the gel.
    error_mm : float, mm
        Its standard uncertainty: groups of sections, and walls of three directions.
    spread_mm, line_mm : float, mm
        s and E of the module.
    line_error_mm : float, mm
        Standard uncertainty of E.
    """

    place_mm: float
    error_mm: float
    spread_mm: float
    line_mm: float
    line_error_mm: float

    @property
    def told(self) -> bool:
        """Whether the line can be told from gel: E above s, by twice its uncertainty."""
        return self.line_mm - 2 * self.line_error_mm > self.spread_mm

    def expected(self, prior_mm: tuple[float, float]) -> tuple[float, float]:
        """Return place and standard uncertainty, mm, from the profile and a prior (mean, spread).

        A line of energy E leaves unknown which part of the wall's own width s it takes: s (s/E)².
        Walls farther off than both explain spread by more than expected (empirical Bayes).
        """
        mean, usual = prior_mm
        error = np.hypot(self.error_mm, self.spread_mm * (self.spread_mm / self.line_mm) ** 2)
        spread = max(usual**2, (self.place_mm - mean) ** 2 - error**2)
        part = spread / (spread + error**2)
        return float(mean + part * (self.place_mm - mean)), float(np.sqrt(part) * error)


def wall_profile(
    traces: Sequence[VesselTrace], segmentation: Segmentation, *, across_light: bool = False
) -> WallProfile | None:
    """Return the profile of all measured walls; None where light or sections don't carry one.

    `across_light`: of walls that face the light or away from it alone. Smooth walls shine there and
    nowhere else.
    """
    if segmentation.strength is None:
        return None
    places = [(trace, k) for trace in traces for k in _measured(trace)]
    every = -(-len(places) // MOST) or 1
    groups = np.array_split(np.arange(len(places[::every])), GROUPS)
    parts = [_across(trace, int(k), segmentation) for trace, k in places[::every]]
    if across_light:
        parts = [part[np.abs(part[:, 1]) > SLANT] for part in parts]
    if len(parts) < 2 * GROUPS or sum(len(part) for part in parts) < FEWEST:
        return None
    fitted = _fitted(np.concatenate(parts), None)
    if not fitted[2] > np.exp(fitted[1]):
        return None
    others = [
        _fitted(np.concatenate([parts[k] for k in range(len(parts)) if k not in group]), fitted)
        for group in groups
    ]
    chance = np.sqrt((GROUPS - 1) * np.var(others, axis=0))
    error = float(np.hypot(chance[0], _by_direction(np.concatenate(parts), fitted)))
    return WallProfile(
        float(fitted[0]), error, float(np.exp(fitted[1])), float(fitted[2]), float(chance[2])
    )


def _measured(trace: VesselTrace) -> NDArray[np.int64]:
    whole = trace.counted & trace.sections.closed_outline & ~trace.short
    return np.flatnonzero(whole & (np.nan_to_num(trace.diameter) > 0))


def _by_direction(samples: FloatArray, fitted: FloatArray) -> float:
    """Standard error of the mean over walls along the light, facing it, and facing away."""
    facing = samples[:, 1]
    sides = (facing < -SLANT, np.abs(facing) <= SLANT, facing > SLANT)
    places = [_fitted(samples[s], fitted)[0] for s in sides if np.count_nonzero(s) > FEWEST / 4]
    return float(np.std(places, ddof=1) / np.sqrt(len(places))) if len(places) > 1 else 0.0


def _outline(trace: VesselTrace, section: int) -> FloatArray:
    """Radii of a section's smooth outline, (rays,), mm: harmonics 0 to 2, area as measured."""
    radii = trace.sections.rays[section]
    radii = np.where(np.isfinite(radii), radii, np.nanmean(radii))
    spectrum = np.fft.rfft(radii)
    spectrum[3:] = 0
    smooth = np.fft.irfft(spectrum, len(radii))
    return np.asarray(smooth * trace.diameter[section] / 2 / np.sqrt(np.mean(smooth**2)))


def _across(trace: VesselTrace, section: int, segmentation: Segmentation) -> FloatArray:
    """Distance into the gel (mm), the normal's part along the light, light over gel's, (m, 3)."""
    field, strength = segmentation.field, segmentation.strength
    assert strength is not None
    across = trace.planes.across[section]
    centre = trace.planes.centre[section] + trace.sections.shift[section] @ across
    outline = _outline(trace, section)
    cells, away = _around(field.voxel_mm, field.origin_mm, strength.signal.shape[::-1], centre,
                          float(outline.max()) + FAR_MM)  # fmt: skip
    slab = np.abs(away @ np.cross(*across)) < trace.spacing / 2
    cells, flat = cells[slab], away[slab] @ across.T
    radius = np.linalg.norm(flat, axis=1)
    turn = np.arctan2(flat[:, 1], flat[:, 0]) % (2 * np.pi)
    angles = np.linspace(0, 2 * np.pi, len(outline) + 1)
    depth = radius - np.interp(turn, angles, np.append(outline, outline[0]))
    facing = (flat @ across)[:, 2] / np.maximum(radius, 1e-9)
    light = strength.signal[cells[:, 2], cells[:, 1], cells[:, 0]].astype(np.float64)
    return _over_gel(depth, facing, light)


def _around(
    voxel: FloatArray, origin: FloatArray, shape: tuple[int, ...], centre: FloatArray, reach: float
) -> tuple[NDArray[np.int64], FloatArray]:
    """Voxels (x, y, z) of a box about a place, and their way from it, mm, (m, 3) each."""
    low = np.maximum(np.floor((centre - reach - origin) / voxel).astype(np.int64), 0)
    high = np.minimum(np.ceil((centre + reach - origin) / voxel).astype(np.int64) + 1, shape)
    axes = [np.arange(a, max(a, b)) for a, b in zip(low, high, strict=True)]
    cells = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    return cells, cells * voxel + origin - centre


def _over_gel(depth: FloatArray, facing: FloatArray, light: FloatArray) -> FloatArray:
    """Light over that of the gel behind the same side of the section."""
    out = []
    for side in (facing < -SLANT, np.abs(facing) <= SLANT, facing > SLANT):
        gel = light[side & (depth > GEL_MM) & (depth < FAR_MM)]
        near = side & (np.abs(depth) < REACH_MM)
        if len(gel) >= FEWEST_GEL and gel.mean() > 0:
            out.append(np.column_stack([depth[near], facing[near], light[near] / gel.mean()]))
    return np.concatenate(out) if out else np.empty((0, 3))


def _fitted(samples: FloatArray, start: FloatArray | None) -> FloatArray:
    """Return d₀, ln s, E, ln gel, ln liquid by least squares; speckle is as strong as its mean."""
    edges = np.arange(-REACH_MM, REACH_MM + BIN_MM / 2, BIN_MM)
    count, _ = np.histogram(samples[:, 0], edges)
    total, _ = np.histogram(samples[:, 0], edges, weights=samples[:, 2])
    known = count > 0
    middle, number = (edges[1:] + edges[:-1])[known] / 2, count[known]
    mean = total[known] / number

    def fitted(first: FloatArray, usual: FloatArray) -> FloatArray:
        weight = np.sqrt(number) / np.hypot(usual, FLOOR)
        fit = least_squares(
            lambda at: (mean - _profile(at, middle)) * weight, first, bounds=(low, high)
        )
        return np.append(fit.x, fit.cost)

    low = np.array([-REACH_MM, np.log(BIN_MM), 0.0, -3.0, -9.0])
    high = np.array([REACH_MM, np.log(REACH_MM), 5.0, 3.0, 2.0])
    # From a line that is hardly there and from one that outshines the gel.
    starts = [np.array([0.0, np.log(0.03), line, 0.0, -3.0]) for line in (0.01, 0.2)]
    if start is not None:
        starts = [np.clip(start, low + 1e-6, high - 1e-6)]
    best = min((fitted(one, mean) for one in starts), key=lambda one: float(one[-1]))[:-1]
    inside = np.clip(best, low + 1e-6, high - 1e-6)
    return fitted(inside, _profile(best, middle))[:-1]


def _profile(at: FloatArray, depth: FloatArray) -> FloatArray:
    """P of the module at depths (n,), mm."""
    u = (depth - at[0]) / np.exp(at[1])
    line = at[2] * np.exp(-u * u / 2) / (np.sqrt(2 * np.pi) * np.exp(at[1]))
    liquid, gel = np.exp(at[4]), np.exp(at[3])
    return np.asarray(np.maximum(liquid + (gel - liquid) * (ndtr(u) + line), 1e-6))
