"""Turn judged fails into undecided if the part's pose is ambiguous."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

from registration.alignment.options import AlignmentOptions

Record = Mapping[str, Any]

POSE_LEAD: Final = AlignmentOptions().ambiguous_below
POSE_RULE: Final = "The pose is ambiguous, so what would fail is undecided."
_FAIL_FROM_POSE: Final = {"decision": "undecided", "doubt": "pose"}


def pose_in_doubt(ambiguity: Record) -> bool:
    """Return whether the part may lie so that other places are compared.

    A symmetry of the part changes none of them.

    Parameters
    ----------
    ambiguity : mapping
        Of a registration: ``flag``; ``rivals`` with ``lead`` and ``same``, where they are known.
    """
    close = [one for one in ambiguity.get("rivals", ()) if one["lead"] < POSE_LEAD]
    symmetric = bool(close) and all(one["same"] for one in close)
    return bool(ambiguity.get("flag")) and not symmetric


def fails_withdrawn(judged: Record) -> dict[str, Any]:
    """Return judged numbers in which each fail is undecided; passes stay.

    Features so changed have the ``doubt`` ``pose``.
    """
    judging = judged["judging"]
    return {
        **judged,
        "vessels": [_row(row) for row in judged["vessels"]],
        **{
            key: [{**one, "decision": _withdrawn(one["decision"])} for one in judged[key]]
            for key in ("characteristics", "findings", "defects")
        },
        "judging": {
            **judging,
            "rule": f"{judging['rule']} {POSE_RULE}",
            "decision": "undecided",
            "features": [
                {**one, **(_FAIL_FROM_POSE if one["decision"] == "fail" else {})}
                for one in judging["features"]
            ],
        },
    }


def decision_at_sure_pose(feature: Record) -> Record:
    """Return a feature with the decision that it has if the pose is right."""
    return {**feature, "decision": "fail"} if feature.get("doubt") == "pose" else feature


def _row(row: Record) -> dict[str, Any]:
    return {
        **row,
        "decision": _withdrawn(row["decision"]),
        "decision_along": [_withdrawn(one) for one in row["decision_along"]],
    }


def _withdrawn(decision: Any) -> Any:
    return "undecided" if decision == "fail" else decision
