"""Causes that most of a print's deviations have in common."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from kernels.arrays import FloatArray
from printctl.pipeline.judging.premises import Finding
from registration.json_ready import Record

ALIKE: Final = 0.25
"""Scatter of the lumens' deviations, of their mean, within which one number describes them all."""
FEWEST_ALIKE: Final = 3
"""Lumens of a layered print that are one cause."""
THROUGHOUT: Final = 0.8
"""Of a vessel's sections that are off to one side: the vessel is, not a place of it."""


def print_faults(registration: Record) -> list[Finding]:
    """Say where the print ended early, or from which height on it was shifted sideways."""
    printed = registration.get("as_printed") or {}
    found: list[Finding] = []
    if printed.get("ends_mm") is not None:
        found.append(
            (
                "fail",
                f"The print ends at z = {printed['ends_mm']:.2f} mm, "
                f"{printed['missing_mm']:.2f} mm below the top of the design: nothing was "
                "deposited above (clogged needle, empty syringe, or the job was cancelled)",
            )
        )
    if printed.get("shift"):
        found.append(_shifted(registration, printed["shift"]))
    return found


def _shifted(registration: Record, shift: Record) -> Finding:
    """Fail where the shift is beyond what the whole surface may be off by."""
    what = "Lumens" if of_lumens(registration) else "Layers"
    up = "up" if shift["to_mm"] is None else f"to {shift['to_mm']:.2f} mm"
    moved, halves = shift["shift_um"], shift["interval_95_um"]
    each = ", ".join(
        f"{axis} {by:+.0f} ± {max(half, 1):.0f} µm".replace("-", "\N{MINUS SIGN}")
        for axis, by, half in zip("xy", moved, halves, strict=True)
    )
    limit = registration["judging"]["tolerances"].get("rms_um")
    beyond = limit is not None and np.hypot(*moved) - np.hypot(*halves) > limit
    text = (
        f"{what} from z = {shift['from_mm']:.2f} mm {up} are shifted sideways by {each}: the axes "
        "lost steps, or the part moved; check belts, motor currents, acceleration and the dish"
    )
    return ("fail" if beyond else "pass", text)


def of_lumens(registration: Record) -> bool:
    """Whether the lumens alone were scanned, as of an embedded print."""
    surfaces = registration.get("by_surface") or {}
    return "outer_faces" in surfaces and surfaces["outer_faces"] is None


def common_causes(registration: Record, worst: Sequence[Record]) -> list[str]:
    """Say by how much most lumens are off alike, and what does that.

    Parameters
    ----------
    registration : dict
        Judged.
    worst : sequence of dict
        Features that don't pass.
    """
    rows = {r["vessel"]: r for r in registration["vessels"] if r.get("measured_um")}
    off = {
        f["vessel"]: f["value_um"] for f in worst if f["name"] in ("section", "mean", "narrowest")
    }
    for side, word in ((-1, "narrower"), (1, "wider")):
        alike = [rows[v] for v, value in off.items() if v in rows and side * value > 0]
        alike = [row for row in alike if side * row["error_percent"] > 0 and _all_along(row, side)]
        # Of one or two vessels, only what fills them says why: a filament's own volume.
        few = 1 if of_lumens(registration) else FEWEST_ALIKE
        if len(alike) >= few and 2 * len(alike) > len(rows):
            many = (
                ("All" if len(alike) == len(rows) else f"{len(alike)} of")
                + f" {len(rows)} lumens are"
                if len(rows) > 1
                else "The lumen is"
            )
            return _alike(registration, alike, f"{many} {word} than designed")
    return []


def _all_along(row: Record, side: int) -> bool:
    """Whether a vessel is off to one side along its length: a width, not a place."""
    off = np.array(row["diameter_um"]) - np.array(row["designed_along_um"])
    known = off[np.isfinite(off)]
    return len(known) > 0 and float((side * known > 0).mean()) >= THROUGHOUT


def _alike(registration: Record, rows: Sequence[Record], text: str) -> list[str]:
    """Say what one number describes of these lumens; nothing where none does."""
    measured = np.array([row["measured_um"] for row in rows])
    designed = np.array([row["designed_um"] for row in rows])
    half = np.array([row.get("measured_interval_95_um") or np.nan for row in rows])
    if np.isnan(half).any():
        return []
    part = _part_scale(registration)
    share = np.log(measured / designed)
    percent = f"{100 * abs(np.expm1(np.median(share))):.1f} %"
    if abs(np.log(part) - share.mean()) <= ALIKE * abs(share.mean()):
        word = "shrank" if part < 1 else "swelled"
        shrunk = f"as the whole part {word} (by {100 * abs(part - 1):.1f} %)"
        return [f"{text} throughout, by {percent}, {shrunk}"]
    if of_lumens(registration):
        factor = _mean(share - np.log(part), half / measured)
        if factor is None:
            return []
        # A filament of volume V per length has the diameter 2 √(V/π).
        flow, u = np.exp(2 * factor[0]), 2 * factor[1]
        return [
            f"{text} by one common factor, {np.exp(factor[0]):.3f}: the ink's flow was "
            f"{100 * flow:.0f} ± {max(100 * flow * u, 1):.0f} % of the planned (wrong syringe, "
            "steps/mm or flow rate?)"
        ]
    walls = _mean(measured - designed, half)
    if walls is not None:
        by = f"{abs(walls[0]):.0f} ± {walls[1]:.0f} µm, whatever their diameter"
    elif _mean(share, half / measured) is not None:
        by = f"{percent}, each by as much of its diameter"
    else:
        return []
    lines = "wider" if share.mean() < 0 else "narrower"
    size = f"{100 * (part - 1):+.1f} %".replace("-", "\N{MINUS SIGN}")
    return [
        f"{text} by {by}, and the whole part is off by {size}, so it isn't shrinkage: the printed "
        f"lines are {lines} than planned; check the ink's flow (syringe, steps/mm, flow rate) and "
        "the line width"
    ]


def _mean(values: FloatArray, half: FloatArray) -> tuple[float, float] | None:
    """Mean with the half width of its 95 % interval; None where it doesn't describe them all.

    Values scatter beyond their own intervals (DerSimonian & Laird 1986,
    10.1016/0197-2456(86)90046-2); what they share isn't averaged away, so the interval is at least
    the least of theirs.
    """
    variance = (np.maximum(half, 1e-9) / 1.96) ** 2
    weight = 1 / variance
    mean = float(np.average(values, weights=weight))
    excess = float((weight * (values - mean) ** 2).sum()) - (len(values) - 1)
    spare = float(weight.sum() - (weight**2).sum() / weight.sum())
    between = max(excess / spare, 0.0) if spare > 0 else 0.0
    weight = 1 / (variance + between)
    mean = float(np.average(values, weights=weight))
    interval = max(1.96 * float(weight.sum()) ** -0.5, float(half.min()))
    if np.sqrt(between) > ALIKE * abs(mean) or interval >= abs(mean):
        return None
    return mean, interval


def _part_scale(registration: Record) -> float:
    """Return the part's fitted size over the design's, the mean of the axes that were fitted."""
    scale = registration.get("scale")
    if not scale:
        return 1.0
    halves = (registration.get("interval_95") or {}).get("scale") or [None] * 3
    fitted = [one for one, half in zip(scale, halves, strict=True) if half is not None]
    return float(np.mean(fitted or scale))
