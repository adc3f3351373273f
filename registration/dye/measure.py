"""Evaluate a dye video end to end, to a verdict, JSON and CSV."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from design.hemodynamics.dye import check_frames, dye_front
from design.network import VesselNetwork
from kernels.arrays import FloatArray
from registration.devices.lens import Lens
from registration.devices.lens.perspective import FEWEST
from registration.dye.arrivals import Arrivals, Prediction, find_arrivals, predict
from registration.dye.flow import carrying_flow, solve_without_closed
from registration.dye.patency import Times, VesselDye, find_patency, times_against_open_flow
from registration.dye.stations import DyeStations
from registration.dye.traces import Traces, before_dye, read_traces
from registration.dye.view import LEAST_PX, Marks, View, checked_node, find_view, straight_marks
from registration.errors import DyeError

Outcome = Literal["pass", "fail", "undecided"]
_NAMED = 12


def dye_verdict(report: DyeReport, tolerance_percent: float) -> dict[str, object]:
    """``outcome`` (pass, fail, undecided) and ``reasons``.

    A vessel that is blocked or not reached fails; so does one that dye leaves too late or early
    by more than the tolerance and two deviations. Beside closed vessels the others are held to
    the flow that those leave. A vessel that
    isn't seen, or that is open but can't be timed, leaves the verdict undecided.
    """
    vessels = [v for v in report.vessels if v.patency != "no flow"]
    idle = len(report.vessels) - len(vessels)
    reasons = [_blocked(v) for v in vessels if v.patency == "blocked"]
    unreached = [v.vessel for v in vessels if v.patency == "not reached"]
    unseen = [v.vessel for v in vessels if v.patency == "not seen"]
    untimed = [v.vessel for v in vessels if v.patency == "open" and v.leaves_s is None]
    if unreached:
        reasons.append(f"not reached by dye: {_vessels(unreached)}")
    closed = bool(reasons)
    slow = _out_of_time(vessels, report, tolerance_percent)
    if closed and report.beside is None:
        reasons.append("beside a closed vessel others carry more; their arrivals aren't judged")
    elif closed:
        reasons.append(_others(vessels, slow, tolerance_percent))
    reasons += slow
    if unseen:
        reasons.append(f"not seen: {_vessels(unseen)}")
    if untimed and not closed:
        reasons.append(f"open, but too little is seen to time dye in {_vessels(untimed)}")
    short = unseen or untimed or not vessels
    outcome: Outcome = "fail" if closed or slow else "undecided" if short else "pass"
    if outcome == "pass":
        flow = (
            "given"
            if report.prediction.flow_given
            else "fitted, so that a part too wide or narrow as a whole isn't told"
        )
        reasons.append(
            f"all {len(vessels)} vessels are open, and dye leaves each within "
            f"{tolerance_percent:g} % of its way from the inlet; flow {flow}"
        )
    if idle:
        reasons.append(f"{idle} of {len(report.vessels)} vessels carry none and weren't judged")
    return {
        "outcome": outcome,
        "passed": outcome == "pass",
        "tolerance_percent": tolerance_percent,
        "reasons": reasons,
    }


def _blocked(vessel: VesselDye) -> str:
    low, high = vessel.blocked_from_mm, vessel.blocked_to_mm
    if low is None or high is None:
        behind = f", or behind it {_vessels(list(vessel.or_in))}" if vessel.or_in else ""
        return f"vessel {vessel.vessel} blocked{behind}: dye doesn't enter"
    return f"vessel {vessel.vessel} blocked between {low:.2f} and {high:.2f} mm from its first node"


def _vessels(numbers: list[int]) -> str:
    named = ", ".join(map(str, numbers[:_NAMED]))
    more = f" and {len(numbers) - _NAMED} more" if len(numbers) > _NAMED else ""
    return f"vessel{'s' if len(numbers) > 1 else ''} {named}{more}"


def _out_of_time(
    vessels: list[VesselDye], report: DyeReport, tolerance_percent: float
) -> list[str]:
    """Vessels that dye leaves at the wrong time: by the design, or by what closed ones leave."""
    closed = any(v.patency in ("blocked", "not reached") for v in vessels)
    if closed and report.beside is None:
        return []
    reasons = [
        _off(v.vessel, v if v.beside is None else v.beside, report.held_to, tolerance_percent)
        for v in vessels
    ]
    return [reason for reason in reasons if reason]


def _others(vessels: list[VesselDye], slow: list[str], tolerance_percent: float) -> str:
    """What is to be said of the vessels beside closed ones."""
    timed = [v for v in vessels if v.beside is not None and v.beside.leaves_s is not None]
    if not timed:
        return "beside the closed vessels no other could be timed"
    return (
        f"by the flow that closed vessels leave, dye leaves {len(timed) - len(slow)} of "
        f"{len(timed)} others within {tolerance_percent:g} % of its way from the inlet"
    )


def _off(vessel: int, times: Times, held_to: Prediction, tolerance_percent: float) -> str:
    """What is to be said of a vessel that dye leaves at the wrong time; else nothing."""
    if times.leaves_s is None or times.predicted_leaves_s is None:
        return ""
    ways = held_to.time_s - held_to.start_s
    # Near the inlet a fitted dead time's error is as large as the way itself.
    way = max(times.predicted_leaves_s - held_to.start_s, float(np.nanmedian(ways)))
    slack = tolerance_percent / 100.0 * way + 2.0 * (times.transit_sd_s or 0.0)
    late = times.leaves_s - times.predicted_leaves_s
    if abs(late) <= slack:
        return ""
    word = "late" if late > 0 else "early"
    return (
        f"vessel {vessel}: dye leaves {abs(late):.2g} s too {word}"
        f" ({times.leaves_s:.2f} s, predicted {times.predicted_leaves_s:.2f}), beyond "
        f"{tolerance_percent:g} % of its way from the inlet"
    )


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


def dye_dict(report: DyeReport, tolerance_percent: float) -> dict[str, Any]:
    """All numbers as JSON values; times on the film's clock."""
    late = report.late_s()
    known = np.abs(late[np.isfinite(late)])
    traces, fitted = report.traces, report.prediction
    return {
        "schema": 1,
        "verdict": dye_verdict(report, tolerance_percent),
        "film": {
            "frames": len(traces.times),
            "seconds": float(traces.times[-1] - traces.times[0]),
            "dye": "glows" if traces.glows else "absorbs",
            "colour": traces.colour,
            "largest_shake_px": traces.shake_px,
            "largest_change_of_light_percent": 100.0 * traces.drift,
        },
        "marks": {
            "px_per_mm": report.view.px_per_mm,
            "residual_mm": report.view.residual_mm,
            "mirrored": report.view.mirrored,
            "perspective": report.view.perspective,
            "tilt_deg": report.view.tilt_deg,
        },
        "prediction": {
            "flow_ml_min": fitted.flow_ul_s * 0.06,
            "flow": "given" if fitted.flow_given else "fitted",
            "dye_at_inlet_s": fitted.start_s,
            "dye_at_inlet": "given" if fitted.start_given else "fitted",
        },
        "arrivals": {
            "places": len(late),
            "places_with_arrival": int(report.arrivals.dyed.sum()),
            "median_error_s": _percentile(known, 50),
            "p95_error_s": _percentile(known, 95),
        },
        "beside_closed": _beside_dict(report),
        "vessels": [
            {"vessel": v.vessel, "patency": v.patency, **asdict(v)} for v in report.vessels
        ],
        "notes": list(report.notes),
    }


