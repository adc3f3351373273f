"""Evaluate a dye video end to end: camera view, dye traces, arrivals, prediction, patency."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from design.hemodynamics.dye import check_frames, dye_front
from design.network import VesselNetwork
from kernels.arrays import FloatArray
from registration.devices.lens import Lens
from registration.devices.lens.perspective import FEWEST
from registration.dye.arrival_fit import Prediction, predict
from registration.dye.arrivals import Arrivals, find_arrivals
from registration.dye.carrying_flow import carrying_flow, solve_without_closed
from registration.dye.marks import Marks, checked_node, straight_marks
from registration.dye.patency import VesselDye, find_patency, times_against_open_flow
from registration.dye.stations import DyeStations
from registration.dye.traces import Traces, before_dye, read_traces
from registration.dye.view import LEAST_PX, View, find_view
from registration.errors import DyeError

_STRONG_DRIFT = 0.3


@dataclass(frozen=True)
class DyeOptions:
    """What is known besides film, marks and design.

    Attributes
    ----------
    flow_ul_s : float or None, µL/s
        Into the network; None fits it.
    start_s : float or None, s
        When dye passes the inlet, film's clock; None fits it.
    lens : Lens or None
        Of the camera: its distortion is taken out of the frames and the marks.

    Raises
    ------
    DyeError
        When one of them is no number.
    """

    flow_ul_s: float | None = None
    start_s: float | None = None
    lens: Lens | None = None

    def __post_init__(self) -> None:
        for name in ("flow_ul_s", "start_s"):
            value = getattr(self, name)
            if value is not None and not np.isfinite(value):
                raise DyeError(f"{name} is {value}; it must be a finite number")


@dataclass(frozen=True)
class PredictedArrivals:
    """Arrivals by the flow that closed vessels leave.

    Attributes
    ----------
    closed : tuple of int
        Vessels taken out: blocked, or not reached.
    prediction : Prediction
    """

    closed: tuple[int, ...]
    prediction: Prediction


@dataclass(frozen=True)
class DyeReport:
    """Results of a dye video.

    Attributes
    ----------
    view : View
    stations : DyeStations
    traces : Traces
    arrivals : Arrivals
    prediction : Prediction
    vessels : list of VesselDye
    notes : tuple of str
        What weakens the numbers.
    beside : PredictedArrivals or None
        Where vessels are closed, and enough is seen of the others.
    """

    view: View
    stations: DyeStations
    traces: Traces
    arrivals: Arrivals
    prediction: Prediction
    vessels: list[VesselDye]
    notes: tuple[str, ...]
    beside: PredictedArrivals | None = None

    @property
    def held_to(self) -> Prediction:
        """What vessels are judged by: beside closed ones the flow that they leave."""
        return self.prediction if self.beside is None else self.beside.prediction

    def late_s(self) -> FloatArray:
        """Measured less designed arrival of each station, (s,), s; NaN where not both are."""
        return self.arrivals.time_s - self.prediction.time_s

    def late_held_s(self) -> FloatArray:
        """The same against `held_to`."""
        return self.arrivals.time_s - self.held_to.time_s


def measure_dye(
    film: Path, marks: Marks, network: VesselNetwork, options: DyeOptions | None = None
) -> DyeReport:
    """Arrivals along the vessels against the prediction, and the patency of each vessel.

    Raises
    ------
    DyeError
        Marks that don't fit, a film that can't be read, or no dye to be seen in it.
    FlowError
        When the network has no flow from inlet to outlet.
    """
    given = options or DyeOptions()
    inlet = marks.inlet
    if inlet is not None:
        _check_inlet(checked_node(inlet, network, "inlet"), network)
    marks = marks if given.lens is None else straight_marks(marks, given.lens)
    view, flow = find_view(marks, network), carrying_flow(network, inlet)
    stations, traces = read_traces(film, network, view, given.lens)
    arrivals = find_arrivals(traces, stations.radius)
    if not arrivals.dyed.any():
        raise DyeError(
            f"{film}: no dye is seen to come in along the vessels; check the marks, and that the "
            "film begins before the dye and shows it"
        )
    usual = float(np.nanmedian(arrivals.time_s))
    if given.start_s is not None and given.start_s >= usual:
        raise DyeError(
            f"dye is said to pass the inlet at {given.start_s:g} s (--start-s), but half of all "
            f"places have it by {usual:.2f} s; give it on the film's clock"
        )
    prediction = predict(network, flow, stations, traces, arrivals, given.flow_ul_s, given.start_s)
    end = float(traces.times[-1])
    vessels = find_patency(network, flow, stations, arrivals, prediction, end)
    notes = _notes(view, marks, traces, arrivals.dyed, arrivals.time_s)
    front = dye_front(network, flow, prediction.flow_ul_s)
    warning = check_frames(front, float(np.median(np.diff(traces.times)))).warning
    notes += [warning] if warning else []
    report = DyeReport(view, stations, traces, arrivals, prediction, vessels, tuple(notes))
    return _held_beside(report, network, inlet, given)


def _held_beside(
    report: DyeReport, network: VesselNetwork, inlet: int | None, given: DyeOptions
) -> DyeReport:
    """The report with arrivals held to the flow that closed vessels leave, if any are."""
    closed = tuple(v.vessel for v in report.vessels if v.patency in ("blocked", "not reached"))
    flow = solve_without_closed(network, inlet, closed) if closed else None
    if flow is None:
        return report
    stations, arrivals = report.stations, report.arrivals
    try:
        prediction = predict(
            network, flow, stations, report.traces, arrivals, given.flow_ul_s, given.start_s
        )
    except DyeError:
        note = "too little is seen beside the closed vessels to hold dye to the flow they leave"
        return replace(report, notes=(*report.notes, note))
    vessels = times_against_open_flow(report.vessels, flow, stations, arrivals, prediction)
    return replace(report, vessels=vessels, beside=PredictedArrivals(closed, prediction))


def _check_inlet(inlet: int, network: VesselNetwork) -> None:
    ends = [*network.inlets().tolist(), *network.outlets().tolist()]
    if inlet not in ends:
        raise DyeError(
            f"inlet: node {inlet} isn't an open end of the network; its ends are "
            f"{', '.join(map(str, sorted(ends)))}"
        )


def _notes(
    view: View, marks: Marks, traces: Traces, dyed: NDArray[np.bool_], times: FloatArray
) -> list[str]:
    notes = []
    if view.either_way and len(marks.marks) > 2:
        notes.append(
            "the marks lie in line and would fit a mirrored picture as well; mark a point aside"
        )
    if len(marks.marks) == 2:
        notes.append("two marks always fit: a third shows whether they are right")
    if len(marks.marks) == FEWEST - 1 and view.residual_mm * view.px_per_mm > LEAST_PX:
        notes.append(
            f"the marks are off by {view.residual_mm * view.px_per_mm:.0f} pixels; if the camera "
            "was tilted, mark four points or more"
        )
    if view.perspective and len(marks.marks) == FEWEST:
        notes.append(
            f"the four marks mean a camera tilted by {view.tilt_deg:.0f}°, and four always fit "
            "one: a fifth shows whether they are right"
        )
    if not traces.corrected:
        notes.append(
            "too little ground off the vessels to correct shake and light; film with a wider rim"
        )
    if traces.drift > _STRONG_DRIFT:
        notes.append(f"the light changes by {100 * traces.drift:.0f} %; switch exposure to manual")
    baseline = traces.times[before_dye(traces.times) - 1]
    if float(np.min(times[dyed])) < baseline + 0.2:
        notes.append("dye comes within the film's first half second; begin filming earlier")
    return notes
