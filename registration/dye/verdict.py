"""Verdict on a dye video: pass, fail or undecided, by blocked vessels and late or early dye."""

from __future__ import annotations

from typing import Any, Literal

import numpy as np

from registration.dye.arrival_fit import Prediction
from registration.dye.measure import DyeReport
from registration.dye.patency import Times, VesselDye

Outcome = Literal["pass", "fail", "undecided"]
_NAMED = 12


def dye_verdict(report: DyeReport, tolerance_percent: float) -> dict[str, Any]:
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