def _beside_dict(report: DyeReport) -> dict[str, object] | None:
    """The flow that closed vessels leave, and arrivals against it; None without any."""
    if report.beside is None:
        return None
    late, fitted = report.late_held_s(), report.beside.prediction
    known = np.abs(late[np.isfinite(late)])
    return {
        "closed": list(report.beside.closed),
        "flow_ml_min": fitted.flow_ul_s * 0.06,
        "dye_at_inlet_s": fitted.start_s,
        "median_error_s": _percentile(known, 50),
        "p95_error_s": _percentile(known, 95),
    }


def _percentile(values: Sequence[float] | np.ndarray[Any, Any], percent: float) -> float | None:
    return float(np.percentile(values, percent)) if len(values) else None


def place_rows(report: DyeReport) -> list[dict[str, object]]:
    """A row for each place along the vessels, for a CSV file."""
    stations, seen = report.stations, report.view.pixels(report.stations.points)
    rows = []
    for k, vessel in enumerate(stations.vessel.tolist()):
        numbers = {
            "x_mm": stations.points[k, 0],
            "y_mm": stations.points[k, 1],
            "z_mm": stations.points[k, 2],
            "u_px": seen[k, 0],
            "v_px": seen[k, 1],
            "arrival_s": report.arrivals.time_s[k],
            "arrival_sd_s": report.arrivals.sd_s[k],
            "predicted_s": report.prediction.time_s[k],
            "predicted_held_s": report.held_to.time_s[k],
            "predicted_plug_s": report.prediction.plug_s[k],
            "predicted_tip_s": report.prediction.tip_s[k],
            "level": report.arrivals.level[k],
        }
        values = {name: float(v) if np.isfinite(v) else None for name, v in numbers.items()}
        dyed, clear = report.arrivals.dyed[k], report.arrivals.clear[k]
        word = "dye" if dyed else "no dye" if clear else "not seen"
        rows.append({"vessel": vessel, "share": float(stations.share[k]), **values, "seen": word})
    return rows
