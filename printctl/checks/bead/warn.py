"""Warnings from an ink prediction, with G-code lines, and its summary."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from firmware_profiles import Bath, wall_stress_pa
from gcode.bead.predict import Bead, crevice, drag, settling, swell
from printctl.checks.bead.predict import InkPrediction
from printctl.checks.bead.vessels import VesselDiameters

THIN: Final = 0.8
THICK: Final = 1.25
"""Of the width that the plunger's motion asks for: a fifth less, a quarter more."""
LEAST: Final = 0.2
"""Of the usual width; a line that is to be thinner is a plunger's step that came late."""
TOLD_UL: Final = 1e-3
"""Less ink on travels or in drops than a nanolitre isn't told."""


@dataclass(frozen=True)
class BeadWarning:
    """Warning about the predicted ink.

    Attributes
    ----------
    sort : str
        A word for programs.
    line : int
        Of the file; 0 where none is meant.
    text : str
    calibrated : bool
        Whether all constants behind it were measured.
    """

    sort: str
    line: int
    text: str
    calibrated: bool

    def facts(self) -> dict[str, Any]:
        """JSON-ready."""
        return {
            "sort": self.sort,
            "line": self.line,
            "text": self.text,
            "calibrated": self.calibrated,
        }

    def row(self) -> str:
        """As a person reads it."""
        where = f"line {self.line}: " if self.line else ""
        return f"{where}{self.text}" + ("" if self.calibrated else " (uncalibrated)")


def bead_warnings(prediction: InkPrediction, bath: Bath | None) -> list[BeadWarning]:
    """All warnings of one head's prediction."""
    return [
        *_of_lag(prediction),
        *_of_flow(prediction),
        *_of_widths(prediction),
        *_of_pressure(prediction),
        *_of_bath(prediction, bath),
    ]


def _of_lag(prediction: InkPrediction) -> Iterator[BeadWarning]:
    ink, lag = prediction.mounting.ink, prediction.lag
    if lag.note:
        yield BeadWarning("lag", 0, lag.note, False)
    if prediction.advance_s > 0 and lag.seconds == 0:
        yield BeadWarning(
            "advance",
            0,
            f"the firmware's advance of {prediction.advance_s:g} s is left out: without a lag to "
            "cancel it can't be foreseen what it does",
            False,
        )
    elif prediction.advance_s > 0 and abs(prediction.advance_s / lag.seconds - 1) > 0.1:
        yield BeadWarning(
            "advance",
            0,
            f"the firmware's advance is {prediction.advance_s:g} s, the lag {lag.seconds:g} s; "
            "K = τ cancels it",
            lag.how == "measured",
        )
    if prediction.ahead_s > 0 and abs(prediction.ahead_s / max(lag.seconds, 1e-9) - 1) > 0.1:
        yield BeadWarning(
            "advance",
            0,
            f"the file drives the plunger ahead of a lag of {prediction.ahead_s:g} s, and "
            f"{lag.seconds:g} s are taken here",
            lag.how == "measured",
        )
    nozzle = prediction.bead.nozzle
    if nozzle.held_ul > 0 and ink.retract_ul < nozzle.held_ul:
        yield BeadWarning(
            "held",
            0,
            f"{ink.name} holds {nozzle.held_pa * 1e-3:.3g} kPa behind the needle after a stop "
            f"(4 τ_y L/d), {nozzle.held_ul * 1e3:.3g} nL, more than retract_ul relieves "
            f"({ink.retract_ul * 1e3:.3g} nL): what jolts the needle makes it weep",
            ink.calibrated and lag.how == "measured",
        )


def _of_flow(prediction: InkPrediction) -> Iterator[BeadWarning]:
    bead = prediction.bead
    sure = prediction.lag.how == "measured"
    moving = bead.pieces.length > 1e-9
    for sort, those, what in (
        ("ooze", moving & ~bead.writes, "is laid along travels, most of it here"),
        ("drop", ~moving, "is laid while the needle stands, most of it here"),
    ):
        laid = np.where(those, bead.flow.laid_ul, 0.0)
        total = float(laid.sum())
        if total < TOLD_UL:
            continue
        by_line = np.bincount(bead.line, laid)
        line = int(by_line.argmax())
        yield BeadWarning(sort, line, f"{total:.3g} µL {what} ({by_line[line]:.3g} µL)", sure)


def _of_widths(prediction: InkPrediction) -> Iterator[BeadWarning]:
    """Where what comes out is far from what the plunger pushes there; none without a lag."""
    bead, prompt = prediction.bead, prediction.prompt
    if bead is prompt or prediction.ahead_s > 0:
        return
    asked = _asked_mm(bead, prompt)
    ratio = np.divide(bead.width_mm, asked, out=np.ones(len(bead)), where=asked > 0)
    for sort, those, worst, what in (
        ("thin", ratio < THIN, np.argmin, "thinner than pushed"),
        ("thick", ratio > THICK, np.argmax, "thicker than pushed"),
    ):
        rows = np.flatnonzero(those & bead.writes)
        if not len(rows):
            continue
        row = rows[int(worst(ratio[rows]))]
        length = float(bead.pieces.length[rows].sum())
        yield BeadWarning(
            sort,
            int(bead.line[row]),
            f"{_way(length)} are written {what} by a {'fifth' if sort == 'thin' else 'quarter'} "
            f"and more; worst here, {bead.width_mm[row]:.3f} mm for {asked[row]:.3f}",
            prediction.lag.how == "measured",
        )


