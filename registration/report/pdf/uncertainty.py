"""Fitted pose and its uncertainty as PDF table rows and facts, with reasons to doubt it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from registration.report.sections import Fact, mapping
from registration.report.wording import MISSING, fixed, is_number, number, plain

AXES = ("x", "y", "z")


def fitted_rows(registration: Mapping[str, Any]) -> list[tuple[str, str, str]]:
    """Name, value and half of the 95 % interval of everything that was fitted."""
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


def confidence_facts(registration: Mapping[str, Any]) -> list[Fact]:
    """Depth scale, ambiguity, cross-check, and how walls were taken."""
    made = []
    if registration.get("depth_scale_fitted") is not None:
        made.append(Fact("Depth scale fitted", plain(registration["depth_scale_fitted"])))
    ambiguity = mapping(registration, "ambiguity")
    if ambiguity:
        made.append(Fact("Pose ambiguous", plain(ambiguity.get("flag"))))
        if is_number(ambiguity.get("margin")):
            made.append(Fact("Margin to the best wrong pose", number(ambiguity["margin"], 3)))
    if mapping(registration, "lay"):
        made.append(Fact("The part lay", plain(registration["lay"]["words"])))
    if "cross_check_um" in registration:
        apart = registration["cross_check_um"]
        made.append(
            Fact("small_gicp has the part's corners within", number(apart, 2), "µm")
            if is_number(apart)
            else Fact("Cross-check by small_gicp", "not made")
        )
    if "walls" in registration:
        walls = registration["walls"]
        made.append(Fact("Calibration of walls", "none" if walls is None else plain(walls)))
    return made


def pose_doubts(registration: Mapping[str, Any]) -> list[str]:
    """What speaks against calling the pose sure, a sentence each."""
    doubts = mapping(registration, "ambiguity").get("doubts")
    return [plain(doubt) for doubt in doubts or ()]


def _three(values: Any) -> Sequence[Any]:
    known = list(values) if isinstance(values, list | tuple) else []
    return (known + [None] * 3)[:3]


def _half(width: Any, digits: int) -> str:
    return f"± {number(width, digits)}" if is_number(width) else MISSING


def _of_scale(width: Any, interval: Mapping[str, Any]) -> str:
    """A scale that has no interval where others have one wasn't fitted."""
    return "not fitted" if width is None and interval.get("scale") else _half(width, 2)
