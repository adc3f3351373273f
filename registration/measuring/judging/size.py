"""Judge the print's size along each axis, and how far it lies off the design unstretched."""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from registration.json_ready import Record
from registration.measuring.judging.decisions import ORDER, Decision, decide, single_width
from registration.measuring.judging.features import Feature, rms_feature
from registration.measuring.judging.tolerance import Rule, Tolerances

AXES: Final = "xyz"


def size_features(numbers: Record, tolerances: Tolerances) -> list[Feature]:
    """Return the decisions on the size along x, y, z and on the RMS of the rigid fit.

    A frame that is laid on datums isn't fitted, so that its RMS has no limit.

    An end that lies off by less than the surface may isn't a wrong size: along a short axis the
    limit is the RMS tolerance. Lengths along the light of an OCT without a depth standard rest on
    the refractive index, whose interval alone is as wide as the usual limit: there a pass is
    simple acceptance (JCGM 106, 8.2), which its words state, and a fail is proven as elsewhere.
    An axis that was too short to fit has no size; the rigid fit's RMS limits what it may be off.

    Parameters
    ----------
    numbers : mapping
        Of a registration; reports from before ``size_mm`` have no size to judge.
    tolerances : Tolerances
    """
    rule, sizes = tolerances.limits.rule, numbers.get("size_mm")
    features = []
    if sizes and math.isfinite(tolerances.size_percent):
        halves = numbers["interval_95"]["scale"]
        fitted = [axis for axis in range(3) if halves[axis] is not None]
        features = [_along(numbers, axis, 1e3 * sizes[axis], tolerances) for axis in fitted]
    limit, best_fit = tolerances.rigid_limit_um, not (numbers.get("frame") or {}).get("datums")
    if best_fit and math.isfinite(limit):
        interval = numbers.get("rms_interval_95_um", 0.0)
        rigid = rms_feature(rule, numbers["rigid"]["rms_um"], interval, limit, "rigid")
        features.append(rigid)
    return features


def _along(numbers: Record, axis: int, size_um: float, tolerances: Tolerances) -> Feature:
    """Judge the size along one axis."""
    off = (numbers["scale"][axis] - 1) * size_um
    u = numbers["interval_95"]["scale"][axis] * size_um
    along_light = numbers["lay"]["depth_axis"] == AXES[axis]
    by_index = along_light and bool(numbers.get("depth_from_index"))
    limit = max(tolerances.size_percent / 100 * size_um, tolerances.rms_um)
    decision = _decided(tolerances.limits.rule, off, u, limit)
    accepted = by_index and decision == "undecided" and abs(off) <= limit
    return Feature(
        "size",
        "pass" if accepted else decision,
        value_um=off,
        u_um=u,
        lower_um=-limit,
        upper_um=limit,
        designed_um=size_um,
        limit=f"±{100 * limit / size_um:.3g} %",
        doubt="index" if accepted else "",
        of=AXES[axis],
        words=_remedy(numbers, AXES[axis]) if decision == "undecided" else "",
    )


def _remedy(numbers: Record, axis: str) -> str:
    """Return what narrows the interval of an axis' size most, as its budget says."""
    budgets = {budget["quantity"]: budget for budget in numbers.get("budget", ())}
    return str(budgets.get(f"scale_{axis}", {}).get("reduce", ""))


def _decided(rule: Rule, off: float, u: float, limit: float) -> Decision:
    values = (np.array([v]) for v in (off, u, single_width(u), limit, limit))
    return ORDER[int(decide(rule, *values)[0])]