def _way(length_mm: float) -> str:
    return f"{length_mm:.3g} mm" if length_mm < 999.5 else f"{length_mm * 1e-3:.3g} m"


def _asked_mm(bead: Bead, prompt: Bead) -> np.ndarray:
    """Width that the same moment has without a lag, (n,), mm; 0 where next to nothing is asked."""
    rows = np.flatnonzero(prompt.writes)
    middle = (prompt.pieces.time[rows] + prompt.pieces.time[rows + 1]) / 2
    own = (bead.pieces.time[:-1] + bead.pieces.time[1:]) / 2
    asked = np.interp(own, middle, prompt.width_mm[rows]) if len(rows) else np.zeros(len(bead))
    usual = float(np.median(prompt.width_mm[rows])) if len(rows) else 0.0
    return np.where(bead.writes & (asked > LEAST * usual), asked, 0.0)


def _of_pressure(prediction: InkPrediction) -> Iterator[BeadWarning]:
    bead, mounted = prediction.bead, prediction.mounting
    ink, needle = mounted.ink, mounted.needle
    if needle is None:
        return
    pressure = bead.pressure_pa * 1e-3
    if np.isnan(pressure).all():  # no ink comes (a firmware that refuses to push cold)
        return
    row = int(np.nanargmax(pressure))
    limit = mounted.syringe.max_pressure_kpa
    if limit is not None and pressure[row] > limit:
        yield BeadWarning(
            "pressure",
            int(bead.line[row]),
            f"{pressure[row]:.4g} kPa behind the needle, above {limit:g} kPa "
            f"({mounted.syringe.name}: max_pressure_kpa)",
            ink.calibrated,
        )
    row = int(bead.nozzle_flow_ul_s.argmax())
    flow = float(bead.nozzle_flow_ul_s[row])
    shear = wall_stress_pa(ink, needle.inner_mm, max(flow, 0.0))
    if ink.max_shear_stress_pa is not None and shear > ink.max_shear_stress_pa:
        yield BeadWarning(
            "shear",
            int(bead.line[row]),
            f"{shear:.4g} Pa at the needle's wall at {flow:.3g} µL/s, above "
            f"{ink.max_shear_stress_pa:g} Pa ({ink.name}: max_shear_stress_pa)",
            ink.calibrated,
        )


def _of_bath(prediction: InkPrediction, bath: Bath | None) -> Iterator[BeadWarning]:
    bead, ink, needle = prediction.bead, prediction.mounting.ink, prediction.mounting.needle
    if ink.swell_factor is None:
        yield BeadWarning(
            "swell", 0, f"how {ink.name} swells in the bath wasn't measured; taken as 1", False
        )
    else:
        factor, sure = swell(ink)
        yield BeadWarning("swell", 0, f"diameters in the bath are times {factor:g}", sure)
    if bath is None:
        return
    yield from _settles(prediction, bath)
    if needle is None:
        return
    trail = crevice(bead, needle, bath)
    if trail is not None and trail.opens:
        yield BeadWarning(
            "trail",
            trail.line,
            f"{bath.name} takes {bath.recovery_s:g} s to close, so the needle leaves "
            f"{trail.length_mm:.3g} mm of crevice behind at {trail.speed_mm_s:.3g} mm/s, more than "
            f"its own {needle.outer_mm:g} mm; write slower, or let the bath recover",
            bath.calibrated,
        )
    push = drag(bead, needle.outer_mm)
    if push.places:
        yield BeadWarning(
            "drag",
            push.line,
            f"the shaft passes {push.places} pieces of written ink within three of its radii; "
            f"nearest here, where it may push what line {push.dragged_line} wrote by "
            f"{push.worst_mm * 1e3:.0f} µm",
            False,
        )


def _settles(prediction: InkPrediction, bath: Bath) -> Iterator[BeadWarning]:
    ink = prediction.mounting.ink
    held = settling(prediction.bead, ink, bath)
    if held is None or held.held:
        return
    way = "rises" if held.up else "sinks"
    speed = held.speed_mm_s
    how = f"how fast isn't known ({bath.name}: viscosity_pa_s)"
    if speed is not None:
        how = f"at about {speed:.3g} mm/s at first"
    yield BeadWarning(
        "settles",
        held.line,
        f"a filament of {held.widest_mm:.3f} mm {way} in {bath.name}, which holds "
        f"{held.held_mm:.3f} mm; {how}",
        bath.calibrated and ink.calibrated,
    )


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
