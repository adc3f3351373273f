"""Fit flow factor, swelling and lag to a calibration print's line widths."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from scipy.optimize import least_squares

from firmware_profiles import Needle, Syringe, load
from kernels.arrays import FloatArray
from printctl.calibration.estimate import Estimate, fit_line, quantile
from printctl.calibration.patterns import Pattern, Stroke, WrittenPattern
from printctl.calibration.results import Result, measured_lag
from printctl.calibration.widths.meetings import fit_bridge, fit_comb, fit_joint
from printctl.calibration.widths.one_width import GivenValues, factors
from printctl.calibration.widths.result import END, Replies, Widths
from printctl.calibration.widths.step_lag import lag_notes, step_lag
from printctl.calibration.writing import MeasuredValue
from printctl.errors import UsageError

# A plunger's flow is known, so a line's cross-section is f m A: A the commanded one, m the line's
# own multiple, f the flow factor. A filament that then swells s-fold is √(f m A 4/π) s wide: widths
# tell f s², never f and s apart. Whether the cross-section follows Q/v is asked of the data:
# ln(area/mA) = ln f s² + b ln v + c ln m, with b = c = 0 if it does.
_BEGIN: Final = 0.5
"""Where a line is taken as steady when its lag isn't known; without need never before 0.3."""
_LAGS: Final = 5.0
"""Ways v τ after which a line is steady: e^-5 is 0.7 %."""
_LATEST: Final = 0.8
_MAX_FLOW_POWER: Final = 0.5
"""Power of the flow beyond the expected 1: edges read a tenth too wide or narrow make 0.2."""
HELD: Final = 0.97
"""Of its length, a line that holds together."""


@dataclass(frozen=True)
class LineWidth:
    """One line's steady width.

    Attributes
    ----------
    stroke : Stroke
    width_mm, spread_mm : float, mm
        Median, and 1.48 times the median deviation; NaN where none was measured.
    count : int
        Places.
    """

    stroke: Stroke
    width_mm: float
    spread_mm: float
    count: int

    @property
    def speed_mm_s(self) -> float:
        """Of writing."""
        return float(self.stroke.speed_mm_s[0])


def fit_lines(written: WrittenPattern, widths: Widths, known: GivenValues) -> Result:
    """Fit all that lines tell.

    Raises
    ------
    UsageError
        With fewer than two lines to go by.
    """
    pattern = written.pattern
    lag, why = step_lag(pattern, widths)
    tau = None if lag is None else max(lag.rise_s.value, lag.fall_s.value)
    lines = [steady(stroke, widths, tau) for stroke in pattern.of_role("line")]
    table = _table(pattern, lines, widths)
    good = [one for one in lines if one.count and widths.found.get(one.stroke.number, 1) >= HELD]
    if len(good) < 2:
        raise UsageError(
            f"{len(good)} of {len(lines)} lines have widths in their steady part; two are needed, "
            "better six\n" + "\n".join(table)
        )
    share, notes = _share(pattern, good, widths)
    factor_estimates, changes, more = factors(share, written, known)
    speeds, speed_notes = _speeds(lines, widths)
    estimates = {
        "cross-section over the commanded one": share,
        **factor_estimates,
        **({} if lag is None else lag.estimates()),
    }
    if lag is not None:
        notes += lag_notes(lag)
        used = written.mounted
        mounted = load(Needle, used.needle), load(Syringe, used.syringe)
        changes = {**changes, **measured_lag(lag, *mounted)}
    missing = [why] if why else []
    return Result(
        estimates,
        [*more, *notes, *missing, *speed_notes, *_RHEOLOGY_UNKNOWN_NOTES],
        measured={**changes, **speeds},
        table=table,
    )


_RHEOLOGY_UNKNOWN_NOTES: Final = (
    "a plunger sets the flow, so these widths say nothing of the ink's viscosity, power law or "
    "yield stress (viscosity_pa_s, flow_index, yield_stress_pa): these take pressures, a rheometer",
)


