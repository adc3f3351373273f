"""Run generated parts and planted faults: one JSON line a case, then a summary.

``python -m tests.system.first_part.run --seed S --parts N [--faults M] --out DIR``
"""

from __future__ import annotations

import argparse
import json
import sys
import time
import traceback
from collections import Counter
from contextlib import suppress
from itertools import zip_longest
from pathlib import Path
from typing import Any

from tests.system.first_part import page, program
from tests.system.first_part.faults import FAULTS, MAX_TRIES, UnplannedError, drawn_for
from tests.system.first_part.judge import Door, fault_case, sound_case
from tests.system.first_part.parts import draw


def main() -> None:
    """Run all cases that the folder doesn't have yet."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seed", type=int, required=True)
    parser.add_argument("--parts", type=int, default=0)
    parser.add_argument("--first", type=int, default=0, help="number of the first part")
    parser.add_argument("--faults", type=int, default=0)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--fault", action="append", help="only this one; again for more")
    parser.add_argument("--small", action="store_true", help="parts of a few CPU seconds")
    parser.add_argument("--keep", action="store_true", help="keep scans and other large files")
    parser.add_argument("--door", choices=("command", "page"), default="command")
    given = parser.parse_args()
    door = page.run if given.door == "page" else program.run
    given.out.mkdir(parents=True, exist_ok=True)
    path = given.out / "results.jsonl"
    done = {
        (row["seed"], row["index"], row["fault"]): row
        for row in map(json.loads, path.read_text().splitlines() if path.is_file() else [])
    }
    parts = [(given.seed, k, "") for k in range(given.first, given.first + given.parts)]
    planted = [(given.seed, k, FAULTS[k % len(FAULTS)].name) for k in range(given.faults)]
    if given.fault:
        planted = [one for one in planted if one[2] in given.fault]
    wanted = [one for pair in zip_longest(parts, planted) for one in pair if one]
    rows = []
    for seed, index, fault in wanted:
        row = done.get((seed, index, fault))
        if row is None:
            row = case(seed, index, fault, given.out, given.small, door)
            with path.open("a") as file:
                file.write(json.dumps(row) + "\n")
            print(json.dumps(row), flush=True)
            if not given.keep:
                program.clean(given.out / row["name"])
        rows.append(row)
    print(json.dumps(summary(rows), indent=1), file=sys.stdout)


def case(
    seed: int, index: int, fault: str, out: Path, small: bool = False, door: Door = program.run
) -> dict[str, Any]:
    """Run one case and return its line; sound parts by that door."""
    row: dict[str, Any] = {"seed": seed, "index": index, "fault": fault, "outcome": "no sound part"}
    began = time.monotonic()
    planted = next((one for one in FAULTS if one.name == fault), None)
    try:
        for attempt in range(MAX_TRIES):
            number = index + 100_000 * attempt
            part = drawn_for(planted, seed, number) if planted else draw(seed, index, small)
            # Without the fault's name, which messages would repeat with the path.
            row["name"] = part.name + (f"_F{FAULTS.index(planted)}" if planted else "")
            with suppress(UnplannedError):
                folder = out / row["name"]
                found = (
                    fault_case(planted, part, folder) if planted else sound_case(part, folder, door)
                )
                row |= found
                break
    except Exception:
        row |= {"outcome": "broken case", "error": traceback.format_exc().splitlines()[-4:]}
    row["seconds"] = round(time.monotonic() - began)
    return row


def summary(rows: list[dict[str, Any]]) -> dict[str, Any]:
    """Return counts of outcomes, and how many intervals cover the truth."""
    sound = [row for row in rows if not row["fault"]]
    planted = [row for row in rows if row["fault"]]
    intervals = sum(row.get("intervals", 0) for row in sound)
    covered = sum(row.get("covered", 0) for row in sound)
    return {
        "parts": len(sound),
        "outcomes": dict(Counter(row["outcome"] for row in sound)),
        "coverage": f"{covered} of {intervals}",
        "faults": len(planted),
        "faults_by_outcome": {
            outcome: [row["fault"] for row in planted if row["outcome"] == outcome]
            for outcome in sorted({row["outcome"] for row in planted})
        },
    }


if __name__ == "__main__":
    main()
