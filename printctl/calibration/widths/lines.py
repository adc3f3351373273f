"""Fit flow factor, swelling and lag from lines printed at several speeds and flows.

A plunger's flow is known, so a line's cross-section is f m A: A the commanded one, m the line's own
multiple, f the flow factor. A filament that then swells s-fold is √(f m A 4/π) s wide: widths tell
f s², never f and s apart. Whether the cross-section follows Q/v is asked of the data:
ln(area/mA) = ln f s² + b ln v + c ln m, with b = c = 0 if it does.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from kernels.arrays import FloatArray
from printctl.calibration.estimate import Estimate, fit_line
from printctl.calibration.patterns import Pattern, Stroke, WrittenPattern
from printctl.calibration.widths.factors import GivenValues, factors
from printctl.calibration.widths.result import END, Answer, Change, Widths
from printctl.calibration.widths.steps import lag_change, lag_estimates, lag_notes, step_lag
from printctl.errors import UsageError

_BEGIN: Final = 0.5
"""Where a line is taken as steady when its lag isn't known; without need never before 0.3."""
_LAGS: Final = 5.0
"""Ways v τ after which a line is steady: e^-5 is 0.7 %."""
_LATEST: Final = 0.8
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


def fit_lines(written: WrittenPattern, widths: Widths, known: GivenValues) -> Answer:
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
        **lag_estimates(lag),
    }
    if lag is not None:
        notes += lag_notes(lag)
        changes = {**changes, **lag_change(lag, written)}
    missing = [why] if why else []
    return Answer(
        estimates, table, [*more, *notes, *missing, *speed_notes, *_UNTOLD], {**changes, **speeds}
    )


_UNTOLD: Final = (
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
        if any("doesn't follow" in text for text in notes):
            alone = whole.estimate(0, "")
            notes.append(
                "the factor holds in the middle of these speeds and flows; take it from lines at "
                "those of your print"
            )
    half = math.hypot((alone.high - alone.low) / 2, power * widths.optics)
    value, low, high = (math.exp(alone.value + side * half) for side in (0, -1, 1))
    return Estimate(value, low, high), notes


def _follows(name: str, slope: Estimate) -> str:
    if slope.holds(0.0):
        return f"the cross-section follows the {name} (power of {name} beyond it: {slope.text()})"
    why = {
        "speed": "drag, slip or threads that stretch at the fast end, a lag not over",
        "flow": "edges are read wider or narrower than they are, or a steady leak",
    }[name]
    return f"the cross-section doesn't follow the {name} (power beyond it: {slope.text()}): {why}"


def _speeds(lines: list[LineWidth], widths: Widths) -> tuple[dict[str, Change], list[str]]:
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
    change = Change(value, f"{held[0]:g} to {held[-1]:g} mm/s hold together")
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
