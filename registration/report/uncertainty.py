"""Report rows of what was fitted and its uncertainty, of calibrations and of the print."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from typing import Any

from registration.report.sections import Fact, mapping
from registration.report.wording import MISSING, fixed, is_number, number, plain

AXES = ("x", "y", "z")


def fitted_rows(registration: Mapping[str, Any]) -> list[tuple[str, str, str]]:
    """Return name, value and half of the 95 % interval of everything that was fitted."""
    interval = mapping(registration, "interval_95")
    scale, half = _three(registration.get("scale")), _three(interval.get("scale"))
    rows = [
        (f"Scale along {axis} (scan over design)", fixed(value, 5), _of_scale(width, interval))
        for axis, value, width in zip(AXES, scale, half, strict=True)
        if is_number(value)
    ]
    if is_number(registration.get("offset_um")):
        value, width = registration["offset_um"], interval.get("offset_um")
        rows.append(("Radial offset / µm", fixed(value, 2), _half(width, 2)))
    for key, label in (
        ("shift_um", "Place of the part's middle along {} / µm"),
        ("rotation_deg", "Rotation about {} / °"),
    ):
        rows += [
            (label.format(axis), "", _half(width, 2))
            for axis, width in zip(AXES, _three(interval.get(key)), strict=True)
            if is_number(width)
        ]
    return rows


def calibration_facts(registration: Mapping[str, Any]) -> list[Fact]:
    """Return whether the depth scale was fitted, and by which calibration walls were taken."""
    rows = []
    if registration.get("depth_scale_fitted") is not None:
        rows.append(Fact("Depth scale fitted", plain(registration["depth_scale_fitted"])))
    if "walls" in registration:
        walls = registration["walls"]
        rows.append(Fact("Calibration of walls", "none" if walls is None else plain(walls)))
    return rows


def print_facts(data: Mapping[str, Any]) -> list[Fact]:
    """Return when and as what a part was printed, and SHA-256 of its network and G-code."""
    printed = mapping(data, "printed")
    started = printed.get("started")
    design = mapping(mapping(data, "registration"), "design")
    when = datetime.fromtimestamp(started, UTC) if is_number(started) else None
    rows = (
        ("Printed", when and when.strftime("%Y-%m-%d %H:%M UTC")),
        ("Print", printed.get("id")),
        ("SHA-256 of G-code", printed.get("gcode_sha256")),
        ("SHA-256 of network.csv", design.get("network_sha256")),
    )
    return [Fact(label, plain(value)) for label, value in rows if value]


def _three(values: Any) -> Sequence[Any]:
    known = list(values) if isinstance(values, list | tuple) else []
    return (known + [None] * 3)[:3]


def _half(width: Any, digits: int) -> str:
    return f"± {number(width, digits)}" if is_number(width) else MISSING


def _of_scale(width: Any, interval: Mapping[str, Any]) -> str:
    """A scale that has no interval where others have one wasn't fitted."""
    return "not fitted" if width is None and interval.get("scale") else _half(width, 2)