def steady(stroke: Stroke, widths: Widths, lag_s: float | None) -> LineWidth:
    """Median width where the flow has settled; none where the line ends before."""
    x, width = widths.of(stroke.number)
    length = stroke.length_mm
    begin = _BEGIN * length
    if lag_s is not None:
        begin = max(0.3 * length, _LAGS * float(stroke.speed_mm_s[0]) * lag_s)
    kept = width[(x >= begin) & (x <= END * length)]
    if not len(kept) or begin > _LATEST * length:
        return LineWidth(stroke, math.nan, math.nan, 0)
    middle = float(np.median(kept))
    return LineWidth(stroke, middle, 1.4826 * float(np.median(np.abs(kept - middle))), len(kept))


def _share(pattern: Pattern, lines: list[LineWidth], widths: Widths) -> tuple[Estimate, list[str]]:
    """Cross-section over what was commanded, of all lines; and whether it follows Q/v."""
    speed = np.array([one.speed_mm_s for one in lines])
    flow = np.array([one.stroke.flow for one in lines])
    width = np.array([one.width_mm for one in lines])
    y = np.log(pattern.bead.share(width) / flow)
    power = 2.0 if pattern.bead.round_bead else 1.0
    # A median of a line's places is finer than one reading, as long as they scatter.
    digit = power * widths.last_digit_mm / float(np.median(width))
    alone = fit_line(np.ones((len(y), 1)), y, "widths", digit).estimate(0, "")
    notes = []
    columns, names = [np.ones(len(y))], []
    for name, values in (("speed", speed), ("flow", flow)):
        if np.ptp(np.log(values)) > 0.05:
            columns.append(np.log(values / np.exp(np.log(values).mean())))
            names.append(name)
    if names and len(y) <= len(columns) + 1:
        notes.append(
            f"{len(y)} lines are too few to ask whether the cross-section follows the "
            f"{' and the '.join(names)} (--repeats)"
        )
    elif names:
        whole = fit_line(np.column_stack(columns), y, "widths", digit)
        for k, name in enumerate(names, start=1):
            notes.append(_follows(name, whole.estimate(k, "")))
            if name == "flow":
                _refuse_other_order(whole.estimate(k, ""))
        if any("doesn't follow" in text for text in notes):
            alone = whole.estimate(0, "")
            notes.append(
                "the factor holds in the middle of these speeds and flows; take it from lines at "
                "those of your print"
            )
    half = math.hypot((alone.high - alone.low) / 2, power * widths.optics)
    value, low, high = (math.exp(alone.value + side * half) for side in (0, -1, 1))
    return Estimate(value, low, high), notes


def _refuse_other_order(power: Estimate) -> None:
    """Raise `UsageError` for widths that can't be those of the flows beside them."""
    if power.high < -_MAX_FLOW_POWER or power.low > _MAX_FLOW_POWER:
        raise UsageError(
            f"the lines' cross-section goes by the flow to the power {1 + power.value:.2g}, not 1: "
            "the widths are in another order than the lines, or typed from one line alone; check "
            "the sheet against the drawing"
        )


def _follows(name: str, slope: Estimate) -> str:
    if slope.holds(0.0):
        return f"the cross-section follows the {name} (power of {name} beyond it: {slope.text()})"
    why = {
        "speed": "drag, slip or threads that stretch at the fast end, a lag not over",
        "flow": "edges are read wider or narrower than they are, or a steady leak",
    }[name]
    return f"the cross-section doesn't follow the {name} (power beyond it: {slope.text()}): {why}"


