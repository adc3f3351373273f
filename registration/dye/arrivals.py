"""Dye arrival at points along vessels: time of half the final level, and points never filled."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from kernels.arrays import FloatArray
from registration.dye.traces import Traces, before_dye, end_frames, frame_noise

DYED, CLEAR, LEAST_OVER_NOISE = 0.3, 0.15, 6.0
"""Shares of the level expected at a lumen's radius above which it is dyed, below which it isn't."""
LEAST_DYE, LEAST_GLOW = 0.01, 1.0
"""Of -ln(I/I0), and in grey levels: less is no dye, however still compression made the film."""
_WINDOW = (0.35, 0.65)


@dataclass(frozen=True)
class Arrivals:
    """What was seen at the stations.

    Attributes
    ----------
    time_s : (s,) float64, s
        When half the final level is reached, film's clock; NaN where none is.
    sd_s : (s,) float64, s
        Its standard deviation by the noise.
    level : (s,) float64
        Final level, over what a lumen of that radius full of dye is expected to show.
    dyed, clear : (s,) bool
        Dye at the end of the film; none, though it would have been seen. Neither: can't be told.
    """

    time_s: FloatArray
    sd_s: FloatArray
    level: FloatArray
    dyed: NDArray[np.bool_]
    clear: NDArray[np.bool_]


def find_arrivals(traces: Traces, radius: FloatArray) -> Arrivals:
    """Arrival and final level of each station.

    Mean absorbance over a round lumen's width is proportional to its radius and to the mean
    concentration (Beer-Lambert); so the level over the radius, 75th percentile of all stations
    that show dye, is what a filled lumen is expected to show.
    """
    dye, first, last = traces.dye, before_dye(traces.times), end_frames(traces.times)
    final = np.median(dye[:, -last:], axis=1)
    noise = frame_noise(dye)
    # Of the two medians taken, each with 1.25 times the deviation of a mean.
    error = 1.25 * noise * np.sqrt(1.0 / first + 1.0 / last)
    per_radius = final / radius
    least = np.maximum(LEAST_OVER_NOISE * error, LEAST_GLOW if traces.glows else LEAST_DYE)
    shows = np.nan_to_num(final) > np.nan_to_num(least, nan=np.inf)
    full = float(np.percentile(per_radius[shows], 75)) if shows.any() else np.nan
    level, doubt = per_radius / full, error / radius / full
    dyed = shows & (np.nan_to_num(level) > DYED)
    clear = np.nan_to_num(level + 2.0 * doubt, nan=1.0) < CLEAR
    times, sd = np.full(len(dye), np.nan), np.full(len(dye), np.nan)
    for k in np.flatnonzero(dyed):
        times[k], sd[k] = half_time(traces.times, dye[k], float(final[k]), float(noise[k]))
    return Arrivals(times, sd, level, dyed & np.isfinite(times), clear)


def half_time(
    times: FloatArray, dye: FloatArray, final: float, noise: float
) -> tuple[float, float]:
    """When a trace crosses half of ``final``, and its deviation; NaN where it doesn't.

    The crossing of the smoothed trace, made finer by a straight line through the frames between
    35 and 65 % about it, 3 at least.
    """
    smooth = ndimage.uniform_filter1d(dye, 5, mode="nearest")
    above = np.flatnonzero(smooth >= 0.5 * final)
    if len(above) == 0 or above[0] == 0:
        return np.nan, np.nan
    at = int(above[0])
    low, high = at - 1, at
    while low > 0 and smooth[low] > _WINDOW[0] * final:
        low -= 1
    while high < len(dye) - 1 and smooth[high] < _WINDOW[1] * final:
        high += 1
    low, high = min(low, at - 2), max(high, at + 1)
    part = slice(max(low, 0), high + 1)
    t, c = times[part], dye[part]
    slope, middle = np.polyfit(t - t.mean(), c, 1)
    if slope <= 0.0:
        return np.nan, np.nan
    crossing = float(t.mean() + (0.5 * final - middle) / slope)
    crossing = float(np.clip(crossing, t[0], t[-1]))
    spread = noise / slope / np.sqrt(len(t))
    frame = float(np.median(np.diff(times))) / np.sqrt(12.0 * len(t))
    return crossing, float(np.hypot(spread, frame))
