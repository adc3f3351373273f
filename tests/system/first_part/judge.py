"""Hold a run against the truth: verdict, intervals, and remedies of refusals."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import yaml

from tests.system.first_part import program, truth
from tests.system.first_part.faults import Fault
from tests.system.first_part.parts import Part
from tests.system.first_part.remedies import proposed

Door = Callable[[Path], program.Outcome]
BORDER_PERCENT = 1.5
"""A section this near to its limit may be judged either way."""

MAX_REMEDIES = 4


def sound_case(part: Part, folder: Path, door: Door = program.run) -> dict[str, Any]:
    """Run a sound part by a door and return what is right and wrong about it."""
    recipe = part.write(folder)
    outcome = door(recipe)
    found: dict[str, Any] = {"exit": outcome.code, "verdict": outcome.verdict}
    if outcome.verdict in ("refused", "error"):
        found["message"] = outcome.text.strip().splitlines()[-6:]
        found["remedies"] = _try_remedies(part, outcome, folder)
    if (outcome.folder / "part.gcode").is_file():
        found["truth"], facts = facts_of(outcome, part.recipe)
        if outcome.registration:
            found |= _coverage(outcome, part.recipe)
    else:
        facts = None
    found["outcome"] = _outcome(outcome.verdict, facts, found.get("remedies", []))
    if outcome.verdict in ("fail", "undecided"):
        verdict = outcome.report["verdict"]
        found["reasons"] = [*verdict["causes"], *verdict["reasons"]][:8]
    return found


def fault_case(fault: Fault, part: Part, folder: Path) -> dict[str, Any]:
    """Plant a fault and return whether the print didn't pass, and whether its cause is named."""
    folder.mkdir(parents=True, exist_ok=True)
    outcome = fault.plant(part, folder)
    named = outcome.verdict != "pass" and fault.named(outcome)
    return {
        "exit": outcome.code,
        "verdict": outcome.verdict,
        "cause_named": named,
        "outcome": "fault passed" if outcome.verdict == "pass" else
        "cause named" if named else "cause not named",
        "reasons": outcome.words().strip().splitlines()[-12:],
    }  # fmt: skip


def facts_of(outcome: program.Outcome, recipe: dict[str, Any]) -> tuple[Any, truth.Truth]:
    """Return the truth about a run's G-code."""
    vessels, tissue = program.designed(outcome.folder)
    deposit = program.printed(outcome.folder, recipe)
    embedded = recipe["toolpath"]["method"] == "embedded"
    facts = truth.measure(deposit, vessels, tissue, embedded)
    shrink = recipe["scan"].get("shrink_percent", 1.0)
    for vessel, error in facts.worst_percent.items():
        facts.worst_percent[vessel] = error - shrink
    return truth.as_json(facts), facts


def _outcome(verdict: str, facts: truth.Truth | None, remedies: list[dict[str, Any]]) -> str:
    """Return what a case counts as."""
    if verdict in ("refused", "error"):
        works = any(one["works"] for one in remedies)
        return "refused, remedy works" if works else f"{verdict}, no workable remedy"
    if facts is None or facts.sound(10 - BORDER_PERCENT):
        return {"pass": "passed", "fail": "wrongly failed"}.get(verdict, verdict)
    if facts.sound(10 + BORDER_PERCENT):
        return {"pass": "passed", "fail": "failed at the limit"}.get(verdict, verdict)
    return {"pass": "wrongly passed", "fail": "rightly failed"}.get(verdict, verdict)


def _coverage(outcome: program.Outcome, recipe: dict[str, Any]) -> dict[str, Any]:
    """Hold each vessel's mean diameter against the same sections of the deposit."""
    vessels = {one.number: one for one in program.designed(outcome.folder)[0]}
    deposit = program.printed(outcome.folder, recipe)
    embedded = recipe["toolpath"]["method"] == "embedded"
    shrink = recipe["scan"].get("shrink_percent", 1.0)
    covered, rows = 0, []
    for one in outcome.registration.get("vessels", []):
        half, measured = one.get("measured_interval_95_um"), one.get("measured_um")
        if half is None or measured is None or not one["along_mm"]:
            continue
        own = vessels[one["vessel"]]
        right = [truth.local_diameter(deposit, own, along, embedded) for along in one["along_mm"]]
        pairs = zip(right, one["diameter_um"], strict=True)
        known = [(d, found) for d, found in pairs if d is not None and found]
        if len(known) < 0.8 * len(right):
            continue
        mean = 1000 * truth.shrunk(sum(d for d, _ in known) / len(known), shrink)
        measured = sum(found for _, found in known) / len(known)
        covered += abs(measured - mean) <= half
        rows.append([one["vessel"], round(mean, 1), round(measured, 1), round(half, 1)])
    return {"covered": covered, "intervals": len(rows), "vessels": rows}


def _try_remedies(part: Part, outcome: program.Outcome, folder: Path) -> list[dict[str, Any]]:
    """Execute each remedy of a refusal literally, and return whether the run then isn't refused."""
    found = []
    refusal = outcome.text.split("printctl: ")[-1]
    for number, remedy in enumerate(proposed(refusal)[:MAX_REMEDIES]):
        again = folder / f"remedy{number}"
        recipe = part.write(again)
        recipe.write_text(yaml.safe_dump(remedy.on(part.recipe), sort_keys=False))
        second = program.run(recipe)
        found.append(
            {"words": remedy.words, "verdict": second.verdict, "exit": second.code}
            | {"works": second.verdict == "pass", "says": second.text.strip().splitlines()[-2:]}
        )
    return found
