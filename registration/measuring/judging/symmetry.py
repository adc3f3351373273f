"""Hold a verdict against every pose in which a symmetric design is the same.

In each of these the surface fits alike, and lumens have exchanged their numbers: what was measured
of one vessel may be of another, with that one's design and limits.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

from registration.alignment.search import AlignmentOptions
from registration.json_ready import Record
from registration.measuring.judging.decisions import Decision, worst_decision

POSE_LEAD: Final = AlignmentOptions().ambiguous_below
MOST_POSES: Final = 120
"""No finite group of turns has more but those about one axis."""

Numbers = tuple[int, ...]


@dataclass(frozen=True)
class SamePose:
    """A pose in which the design is the same.

    Attributes
    ----------
    vessels : tuple of int
        What each measured vessel is if the part lay so.
    apart_um : float, µm
        By how much the design differs from itself so moved, at most.
    """

    vessels: Numbers
    apart_um: float


def is_close(rival: Record) -> bool:
    """Return whether a scan doesn't tell the pose from this one, by a turn or a shift."""
    return rival["lead"] < POSE_LEAD and not rival.get("mirrored", False)


def same_poses(ambiguity: Record) -> list[SamePose]:
    """Return the poses in which the design is the same, but the one found; compositions too.

    Parameters
    ----------
    ambiguity : mapping
        Of a registration.
    """
    given = [
        SamePose(tuple(one["vessels"]), float(one["differs_um"]))
        for one in ambiguity.get("rivals", ())
        if is_close(one) and one["same"] and one.get("vessels")
    ]
    if not given:
        return []
    poses = {tuple(range(len(given[0].vessels))): 0.0}
    new = list(poses)
    while new and len(poses) < MOST_POSES:
        last, new = new, []
        for before in last:
            for one in given:
                image = tuple(one.vessels[k] for k in before)
                if image not in poses:
                    poses[image] = min(
                        poses[before] + one.apart_um, max(g.apart_um for g in given) * 2
                    )
                    new.append(image)
    own = tuple(range(len(given[0].vessels)))
    return [SamePose(vessels, apart) for vessels, apart in poses.items() if vessels != own]


def renamed(numbers: Record, pose: SamePose) -> dict[str, object]:
    """Return a registration's numbers as they are if the part lay in another same pose."""
    own = {int(row["vessel"]): row for row in numbers["vessels"]}

    def name(vessel: Any) -> Any:
        return None if vessel is None else pose.vessels[int(vessel)]

    def row_of(row: Record) -> dict[str, object]:
        other = own[name(row["vessel"])]
        share = float(other["designed_um"]) / float(row["designed_um"])
        along = [share * float(one) for one in row["designed_along_um"]]
        measured = row.get("measured_um")
        percent = None if measured is None else 100 * (measured / other["designed_um"] - 1)
        return {
            **row,
            "vessel": int(other["vessel"]),
            "kind": other["kind"],
            "designed_um": other["designed_um"],
            "designed_along_um": along,
            "error_percent": percent,
        }

    def zone_of(row: Record) -> dict[str, object]:
        low, high = row["interval_95_um"]
        wide = 2 * pose.apart_um
        ends = [low if low is None else max(low - wide, 0.0), high if high is None else high + wide]
        return {**row, "vessel": name(row["vessel"]), "interval_95_um": ends}

    def defect_of(row: Record) -> dict[str, object]:
        return {**row, "vessel": name(row["vessel"]), "other": name(row.get("other"))}

    return {
        **numbers,
        "vessels": [row_of(row) for row in numbers["vessels"]],
        "characteristics": [zone_of(row) for row in numbers.get("characteristics", ())],
        "defects": [defect_of(row) for row in numbers["defects"]],
    }


def held_in_all(
    judged: Record, others: Sequence[Record], poses: Sequence[SamePose], motions: list[str]
) -> dict[str, object]:
    """Return a judged registration with what all poses say of it.

    A decision on the print that all share stands, with the features of the pose found. Else the
    print is undecided, and so is each vessel on which they differ; its features are those of the
    pose in which it is worst, with the vessel that it would be there (``as_vessel``).

    Parameters
    ----------
    judged : dict
        In the pose found.
    others : sequence of mapping
        As judged in each of `poses`, rows in the order of the pose found.
    motions : list of str
        The design's own, in words.
    """
    found: Decision = judged["judging"]["decision"]
    agree = all(one["judging"]["decision"] == found for one in others)
    numbers = [int(row["vessel"]) for row in judged["vessels"]]
    orbits = {v: sorted({v, *(pose.vessels[v] for pose in poses)}) for v in numbers}
    groups = sorted({tuple(one) for one in orbits.values() if len(one) > 1})
    facts = {"motions": motions, "agree": agree, "vessels": [list(one) for one in groups]}
    features: list[Any] = [
        one if one["decision"] == "pass" else _alternatives(one, orbits)
        for one in judged["judging"]["features"]
    ]
    if agree:
        judging = {**judged["judging"], "features": features, "symmetry": facts}
        return {**judged, "judging": judging}
    differing: dict[int, int] = {}
    for k, vessel in enumerate(numbers):
        rows: list[Decision] = [one["vessels"][k]["decision"] for one in (judged, *others)]
        if len(set(rows)) > 1:
            differing[vessel] = rows.index(worst_decision(rows))
    kept = [one for one in features if one.get("vessel") not in differing]
    for vessel, worst in differing.items():
        source = judged if worst == 0 else others[worst - 1]
        name = vessel if worst == 0 else poses[worst - 1].vessels[vessel]
        kept += [
            {**_withdrawn(one), "vessel": vessel, "as_vessel": name, "doubt": "symmetry"}
            for one in source["judging"]["features"]
            if one.get("vessel") == name and one["decision"] != "pass"
        ]
    return {
        **judged,
        "vessels": [
            _undecided(row) if row["vessel"] in differing else row for row in judged["vessels"]
        ],
        **{
            key: [_withdrawn(one) if one["vessel"] in differing else one for one in judged[key]]
            for key in ("characteristics", "findings", "defects")
        },
        "judging": {
            **judged["judging"],
            "decision": "undecided",
            "features": kept,
            "symmetry": facts,
        },
    }


def _alternatives(feature: Record, orbits: dict[int, list[int]]) -> Record:
    """Name the other vessels that a feature may be of."""
    others = [v for v in orbits.get(feature.get("vessel", -1), ()) if v != feature["vessel"]]
    return {**feature, "or_vessels": others} if others else feature


def _undecided(row: Record) -> dict[str, object]:
    along = ["undecided" if one == "fail" else one for one in row["decision_along"]]
    return {**row, "decision": "undecided", "decision_along": along}


def _withdrawn(one: Record) -> dict[str, object]:
    return {**one, "decision": "undecided" if one["decision"] == "fail" else one["decision"]}
