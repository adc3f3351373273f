"""Does the part perfuse as designed, by the film? And the report as plain values."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from typing import Any, Literal

import numpy as np

from registration.dye.measure import DyeReport
from registration.dye.patency import VesselDye

Outcome = Literal["pass", "fail", "undecided"]
_NAMED = 12


def dye_verdict(report: DyeReport, tolerance_percent: float) -> dict[str, Any]:
    """``outcome`` (pass, fail, undecided) and ``reasons``.

    A vessel that is blocked or not reached fails; so does one that all are open without but that
    dye leaves too late or early by more than the tolerance and two deviations. A vessel that
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
    slow = [] if closed else [_off(v, report, tolerance_percent) for v in vessels]
    slow = [reason for reason in slow if reason]
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
    if closed:
        reasons.append("beside a closed vessel others carry more; arrivals are held to the design")
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


def _off(vessel: VesselDye, report: DyeReport, tolerance_percent: float) -> str:
    """What is to be said of a vessel that dye leaves at the wrong time; else nothing."""
    if vessel.leaves_s is None or vessel.predicted_leaves_s is None:
        return ""
    ways = report.prediction.time_s - report.prediction.start_s
    # Near the inlet a fitted dead time's error is as large as the way itself.
    way = max(vessel.predicted_leaves_s - report.prediction.start_s, float(np.nanmedian(ways)))
    slack = tolerance_percent / 100.0 * way + 2.0 * (vessel.transit_sd_s or 0.0)
    late = vessel.leaves_s - vessel.predicted_leaves_s
    if abs(late) <= slack:
        return ""
    word = "late" if late > 0 else "early"
    return (
        f"vessel {vessel.vessel}: dye leaves {abs(late):.2g} s too {word}"
        f" ({vessel.leaves_s:.2f} s, predicted {vessel.predicted_leaves_s:.2f}), beyond "
        f"{tolerance_percent:g} % of its way from the inlet"
    )


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
        "vessels": [asdict(vessel) for vessel in report.vessels],
        "notes": list(report.notes),
    }


def _percentile(values: Sequence[float] | np.ndarray[Any, Any], percent: float) -> float | None:
    return float(np.percentile(values, percent)) if len(values) else None


def place_rows(report: DyeReport) -> list[dict[str, Any]]:
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
            "predicted_plug_s": report.prediction.plug_s[k],
            "level": report.arrivals.level[k],
        }
        found = {name: float(v) if np.isfinite(v) else None for name, v in numbers.items()}
        dyed, clear = report.arrivals.dyed[k], report.arrivals.clear[k]
        word = "dye" if dyed else "no dye" if clear else "not seen"
        rows.append({"vessel": vessel, "share": float(stations.share[k]), **found, "seen": word})
    return rows
