"""Dye arrival times along vessels: observed, and predicted by fitted flow."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage
from scipy.optimize import least_squares

from design.hemodynamics.dye import CarryingFlow, dye_curves
from design.network import VesselNetwork
from kernels.arrays import FloatArray
from registration.dye.stations import DyeStations
from registration.dye.traces import Traces, before_dye, end_frames, frame_noise
from registration.errors import DyeError

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


_FEWEST, _LATEST = 6, 1.5


@dataclass(frozen=True)
class Prediction:
    """Predicted dye arrivals by the 0D solution.

    Attributes
    ----------
    time_s : (s,) float64, s
        Half of the level at the end of the film, film's clock; NaN where nothing flows or dye
        isn't due within the film.
    level : (s,) float64
        Concentration due at the end of the film.
    plug_s : (s,) float64, s
        With one mean velocity in each vessel, along the earliest path, film's clock.
    tip_s : (s,) float64, s
        Of the first dye, on the axis at twice the mean speed, film's clock.
    start_s, flow_ul_s : float
        When dye enters the inlets, film's clock, and the flow into the network.
    start_given, flow_given : bool
    """

    time_s: FloatArray
    level: FloatArray
    plug_s: FloatArray
    tip_s: FloatArray
    start_s: float
    flow_ul_s: float
    start_given: bool
    flow_given: bool


def predict(
    network: VesselNetwork,
    flow: CarryingFlow,
    stations: DyeStations,
    traces: Traces,
    arrivals: Arrivals,
    flow_ul_s: float | None = None,
    start_s: float | None = None,
) -> Prediction:
    """Predict arrivals; what isn't given of flow and start is fitted to those measured.

    Robustly (soft L1), on the logarithm of the flow.

    Raises
    ------
    DyeError
        When too few arrivals were measured to fit.
    """
    share = along_flow(flow, stations)
    plug = _plug(network, flow, stations, share)
    used = arrivals.dyed & np.isfinite(plug)
    unknown = (flow_ul_s is None) + (start_s is None)
    if unknown and int(used.sum()) < _FEWEST:
        raise DyeError(
            f"dye is seen to arrive at {int(used.sum())} places along the vessels, fewer than "
            f"{_FEWEST}: check the marks, and that the film shows the dye come in"
        )
    guess = _first_guess(plug[used], arrivals.time_s[used], flow_ul_s, start_s)
    end = float(traces.times[-end_frames(traces.times) :].mean())
    until = _LATEST * max(end - guess[1], 1e-3) * guess[0]
    times, curves = dye_curves(network, flow, stations.vessel, share, until)
    model = _Model(times, curves, end)
    rate, start = guess
    if unknown:
        measured, few = arrivals.time_s[used], _Model(times, curves[used], end)
        scale = max(0.02 * float(np.ptp(measured)), 1e-3)

        def misfit(free: FloatArray) -> FloatArray:
            q, t0 = _unpacked(free, flow_ul_s, start_s)
            due = few.arrival(q, t0)
            # What isn't due within the film though it was seen is as late as can be.
            return (np.where(np.isfinite(due), due, end + scale) - measured) / scale

        packed = ([np.log(rate)] if flow_ul_s is None else []) + (
            [start] if start_s is None else []
        )
        solved = least_squares(misfit, packed, loss="soft_l1", x_scale="jac", diff_step=1e-3)
        rate, start = _unpacked(solved.x, flow_ul_s, start_s)
    return Prediction(
        time_s=model.arrival(rate, start),
        level=model.level(rate, start),
        plug_s=start + plug / rate,
        tip_s=start + plug / rate / 2.0,
        start_s=start,
        flow_ul_s=rate,
        start_given=start_s is not None,
        flow_given=flow_ul_s is not None,
    )


def along_flow(flow: CarryingFlow, stations: DyeStations) -> FloatArray:
    """Share of the vessel's volume before each station in the flow's direction."""
    back = flow.solution.flow[stations.vessel] < 0.0
    return np.where(back, 1.0 - stations.share, stations.share)


def _plug(
    network: VesselNetwork, flow: CarryingFlow, stations: DyeStations, share: FloatArray
) -> FloatArray:
    forward = flow.solution.flow >= 0.0
    begin = np.where(forward, network.vessel_nodes[:, 0], network.vessel_nodes[:, 1])
    with np.errstate(invalid="ignore"):
        time = flow.earliest_s[begin][stations.vessel] + share * flow.transit_s[stations.vessel]
    return np.where(np.isfinite(time), time, np.nan)


def _first_guess(
    plug: FloatArray, measured: FloatArray, flow: float | None, start: float | None
) -> tuple[float, float]:
    """Flow and start by medians: of the slopes between stations, then of what is left."""
    if flow is None and start is not None:
        flow = float(np.median(plug / np.maximum(measured - start, 1e-3)))
    elif flow is None:
        gap = plug[:, None] - plug[None, :]
        far = gap > 0.2 * np.ptp(plug)
        slope = np.median(((measured[:, None] - measured[None, :])[far]) / gap[far])
        if not slope > 0.0:
            raise DyeError(
                "dye comes first to the places farthest from the inlet: the marks are turned "
                "round, or dye enters at another end (say inlet: in the marks)"
            )
        flow = 1.0 / float(slope)
    start = float(np.median(measured - plug / flow)) if start is None else start
    return flow, start


def _unpacked(free: FloatArray, flow: float | None, start: float | None) -> tuple[float, float]:
    values = list(map(float, free))
    rate = float(np.exp(values.pop(0))) if flow is None else flow
    return rate, values.pop(0) if start is None else start


@dataclass(frozen=True)
class _Model:
    """Curves of 1 µL/s, read at any flow and start."""

    times: FloatArray
    curves: FloatArray
    end: float

    def level(self, rate: float, start: float) -> FloatArray:
        """Concentration at the end of the film."""
        at = np.clip((self.end - start) * rate, 0.0, self.times[-1])
        index = min(int(np.searchsorted(self.times, at, side="right")) - 1, len(self.times) - 2)
        part = (at - self.times[index]) / (self.times[1] - self.times[0])
        return np.asarray((1 - part) * self.curves[:, index] + part * self.curves[:, index + 1])

    def arrival(self, rate: float, start: float) -> FloatArray:
        """When half of that level is reached, film's clock; NaN where there is next to none."""
        half = 0.5 * self.level(rate, start)
        above = self.curves >= half[:, None]
        index = np.clip(np.argmax(above, axis=1), 1, None)
        row: NDArray[np.intp] = np.arange(len(half))
        low, high = self.curves[row, index - 1], self.curves[row, index]
        part = (half - low) / np.maximum(high - low, 1e-12)
        step = self.times[1] - self.times[0]
        arrival = start + (self.times[index] - step * (1.0 - np.clip(part, 0.0, 1.0))) / rate
        return np.where(half > 0.05, arrival, np.nan)
