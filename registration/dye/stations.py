"""Place sampling points along the vessels in a dye video, with pixels no other vessel covers."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from design.geometry.polyline import arc_lengths, places_along
from design.network import VesselNetwork
from kernels.arrays import FloatArray
from registration.dye.view import View

ACROSS, ALONG = 13, 5
"""Samples of a station over the lumen's width and along its stretch."""
_LEAST_FREE, _STEEPEST, _PX_APART, _FEWEST, _MOST = 0.4, 0.3, 4.0, 6, 30


@dataclass(frozen=True)
class DyeStations:
    """Stations, vessel by vessel from each first node.

    Attributes
    ----------
    vessel : (s,) int64
    share : (s,) float64
        Of the vessel's volume before it, from the first node.
    points : (s, 3) float64, mm
    radius : (s,) float64, mm
    samples : (s, ACROSS * ALONG, 2) float64, px
        Over the lumen's width, along half the way to either neighbour.
    free : (s, ACROSS * ALONG) bool
        Samples that lie in the picture and in no other vessel's projection.
    seen : (s,) bool
        Whether enough of them are free.
    """

    vessel: NDArray[np.int64]
    share: FloatArray
    points: FloatArray
    radius: FloatArray
    samples: FloatArray
    free: NDArray[np.bool_]
    seen: NDArray[np.bool_]


def place_stations(network: VesselNetwork, view: View, shape: tuple[int, int]) -> DyeStations:
    """Spread stations evenly along all vessels, some four pixels or more apart.

    A station isn't seen where less than 40 % of its samples are free, or where the vessel runs
    steeply towards the camera.
    """
    parts = [_along(network, vessel, view) for vessel in range(network.vessel_count)]
    vessel = np.repeat(np.arange(len(parts)), [len(p[0]) for p in parts])
    share, points, radius, samples, flat = (
        np.concatenate([part[k] for part in parts]) for k in range(5)
    )
    height, width = shape
    inside = ((samples >= 0.0) & (samples <= [width - 1.0, height - 1.0])).all(axis=2)
    free = inside & ~_covered(network, view, samples, vessel)
    seen = (free.mean(axis=1) >= _LEAST_FREE) & (flat > _STEEPEST)
    return DyeStations(vessel, share, points, radius, samples, free, seen)


def _along(
    network: VesselNetwork, vessel: int, view: View
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray, FloatArray]:
    """Share of the volume, point, radius, samples and flatness of a vessel's stations."""
    points, radius = network.polyline(vessel)
    way = arc_lengths(points)
    count = int(np.clip(way[-1] * view.px_per_mm / _PX_APART, _FEWEST, _MOST))
    at = way[-1] * (np.arange(count) + 0.5) / count
    fine = at[:, None] + way[-1] / count * np.linspace(-0.4, 0.4, ALONG)
    place = places_along(points, way, fine)
    of_fine = np.interp(fine, way, radius)
    middle = places_along(points, way, at)
    ends = view.pixels(np.concatenate([place[:, 0], place[:, -1]])).reshape(2, count, 2)
    ahead = ends[1] - ends[0]
    length = np.hypot(*ahead.T)
    scale = view.scales(middle)
    flat = length / (0.8 * way[-1] / count * scale)
    aside = np.stack([-ahead[:, 1], ahead[:, 0]], axis=1) / np.maximum(length, 1e-9)[:, None]
    # Middles of equal strips over the whole width: their mean is the mean over the lumen.
    strips = (2.0 * np.arange(ACROSS) + 1.0) / ACROSS - 1.0
    seen = view.pixels(place.reshape(-1, 3)).reshape(count, ALONG, 1, 2)
    wide = of_fine * scale[:, None]
    off = strips[:, None] * wide[:, :, None, None] * aside[:, None, None]
    share = np.interp(at, way, volume_shares(points, radius))
    return share, middle, of_fine[:, ALONG // 2], (seen + off).reshape(count, -1, 2), flat


def volume_shares(points: FloatArray, radius: FloatArray) -> FloatArray:
    """Share of a vessel's volume before each of its points; every piece a frustum."""
    a, b = radius[:-1], radius[1:]
    parts = np.linalg.norm(np.diff(points, axis=0), axis=1) * (a * a + a * b + b * b)
    whole = np.concatenate([[0.0], np.cumsum(parts)])
    return np.asarray(whole / whole[-1])


def _covered(
    network: VesselNetwork, view: View, samples: FloatArray, vessel: NDArray[np.int64]
) -> NDArray[np.bool_]:
    """Samples in the projection of another vessel's piece, pieces cut off square."""
    start, end, r0, r1, owner = network.pieces()
    first, last = view.pixels(start), view.pixels(end)
    wide = np.stack([r0 * view.scales(start), r1 * view.scales(end)], axis=1)
    reach = wide.max(axis=1)
    low, high = (
        edge(first, last) + sign * reach[:, None]
        for edge, sign in ((np.minimum, -1), (np.maximum, 1))
    )
    lows, highs = samples.min(axis=1), samples.max(axis=1)
    covered = np.zeros(samples.shape[:2], dtype=bool)
    for k in range(len(start)):
        near = ((highs >= low[k]) & (lows <= high[k])).all(axis=1) & (vessel != owner[k])
        if near.any():
            covered[near] |= within_piece(
                samples[near], first[k], last[k], (wide[k, 0], wide[k, 1])
            )
    return covered


def within_piece(
    pixels: FloatArray, first: FloatArray, last: FloatArray, radii: tuple[float, float]
) -> NDArray[np.bool_]:
    """Which pixels (..., 2) lie in a tapered band from ``first`` to ``last``, cut off square."""
    way = last - first
    length = float(np.hypot(*way))
    if length < 1e-9:
        return np.asarray(max(radii) > np.hypot(*(pixels - first).T).T)
    away = pixels - first
    share = away @ way / length**2
    aside = np.abs(away @ np.array([-way[1], way[0]])) / length
    return np.asarray(
        (share > 0.0) & (share < 1.0) & (aside < radii[0] + share * (radii[1] - radii[0]))
    )
