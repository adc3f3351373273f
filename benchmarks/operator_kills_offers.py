"""Compare the actions that a page offers for a print with those that its journal allows."""

from __future__ import annotations

from typing import Any

from benchmarks.checkers.journal_verdict import Written


def may(told: dict[str, Any], action: str) -> bool:
    """Whether an action is offered as possible."""
    return any(one["possible"] for one in told["actions"] if one["action"] == action)


def offers(told: dict[str, Any], written: Written) -> list[str]:
    """What is offered against what the journal allows."""
    gone = written.true_state == "interrupted"
    wanted = {"give_up": gone, "go_on": gone and written.resumable}
    if written.true_state == "paused":
        wanted["resume"] = True
    if written.true_state == "printing":
        wanted["pause"] = True
    wrong = [
        f"{action} is {'not ' if so else ''}offered while {written.true_state}"
        for action, so in wanted.items()
        if may(told, action) != so
    ]
    if "Go on" in told["message"] and not may(told, "go_on"):
        wrong.append(f"go on is promised and not offered: {told['message']}")
    wrong += [
        f"{one['action']} isn't offered, without a reason"
        for one in told["actions"]
        if not one["possible"] and not one["reason"]
    ]
    return wrong
