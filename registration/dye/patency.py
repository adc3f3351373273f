"""Judge each vessel's patency from dye arrivals: open, blocked, not reached, not seen, no flow."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from design.geometry.polyline import arc_lengths
from design.hemodynamics.dye import CarryingFlow, downstream_order, flow_ends
from design.network import VesselNetwork
from kernels.arrays import FloatArray
from registration.dye.arrivals import Arrivals, Prediction, along_flow
from registration.dye.stations import DyeStations, volume_shares

Patency = Literal["open", "blocked", "not reached", "not seen", "no flow"]
_DUE, _WAIT, _FAR, _HALF, _FEWEST_OF_LINE, _LEAST_SPAN = 0.6, 3.0, 0.7, 0.5, 3, 0.3


@dataclass(frozen=True)
class Times:
    """When dye passes a vessel, as measured and by a prediction.

    Attributes
    ----------
    arrives_s, leaves_s, predicted_arrives_s, predicted_leaves_s : float or None, s
        At the end that flow enters by and the one it leaves by, film's clock: a line through its
        stations over the volume, extended to the ends.
    transit_s, predicted_transit_s, transit_sd_s : float or None, s
    late_s : float or None, s
        Median of measured less predicted over its stations.
    """

    arrives_s: float | None = None
    leaves_s: float | None = None
    predicted_arrives_s: float | None = None
    predicted_leaves_s: float | None = None
    transit_s: float | None = None
    predicted_transit_s: float | None = None
    transit_sd_s: float | None = None
    late_s: float | None = None


@dataclass(frozen=True, kw_only=True)
class VesselDye(Times):
    """What was seen of one vessel; its times are against the design.

    Attributes
    ----------
    vessel : int
    patency : str
        ``no flow``: carries none by design.
    blocked_from_mm, blocked_to_mm : float or None, mm
        Along the vessel from its first node: the last place with dye and the first without;
        None where it is closed but dye doesn't enter.
    or_in : tuple of int
        Vessels behind it in series, without dye either, that may be the closed one.
    seen_share : float
        Of its stations.
    beside : Times or None
        The same against the flow that closed vessels leave, where there are any.
    """

    vessel: int
    patency: Patency
    blocked_from_mm: float | None = None
    blocked_to_mm: float | None = None
    or_in: tuple[int, ...] = ()
    seen_share: float = 0.0
    beside: Times | None = None


@dataclass(frozen=True)
class _Seen:
    """A vessel's stations that tell something, in the direction of flow.

    Attributes
    ----------
    share : (k,) float64
        Of the vessel's volume before each.
    dyed : (k,) bool
    last : float
        Share at the last station that isn't hidden.
    filled : float
        Share of dyed stations among those dyed or clear, whether dye was due there or not.
    """

    share: FloatArray
    dyed: NDArray[np.bool_]
    last: float
    filled: float

    @property
    def enters(self) -> bool | None:
        """Whether dye is seen at the end that flow comes in by."""
        return self._shown(slice(0, max(len(self.dyed) // 4, 1)))

    @property
    def leaves(self) -> bool | None:
        """Whether dye is seen at the end that flow goes out by; None where that isn't known."""
        shown = self._shown(slice(-max(len(self.dyed) // 4, 1), None))
        # A place or two with dye may be blur of the vessel it runs into.
        far = max(_FAR * self.last, _HALF)
        short = self.share[-1] < far if len(self.share) else True
        return None if shown and (short or self.filled < 0.5) else shown

    def _shown(self, part: slice) -> bool | None:
        return bool(self.dyed[part].mean() > 0.5) if len(self.dyed) else None


def find_patency(
    network: VesselNetwork,
    flow: CarryingFlow,
    stations: DyeStations,
    arrivals: Arrivals,
    prediction: Prediction,
    end_s: float,
) -> list[VesselDye]:
    """Judge vessels by falling pressure.

    A place without dye counts only if the film went on for three times its predicted way there
    (plug flow) and the concentration due is 0.6 or more; what is due later isn't seen.
    """
    share = along_flow(flow, stations)
    waited = end_s - prediction.start_s >= _WAIT * (prediction.plug_s - prediction.start_s)
    clear = arrivals.clear & waited & (prediction.level >= _DUE)
    seen = []
    for vessel in range(network.vessel_count):
        here = np.flatnonzero((stations.vessel == vessel) & (arrivals.dyed | clear))
        here = here[np.argsort(share[here], kind="stable")]
        own = stations.vessel == vessel
        last = float(share[own & stations.seen].max(initial=0.0))
        certain = arrivals.dyed[own & (arrivals.dyed | arrivals.clear)]
        filled = float(certain.mean()) if len(certain) else 0.0
        seen.append(_Seen(share[here], arrivals.dyed[here], last, filled))
    order = downstream_order(network, flow.solution).tolist()
    reached = _reached(network, flow, seen, order)
    states: dict[int, Patency] = dict.fromkeys(range(network.vessel_count), "no flow")
    for vessel in order:
        first, _ = flow_ends(network, flow.solution, vessel)
        states[vessel] = _judged(seen[vessel], reached[first])
    made = []
    for vessel, state in states.items():
        here = stations.vessel == vessel
        stop = _stop(network, flow, vessel, seen[vessel]) if state == "blocked" else None
        shut = state == "blocked" and stop is None
        judged = VesselDye(
            vessel=vessel,
            patency=state,
            blocked_from_mm=stop[0] if stop else None,
            blocked_to_mm=stop[1] if stop else None,
            or_in=_series(network, flow, states, vessel) if shut else (),
            seen_share=float(stations.seen[here].mean()),
        )
        timed = _times(share, arrivals, prediction, here) if state == "open" else Times()
        made.append(replace(judged, **vars(timed)))
    return made


def times_against_open_flow(
    vessels: list[VesselDye],
    flow: CarryingFlow,
    stations: DyeStations,
    arrivals: Arrivals,
    prediction: Prediction,
) -> list[VesselDye]:
    """Vessels with times against the flow that closed ones leave; it may run the other way."""
    share = along_flow(flow, stations)
    made = []
    for vessel in vessels:
        here = stations.vessel == vessel.vessel
        is_open = vessel.patency == "open"
        timed = _times(share, arrivals, prediction, here) if is_open else Times()
        made.append(replace(vessel, beside=timed))
    return made


def _reached(
    network: VesselNetwork, flow: CarryingFlow, seen: list[_Seen], order: list[int]
) -> dict[int, bool | None]:
    """Whether dye comes to each node, by the vessels that meet there; None: can't be told."""
    reached: dict[int, bool | None] = {}
    for node in range(len(network.nodes)):
        into, out = [], []
        for vessel in order:
            first, last = flow_ends(network, flow.solution, vessel)
            into += [seen[vessel].leaves] if last == node else []
            out += [seen[vessel].enters] if first == node else []
        if True in into or True in out:
            reached[node] = True
        elif into:
            reached[node] = None if None in into else False
        else:
            # An inlet: dye that shows nowhere behind it may be held up before the part.
            reached[node] = None
    return reached


def _judged(seen: _Seen, reached: bool | None) -> Patency:
    if seen.enters is None:
        return "not seen"
    if seen.leaves:
        return "open"
    if seen.leaves is None:
        return "not seen"
    if seen.enters or bool(seen.dyed.any()) or reached:
        return "blocked"
    return "not reached" if reached is False else "not seen"


def _stop(
    network: VesselNetwork, flow: CarryingFlow, vessel: int, seen: _Seen
) -> tuple[float, float] | None:
    """Between which places along a blocked vessel dye stops, mm from its first node, or None.

    Dye no further in than the vessel is wide may be blur, or swirl at the branch: the vessel then
    is closed anywhere along it.
    """
    points, radius = network.polyline(vessel)
    way = arc_lengths(points)
    whole = volume_shares(points, radius)
    # The place with most dye before it and least behind it: a place or two may be blur.
    k = int(np.argmax(np.concatenate([[0], np.cumsum(np.where(seen.dyed, 1, -1))])))
    pair = np.array(
        [seen.share[k - 1] if k else 0.0, seen.share[k] if k < len(seen.share) else 1.0]
    )
    back = flow.solution.flow[vessel] < 0.0
    low, high = np.interp(1.0 - pair[::-1] if back else pair, whole, way)
    entered = way[-1] - high if back else low
    if entered < 2.0 * float(radius[-1 if back else 0]):
        return None
    return float(low), float(high)


def _times(
    share: FloatArray, arrivals: Arrivals, prediction: Prediction, here: NDArray[np.bool_]
) -> Times:
    """Arrival at both ends and transit, as far as a vessel's known stations tell."""
    known = np.flatnonzero(here & arrivals.dyed & np.isfinite(prediction.time_s))
    if len(known) == 0:
        return Times()
    late = float(np.median((arrivals.time_s - prediction.time_s)[known]))
    if len(known) < _FEWEST_OF_LINE or np.ptp(share[known]) < _LEAST_SPAN:
        return Times(late_s=late)
    measured = _line(share[known], arrivals.time_s[known])
    due = _line(share[known], prediction.time_s[known])
    return Times(
        late_s=late,
        arrives_s=measured[0],
        leaves_s=measured[1],
        predicted_arrives_s=due[0],
        predicted_leaves_s=due[1],
        transit_s=measured[1] - measured[0],
        predicted_transit_s=due[1] - due[0],
        transit_sd_s=measured[2],
    )


def _line(share: FloatArray, time: FloatArray) -> tuple[float, float, float]:
    """A line's values at shares 0 and 1, and the deviation of their difference by its residuals.

    Slopes are the median of those between pairs of stations (Theil 1950, Sen 1968).
    """
    gap = share[:, None] - share[None, :]
    far = gap > 0.2 * np.ptp(share)
    slope = float(np.median((time[:, None] - time[None, :])[far] / gap[far]))
    begin = float(np.median(time - slope * share))
    rest = 1.4826 * float(np.median(np.abs(time - begin - slope * share)))
    spread = 1.25 * rest / max(float(np.sqrt(((share - share.mean()) ** 2).sum())), 1e-9)
    return begin, begin + slope, spread


def _series(
    network: VesselNetwork, flow: CarryingFlow, states: dict[int, Patency], vessel: int
) -> tuple[int, ...]:
    """Vessels behind without a branch between, that stand still with a closed one."""
    chain: list[int] = []
    node = flow_ends(network, flow.solution, vessel)[1]
    while network.degree()[node] == 2:
        out = (
            k
            for k, state in states.items()
            if state != "no flow" and flow_ends(network, flow.solution, k)[0] == node
        )
        behind = next(out, None)
        if behind is None or states[behind] == "open":
            break
        chain.append(behind)
        node = flow_ends(network, flow.solution, behind)[1]
    return tuple(chain)