def _speeds(lines: list[LineWidth], widths: Widths) -> tuple[dict[str, MeasuredValue], list[str]]:
    """Speeds at which every line of at least the commanded flow holds together."""
    if not widths.found:
        return {}, ["typed widths don't say whether a line is whole (write_speed_mm_s): look"]
    whole: dict[float, bool] = {}
    for one in lines:
        if one.stroke.flow >= 1:
            good = widths.found.get(one.stroke.number, 0.0) >= HELD
            whole[one.speed_mm_s] = whole.get(one.speed_mm_s, True) and good
    held = sorted(speed for speed, good in whole.items() if good)
    broken = sorted(speed for speed, good in whole.items() if not good)
    notes = [f"lines break or are missing at {', '.join(f'{v:g}' for v in broken)} mm/s"] * bool(
        broken
    )
    if len(held) < 2 or any(held[0] < speed < held[-1] for speed in broken):
        return {}, notes
    text = f"lines hold together from {held[0]:g} to {held[-1]:g} mm/s, all that was tried"
    if broken:
        text = f"lines hold together from {held[0]:g} to {held[-1]:g} mm/s"
    value = {"low": held[0], "high": held[-1]}
    change = MeasuredValue(value, f"{held[0]:g} to {held[-1]:g} mm/s hold together")
    return {"write_speed_mm_s": change}, [*notes, text]


def _table(pattern: Pattern, lines: list[LineWidth], widths: Widths) -> list[str]:
    rows = ["line  mm/s  flow  commanded   width  spread  (µm)"]
    for one in lines:
        aim = pattern.bead.width_at(one.stroke.flow) * 1e3
        begin = f"{one.stroke.number:4}  {one.speed_mm_s:4g}  {one.stroke.flow:4g}  {aim:9.1f}"
        share = widths.found.get(one.stroke.number)
        part = "" if share is None or share >= HELD else f"  ink at {share:.0%} of its length"
        if one.count:
            rows.append(f"{begin}  {one.width_mm * 1e3:6.1f}  {one.spread_mm * 1e3:6.1f}{part}")
        else:
            why = part or "  no width in its steady part: its lag isn't over, or none was given"
            rows.append(f"{begin}       -       -{why}")
    return rows


def shares_along(pattern: Pattern, stroke: Stroke, widths: Widths) -> tuple[FloatArray, FloatArray]:
    """Time since a stroke's begin, s, and cross-section over the commanded one, both (n,)."""
    x, width = widths.of(stroke.number)
    kept = x <= END * stroke.length_mm
    return x[kept] / float(stroke.speed_mm_s[0]), pattern.bead.share(width[kept]) / stroke.flow


# Cross-section over the commanded one, t seconds after the begin:
#
# G (1 + k t) (1 − c e^(−t/τ))
#
# with G = f s², k the drift, c what is missing at the begin: the prime fills some of it, so c is
# free.
_FEWEST: Final = 8
_BLOB: Final = 3.0
"""Widths from its begin in which a line has a shape of its own: the tip starts to move."""
_STARTS: Final = (0.1, 0.5, 2.0)
_UNRESOLVED: Final = 3.0


def fit_spiral(written: WrittenPattern, widths: Widths, known: GivenValues) -> Result:
    """Fit flow factor, drift and, where its begin is thin, the lag.

    Raises
    ------
    UsageError
        With too few widths.
    """
    pattern = written.pattern
    (stroke,) = pattern.of_role("spiral")
    time, share = shares_along(pattern, stroke, widths)
    if len(time) < _FEWEST:
        raise UsageError(f"{len(time)} widths along the spiral; measure {_FEWEST} or more")
    blob = _BLOB * pattern.bead.width_mm / float(stroke.speed_mm_s[0])
    tau, notes = _begin(time[time > blob], share[time > blob])
    settled = time >= (0.1 * time[-1] if tau is None else _LAGS * tau.value)
    if settled.sum() < _FEWEST:
        raise UsageError("the spiral's flow hasn't settled before it ends; print more turns")
    late, area = time[settled], share[settled]
    middle = float(late.mean())
    digit = 2 * widths.last_digit_mm / pattern.bead.width_mm * float(np.median(area))
    fit = fit_line(np.column_stack([np.ones(len(late)), late - middle]), area, "spiral", digit)
    level, slope = fit.estimate(0, ""), fit.estimate(1, "")
    half = math.hypot((level.high - level.low) / 2, 2 * widths.optics * level.value)
    total = Estimate(level.value, level.value - half, level.value + half)
    drift = slope.times(60 * 100 / level.value, "% a minute")
    factor_estimates, changes, more = factors(total, written, known)
    estimates = {"cross-section over the commanded one": total, **factor_estimates, "drift": drift}
    if tau is not None:
        estimates["τ, from its begin"] = tau
    if not drift.holds(0.0):
        notes.append("the flow drifts: warmth, a syringe that gives way, ink that settles or sets")
    return Result(estimates, [*more, *notes], measured=changes)


