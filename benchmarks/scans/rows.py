"""Register random scans of two generators that share no code with the product; count the errors.

One generator is `make`, the other ``make_scan.py`` of the folder that SHARED_SCANS names; without
it the first runs alone. The environment's SCANS is the number of scans of each (100).
"""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path

from benchmarks.common import DATA, Row, all_of, limited, printctl, row, scratch, timed
from benchmarks.scans.cases import TOLERANCE_PERCENT, Case, draw_case
from benchmarks.scans.judge import BROKEN, judge

SHARED = Path(os.environ.get("SHARED_SCANS") or DATA.parent / "scans") / "make_scan.py"
FIRST_SEED = 1000


def shared_designs(folder: Path) -> None:
    """Write the designs of the shared generator."""
    timed([sys.executable, str(SHARED), "--designs", str(folder)])


def measured(case: Case, folder: Path) -> Row | None:
    """Make a scan, register it by the command line and judge the report; None where refused."""
    prefix, out = folder / "scan", folder / "out"
    if case.generator == "shared":
        shared_designs(folder / "designs")
        design = folder / "designs" / case.design
        program = [sys.executable, str(SHARED), str(design), str(prefix)]
    else:
        design = Path(f"{prefix}_design")
        program = [sys.executable, "-m", "benchmarks.scans.make", case.design, str(prefix)]
    timed([*program, "--seed", str(case.seed), *case.options])
    given = ["--model", design / "part.stl", "--network", design / "network.csv", "--out", out]
    given += ["--diameter-tolerance-percent", TOLERANCE_PERCENT, "--json"]
    timed(printctl("register", f"{prefix}.tif", *given), allowed=tuple(range(8)))
    if not (out / "registration.json").exists():
        return None
    return judge(out, json.loads(Path(f"{prefix}_truth.json").read_text()), TOLERANCE_PERCENT)


def rows(quick: bool) -> Iterator[Row]:
    """Yield the count's rows; quick has one scan of each generator."""
    generators = ("shared", "spectral") if SHARED.exists() else ("spectral",)
    count = 1 if quick else int(os.environ.get("SCANS", "100"))
    judged: list[tuple[Case, Row | None]] = []
    for k in range(count):
        for generator in generators:
            case = draw_case(generator, FIRST_SEED + k)
            with scratch() as folder:
                judged.append((case, measured(case, folder)))
    yield from counted(judged)


def counted(judged: Sequence[tuple[Case, Row | None]]) -> Iterator[Row]:
    """Yield what became of prints, changes, vessels, sections, ways and faces."""
    mirrored = [one for case, one in judged if "--mirror" in case.options]
    told = [one is None or one["pose"]["flagged"] for one in mirrored]
    yield all_of("mirrored scans refused or flagged", sum(told), len(told))
    refused = sum(one is None and "--mirror" not in case.options for case, one in judged)
    yield row("other scans refused", refused, f"of {len(judged) - len(mirrored)}")
    found = [one for _, one in judged if one is not None]
    wrong = sum(one["pose"]["silently_wrong"] for one in found)
    yield limited("poses silently wrong", wrong, f"of {len(found)}", 0)
    verdicts = [one["verdict"] for one in found]
    bad = sum(one["truth"] == "bad" for one in verdicts)
    passed = sum(one["false_pass"] for one in verdicts)
    yield limited("bad prints passed", passed, f"of {bad}", 0)
    clean = [one["verdict"] for one in found if not one["planted"]]
    good = [one["passed"] for one in clean if one["truth"] == "good"]
    yield row(f"clean prints that pass at ± {TOLERANCE_PERCENT:g} %", sum(good), f"of {len(good)}")
    changes = list(provable_changes(found))
    yield share_row("provable changes found", changes, 0.98)
    vessels = [vessel for one in found for vessel in one["vessels"]]
    sound = [v for v in vessels if not v["touched"] and v["worst_percent"] < TOLERANCE_PERCENT - 1]
    failed = sum(v["decision"] == "fail" for v in sound)
    yield limited("sound vessels failed", failed, f"of {len(sound)}", 0.01 * len(sound))
    unsure = sum(v["decision"] == "undecided" for v in sound)
    yield row("sound vessels undecided", unsure, f"of {len(sound)}")
    sections = [held for one in found for held in one["sections"]]
    share = sum(sections) / max(1, len(sections))
    name = f"{len(sections)} sections inside their 95 % interval"
    yield row(name, share, "", "0.92 to 0.98", 0.92 <= share <= 0.98)
    landed = [one for one in found if one["pose"]["landed"]]
    ways = [p["found"] for one in landed for p in one["planted"] if p["kind"] in BROKEN]
    yield share_row("leaks, plugs, bridges, missing vessels found", ways, 0.95)
    faces = [worst_um for one in found for worst_um in one["faces"]]
    far = sum(worst_um > 50 for worst_um in faces)
    yield limited("faces called seen that are beyond 50 um", far, f"of {len(faces)}", 0)


def provable_changes(found: Sequence[Row]) -> Iterator[bool]:
    """Yield whether each change beyond tolerance and the report's own U there was found."""
    for one in found:
        half = {v["vessel"]: v["u_percent"] for v in one["vessels"]}
        for planted in one["planted"]:
            if planted["kind"] in BROKEN or half.get(planted["vessel"]) is None:
                continue
            limit = TOLERANCE_PERCENT + half[planted["vessel"]]
            if planted["true_worst_percent"] > limit:
                yield planted["found"]


def share_row(name: str, hits: Sequence[bool], least: float) -> Row:
    """Return a row of hits of which a share is promised."""
    met = sum(hits) >= least * len(hits)
    return row(name, sum(hits), f"of {len(hits)}", f">= {least:.0%}", met)
