"""Rates of missed and false mismatches between a scan and its design.

Numbers of each scan are kept in ``PRINTCTL_IDENTITY`` (a file, one JSON object a line; else in
the temporary folder), so that a broken-off benchmark goes on where it was. ``python -m
benchmarks.identity.fit FILE`` fits `Likelihood` to them.
"""

from __future__ import annotations

import json
import os
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from benchmarks.common import Row, at_least, limited
from benchmarks.identity.cases import case

SCANS = 500
QUICK_SCANS = 3
MOST_MISSED_PERCENT = 2.0


def kept() -> Path:
    """Return the file of the cases' numbers."""
    usual = Path(tempfile.gettempdir()) / "printctl_identity.jsonl"
    return Path(os.environ.get("PRINTCTL_IDENTITY", usual))


def read_cases(path: Path) -> dict[int, dict[str, Any]]:
    """Return the cases of a file by number."""
    if not path.is_file():
        return {}
    lines = [json.loads(line) for line in path.read_text(encoding="utf-8").splitlines()]
    return {one["case"]: one for one in lines}


def measure(path: Path, count: int) -> list[dict[str, Any]]:
    """Return the first cases, those from the file where it has them."""
    known = read_cases(path)
    for number in range(count):
        if number not in known:
            known[number] = case(number)
            with path.open("a", encoding="utf-8") as file:
                file.write(json.dumps(known[number]) + "\n")
    return [known[number] for number in range(count)]


def says_other(numbers: dict[str, Any]) -> bool:
    """Whether a registration is refused, or says that the scan doesn't match."""
    return "refused" in numbers or bool(numbers["other_part"])


def rows(quick: bool) -> Iterator[Row]:
    """Yield false and missed statements; the file's earlier cases count as they were stored."""
    found = [one for one in measure(kept(), QUICK_SCANS if quick else SCANS) if "unread" not in one]
    right, wrong = ([one[key] for one in found] for key in ("of_right", "of_wrong"))
    false = [one["case"] for one in found if says_other(one["of_right"])]
    missed = [one["case"] for one in found if not says_other(one["of_wrong"])]
    yield limited("right scans that don't match", len(false), f"of {len(right)}", 0) | {
        "cases": false
    }
    percent = 100 * len(missed) / max(len(wrong), 1)
    yield limited("wrong scans missed", percent, "%", MOST_MISSED_PERCENT) | {"cases": missed}
    yield at_least("scans read", len(found), "", QUICK_SCANS if quick else 0.98 * SCANS)
