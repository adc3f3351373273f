"""Summarise the predicted ink of a head, as JSON and as text."""

from __future__ import annotations

from typing import Any

import numpy as np

from firmware_profiles import Bath
from printctl.checks.bead.predict import InkPrediction
from printctl.checks.bead.vessels import VesselDiameters
from printctl.checks.bead.warn import bead_warnings


def prediction_facts(
    prediction: InkPrediction,
    bath: Bath | None,
    vessels: VesselDiameters | None = None,
    prompt: VesselDiameters | None = None,
) -> dict[str, Any]:
    """Return a head's predicted ink for `dry_run.json` and ``--json``: JSON-ready.

    Parameters
    ----------
    prediction : InkPrediction
    bath : Bath or None
    vessels, prompt : VesselDiameters, optional
        Against the design: as predicted, and as if the ink came at once.
    """
    bead = prediction.bead
    laid = bead.writes & bead.lays
    wide, length = bead.width_mm[laid], bead.pieces.length[laid]
    pressure = bead.pressure_pa
    facts: dict[str, Any] = {
        "head": prediction.head,
        "style": bead.style,
        "lag_s": prediction.lag.seconds,
        "lag": prediction.lag.how,
        "advance_s": prediction.advance_s,
        "written_ul": round(bead.written_ul, 4),
        "oozed_ul": round(bead.oozed_ul, 4),
        "dropped_ul": round(bead.dropped_ul, 4),
        "held_ul": round(float(bead.flow.held_ul[-1]) - bead.flow.start_ul, 4),
        "width_mm": {
            "mean": _rounded(np.average(wide, weights=length)) if len(wide) else None,
            "least": _rounded(wide.min()) if len(wide) else None,
            "most": _rounded(wide.max()) if len(wide) else None,
        },
        "most_pressure_kpa": None if np.isnan(pressure).all() else _rounded(pressure.max() * 1e-3),
        "warnings": [one.facts() for one in bead_warnings(prediction, bath)],
    }
    if vessels is not None:
        facts["vessels"] = vessels.facts()
    if prompt is not None:
        facts["vessels_without_lag"] = prompt.facts()
    return facts


def prediction_lines(facts: dict[str, Any]) -> list[str]:
    """The same for people."""
    wide = facts["width_mm"]
    what = "filaments" if facts["style"] == "embedded" else "lines"
    lag = {
        "unknown": "without a lag, which isn't known",
        "measured": f"with the measured lag of {facts['lag_s']:g} s",
        "given": f"with a lag of {facts['lag_s']:g} s, as given",
    }[facts["lag"]]
    advance = f" and an advance of {facts['advance_s']:g} s" if facts["advance_s"] else ""
    lines = [
        f"predicted {lag}{advance}: {facts['written_ul']:.4g} µL written, "
        f"{facts['oozed_ul']:.3g} along travels, {facts['dropped_ul']:.3g} standing",
    ]
    if wide["mean"] is not None:
        lines.append(
            f"{what} {wide['mean']:.3f} mm wide in the mean, {wide['least']:.3f} to "
            f"{wide['most']:.3f}"
        )
    for key, title in (
        ("vessels", "diameter against the design"),
        ("vessels_without_lag", "as the plunger pushes it, without lag"),
        ("vessels_uncompensated", "without compensation of the lag"),
    ):
        one = facts.get(key)
        if one and one["vessels"]:
            lines.append(
                f"{title}: median {one['median_percent']:+.1f} %, worst "
                f"{one['worst_percent']:+.1f} % (vessel {one['worst_vessel']} at "
                f"{one['worst_at_mm']:.2f} mm, line {one['worst_line']}), "
                f"{100 * one['length_within_5_percent']:.1f} % of the length within 5 %"
            )
    return lines


def _rounded(value: Any) -> float:
    return round(float(value), 4)
