"""Terminal text on vessels left unwritten and joints left open by an embedded toolpath."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any


def plan_lines(plan: Mapping[str, Any]) -> Iterator[str]:
    """Name every vessel that isn't written and every open joint, from ``summary.plan``."""
    left, cut = plan.get("left_out", ()), plan.get("cut_off", ())
    if left:
        yield (
            f"{len(left)} vessels aren't written, since the needle would pass through ink in any "
            f"order (toolpath.leave_out); {len(cut)} written ones lose their supply"
            + (f": {', '.join(map(str, cut))}" if cut else "")
        )
    yield from map(_left_out, left)
    for one in plan.get("open", ()):
        if "barred_by" in one:
            yield _open(one)


def _left_out(one: Mapping[str, Any]) -> str:
    text = (
        f"vessel {one['vessel']} isn't written: too near to vessel {one['other']} at "
        f"{_place(one)}; they would have to be at least {one['apart_mm']:.3f} mm further apart"
    )
    if one["needle_mm"] > 0:
        text += f", or the needle's tip {one['needle_mm']:.3f} mm wide outside"
    return text


def _open(one: Mapping[str, Any]) -> str:
    text = f"joint of vessels {one['vessel']} and {one['other']} at {_place(one)} stays open"
    if one["barred_by"] >= 0:
        text += f": vessel {one['barred_by']} is in the shaft's way on either side"
    if one["needle_mm"] > 0:
        text += (
            f"; a quarter of the overlap has room with that vessel {one['apart_mm']:.3f} mm "
            f"further off sideways, or a tip {one['needle_mm']:.3f} mm wide outside"
        )
    return text


def _place(one: Mapping[str, Any]) -> str:
    x, y, z = one["place_mm"]
    return f"({x:.2f}, {y:.2f}, {z:.2f}) mm"
