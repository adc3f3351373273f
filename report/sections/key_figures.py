"""Pick the report's key figures: RMS deviation, open vessels, diameter error, pressure drop etc."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from registration.json_ready import is_number
from report.sections.facts import mapping, records, surfaces
from report.wording import duration, number, plain


@dataclass(frozen=True)
class KeyFigure:
    """A number for the top of the page."""

    label: str
    value: str
    unit: str = ""
    note: str = ""


def key_figures(data: Mapping[str, Any]) -> list[KeyFigure]:
    """The handful of numbers a reader wants first."""
    made = [_rms(data), _within(data), _open_vessels(data), _worst_error(data),
            _pressure(data), _shear(data), _time(data)]  # fmt: skip
    return [figure for figure in made if figure is not None]


def _rms(data: Mapping[str, Any]) -> KeyFigure | None:
    fits = mapping(data, "registration")
    rigid, scaled = mapping(fits, "rigid").get("rms_um"), mapping(fits, "scaled").get("rms_um")
    if not is_number(rigid):
        return None
    note = f"{number(scaled, 3)} µm with scales fitted" if is_number(scaled) else ""
    return KeyFigure("RMS deviation, rigid", number(rigid, 3), "µm", note)


def _within(data: Mapping[str, Any]) -> KeyFigure | None:
    of, part = next(iter(surfaces(mapping(data, "registration")).items()))
    within = mapping(mapping(part, "rigid"), "within")
    bounds = [key for key in within if is_number(within[key]) and key.isdecimal()]
    if not bounds:
        return None
    widest = max(bounds, key=float)
    rest = [f"{number(100 * within[k], 3)} % within {k}" for k in bounds if k != widest]
    return KeyFigure(
        f"{of} within ± {widest} µm".strip().capitalize(),
        number(100 * within[widest], 3),
        "%",
        " · ".join(rest),
    )


def _open_vessels(data: Mapping[str, Any]) -> KeyFigure | None:
    known = [
        r for r in records(mapping(data, "registration"), "vessels")
        if isinstance(r.get("open"), bool)
    ]  # fmt: skip
    if not known:
        return None
    closed = [plain(r.get("vessel")) for r in known if not r["open"]]
    note = f"blocked: {', '.join(closed[:6])}{' …' if len(closed) > 6 else ''}" if closed else ""
    count = f"{len(known) - len(closed)} of {len(known)}"
    if mapping(data, "registration").get("written") == "cords":
        return KeyFigure("Cords unbroken", count, "", note.replace("blocked", "broken"))
    return KeyFigure("Vessels open", count, "", note)


def _worst_error(data: Mapping[str, Any]) -> KeyFigure | None:
    known = [
        r for r in records(mapping(data, "registration"), "vessels")
        if is_number(r.get("error_percent"))
    ]  # fmt: skip
    if not known:
        return None
    worst = max(known, key=lambda r: abs(float(r["error_percent"])))
    value = number(worst["error_percent"], 3)
    sign = "+" if worst["error_percent"] > 0 else ""
    note = f"vessel {plain(worst.get('vessel'))}"
    return KeyFigure("Largest error of a mean diameter", sign + value, "%", note)


def _pressure(data: Mapping[str, Any]) -> KeyFigure | None:
    flow = mapping(data, "flow")
    drop, inlet = flow.get("pressure_drop_mmhg"), flow.get("inlet_flow_ml_min")
    if not is_number(drop):
        return None
    note = f"at {number(inlet, 3)} mL/min" if is_number(inlet) else ""
    return KeyFigure("Pressure drop, designed", number(drop, 3), "mmHg", note)


def _shear(data: Mapping[str, Any]) -> KeyFigure | None:
    """Wall area within the band of wall shear that the recipe asks for."""
    band = mapping(mapping(data, "flow"), "shear_band")
    inside, low, high = (band.get(k) for k in ("area_inside", "low_dyn_cm2", "high_dyn_cm2"))
    if not is_number(inside):
        return None
    below, above = (number(100 * band[f"area_{k}"], 3) for k in ("below", "above"))
    note = f"{below} % below, {above} % above: {plain(band.get('verdict'))}"
    label = f"Wall area at {number(low, 3)} to {number(high, 3)} dyn/cm²"
    return KeyFigure(label, number(100 * inside, 3), "%", note)


def _time(data: Mapping[str, Any]) -> KeyFigure | None:
    seconds = mapping(data, "print").get("duration_s", mapping(data, "dry_run").get("duration_s"))
    ink = mapping(data, "toolpath").get("written_ul")
    needed = mapping(data, "dry_run").get("ink_needed_ul")
    if not is_number(seconds):
        return None
    note = f"{number(ink, 3)} µL of ink" if is_number(ink) else ""
    if note and is_number(needed):
        note += f", {number(needed, 3)} µL to be loaded"
    return KeyFigure("Print time", duration(seconds), "", note)
