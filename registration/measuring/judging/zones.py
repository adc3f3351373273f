"""Judge geometric characteristics (ISO 1101) against their tolerances: pass, fail, undecided."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from registration.measuring.judging.decisions import ORDER, Decision, decide, single_width
from registration.measuring.judging.features import Feature
from registration.measuring.judging.rule import Rule
from registration.measuring.judging.tolerance import Tolerances

Record = Mapping[str, Any]

FACE_SEEN = 0.95
"""Share of a face that must be seen for a pass."""
_LIMITS = {
    "axis": "position_um",
    "port": "port_position_um",
    "cylindricity": "cylindricity_um",
    "lumen": "profile_um",
}


def judged_zones(
    rows: Sequence[Record], kinds: Mapping[int, str], tolerances: Tolerances
) -> tuple[list[dict[str, Any]], list[Feature]]:
    """Return characteristics with limit and decision, and the features of those that have one.

    Parameters
    ----------
    rows : sequence of mappings
        ``characteristics`` of a registration.
    kinds : mapping of int to str
        Of the vessels.
    tolerances : Tolerances
    """
    judged, features = [], []
    for row in rows:
        limit = _limit(row, kinds, tolerances)
        plain: dict[str, Any] = {**row, "limit_um": None, "decision": None}
        if math.isfinite(limit) and not str(row.get("note", "")).startswith("not defined"):
            feature = _feature(row, limit, tolerances.limits.rule)
            features.append(feature)
            plain |= {"limit_um": limit, "decision": feature.decision}
        judged.append(plain)
    return judged, features


def _limit(row: Record, kinds: Mapping[int, str], tolerances: Tolerances) -> float:
    if row["name"] == "face":
        return tolerances.face_profile_um
    vessel = int(row["vessel"])
    return float(getattr(tolerances.of(vessel, kinds[vessel]), _LIMITS[row["name"]]))


def _feature(row: Record, limit: float, rule: Rule) -> Feature:
    low, high = row["interval_95_um"]
    known = row["zone_um"] is not None and low is not None and high is not None
    return Feature(
        name="zone",
        decision=_decision(row, float(low), float(high), limit, rule) if known else "undecided",
        vessel=row["vessel"],
        value_um=row["zone_um"],
        upper_um=limit,
        limit=f"at most {limit:g} µm",
        words=str(row["characteristic"]),
        of=str(row["feature"]),
        interval_um=(low, high) if known else (),
    )


def _decision(row: Record, low: float, high: float, limit: float, rule: Rule) -> Decision:
    """Decide by the interval; of a face that wasn't all seen no pass is proven."""
    middle, half = (low + high) / 2, (high - low) / 2
    code = decide(
        rule, np.array([middle]), np.array([half]), np.array([single_width(half)]),
        np.array([math.inf]), np.array([limit]),
    )  # fmt: skip
    decision = ORDER[int(code[0])]
    unseen = row["name"] == "face" and row["seen_fraction"] < FACE_SEEN
    return "undecided" if decision == "pass" and unseen else decision
