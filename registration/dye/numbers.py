"""Convert a dye report to plain values for JSON, and to CSV rows of points along the vessels."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from typing import Any

import numpy as np

from registration.dye.measure import DyeReport
from registration.dye.verdict import dye_verdict


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


def _beside_dict(report: DyeReport) -> dict[str, Any] | None:
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