def _begin(time: FloatArray, share: FloatArray) -> tuple[Estimate | None, list[str]]:
    """τ from the line's thin begin; None where it isn't thin enough to tell."""
    if len(time) < _FEWEST:
        return None, [_NO_THIN_BEGIN_NOTE]

    def model(p: FloatArray) -> FloatArray:
        return np.asarray(p[0] * (1 + p[1] * time) * (1 - p[2] * np.exp(-time / np.exp(p[3]))))

    level = float(np.median(share))
    tries = [
        least_squares(
            lambda p: model(p) - share,
            [level, 0.0, 0.5, math.log(start)],
            bounds=([0, -1, -2, math.log(1e-3)], [10 * level, 1, 1, math.log(max(time[-1], 1))]),
            x_scale=[level, 0.01, 0.5, 1.0],
        )
        for start in _STARTS
    ]
    best = min(tries, key=lambda one: float(one.cost))
    dof = len(time) - 4
    try:
        inverse = np.linalg.inv(best.jac.T @ best.jac)
    except np.linalg.LinAlgError:
        return None, [_NO_THIN_BEGIN_NOTE]
    half = quantile(dof) * np.sqrt(np.maximum(np.diag(inverse), 0) * 2 * best.cost / dof)
    missing, log_tau = float(best.x[2]), float(best.x[3])
    if not np.isfinite(half).all() or missing <= half[2] or half[3] > math.log(_UNRESOLVED):
        return None, [_NO_THIN_BEGIN_NOTE]
    value, low, high = (math.exp(log_tau + side * half[3]) for side in (0, -1, 1))
    note = (
        f"the spiral begins with {missing:.0%} of its flow missing; the lag of a begin takes the "
        "prime's place with it, so it isn't written (lines with --steps give one that is)"
    )
    return Estimate(value, low, high, "s"), [note]


_NO_THIN_BEGIN_NOTE: Final = (
    "the spiral's begin isn't thin enough to tell a lag: the prime fills it, or it is shorter than "
    "the places lie apart"
)
VAGUE: Final = 0.05
"""Half of a picture's relative 95 % interval of widths beyond which no factor is written."""
_BY_WIDTH: Final = ("bead", "flow_factor", "swell_factor")


def fit_measured(written: WrittenPattern, measured: Widths | Replies, known: GivenValues) -> Result:
    """Fit a pattern's widths (lines, spiral) or replies (comb, joints, bridges).

    Raises
    ------
    UsageError
        With too few widths, or widths that no ink has.
    """
    if isinstance(measured, Replies):
        fit_answers = {"comb": fit_comb, "joint": fit_joint}.get(written.pattern.name, fit_bridge)
        return fit_answers(written, measured)
    fit = fit_spiral if written.pattern.name == "spiral" else fit_lines
    answer, optics = fit(written, measured, known), measured.optics
    return answer if optics <= VAGUE else _kept_from_profiles(answer, optics)


def _kept_from_profiles(answer: Result, optics: float) -> Result:
    """Without the factors, which rest on the absolute width; a lag rests on its changes."""
    changes = {key: one for key, one in answer.measured.items() if key not in _BY_WIDTH}
    note = (
        f"flow factor and swelling aren't written: the picture leaves all widths uncertain by "
        f"{optics:.0%} ({VAGUE:.0%} at most)"
    )
    return replace(answer, measured=changes, notes=[*answer.notes, note])
