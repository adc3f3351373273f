"""Measure `printctl register` on scans of two generators.

    python -m benchmarks.scan_bench --generator both --only changes --count 10 --keep DIR

Prints one JSON object. Scans, reports and results.jsonl stay in DIR: an interrupted bench goes on.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import tempfile
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

from benchmarks.common import commit, machine
from benchmarks.scans.cases import FAMILIES, Case
from benchmarks.scans.count import count
from benchmarks.scans.rows import rows_of
from benchmarks.scans.rows_count import rows_of_count
from benchmarks.scans.runs import SHARED, again, measure, name_of, present, shared_designs

COUNTS = {
    "changes": 200,
    "poses": 100,
    "intervals": 40,
    "ways": 60,
    "diameters": 10,
    "faces": 20,
    "formats": 10,
    "time": 1,
    "count": 100,
}
QUICK = 2
ASKED = FAMILIES | {"count": count}


def parse(argv: list[str] | None) -> argparse.Namespace:
    """Parse the command line."""
    ap = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    ap.add_argument("--generator", choices=("shared", "spectral", "both"), default="both")
    ap.add_argument("--only", choices=sorted(ASKED), action="append", help="may be given again")
    ap.add_argument(
        "--count", type=int, help="scans of each family and generator; default by family"
    )
    ap.add_argument("--first-seed", type=int, default=1000)
    ap.add_argument("--jobs", type=int, default=2)
    ap.add_argument("--keep", type=Path, help="folder of scans and results; else a temporary one")
    ap.add_argument("--commit", help="name of what is measured; default: the tree's commit")
    ap.add_argument("--rows-only", action="store_true", help="of the results that are there")
    ap.add_argument("--quick", action="store_true", help=f"{QUICK} scans of each")
    return ap.parse_args(argv)


def cases(asked: argparse.Namespace) -> list[tuple[str, Case]]:
    """Return the families' cases; say which generator isn't there."""
    generators = ["shared", "spectral"] if asked.generator == "both" else [asked.generator]
    if "shared" in generators and not present("shared"):
        print(
            f"{SHARED}/make_scan.py isn't there: only the spectral generator runs", file=sys.stderr
        )
        generators = ["spectral"]
    counts = {f: min(COUNTS[f], QUICK) if asked.quick else COUNTS[f] for f in COUNTS}
    if asked.count:
        counts = {f: 1 if f == "time" else asked.count for f in counts}
    out = []
    # Seeds in turn, so that an interrupted bench has some of every family.
    for k in range(max(counts.values())):
        for family in asked.only or FAMILIES:
            if k < counts[family]:
                out += [(family, ASKED[family](g, asked.first_seed + k)) for g in generators]
    return out


def known(path: Path, of: str) -> dict[tuple[str, str], dict[str, Any]]:
    """Return the results of one commit that are there already, by family and name."""
    lines = (
        [json.loads(x) for x in path.read_text().splitlines() if x.endswith("}")]
        if path.exists()
        else []
    )
    return {(x["family"], x["name"]): x for x in lines if x["commit"] == of}


def main(argv: list[str] | None = None) -> int:
    """Run the bench."""
    asked = parse(argv)
    keep = (asked.keep or Path(tempfile.mkdtemp(prefix="scan_bench_"))).resolve()
    keep.mkdir(parents=True, exist_ok=True)
    of, load, results = asked.commit or commit(), os.getloadavg()[0], keep / "results.jsonl"
    todo, done = cases(asked), known(results, of)
    if any(c.generator == "shared" for _, c in todo):
        shared_designs(keep)

    def one(item: tuple[str, Case]) -> dict[str, Any] | None:
        family, case = item
        if (family, name_of(case)) in done:
            return again(done[family, name_of(case)], keep)
        if asked.rows_only:
            return None
        try:
            line = measure(case, family, keep, of)
        except RuntimeError as exc:
            print(exc, file=sys.stderr)
            return None
        with results.open("a") as file:
            file.write(json.dumps(line) + "\n")
        print(f"{family} {line['name']} {line['ran']['exit']}", file=sys.stderr, flush=True)
        return line

    with ThreadPoolExecutor(asked.jobs) as pool:
        lines = [x for x in pool.map(one, todo) if x]
    families = asked.only or FAMILIES
    rows = [r for family in families if family != "count" for r in rows_of(family, lines)]
    rows += rows_of_count(lines) if "count" in families else []
    print(
        json.dumps(
            {
                "machine": machine(),
                "commit": of,
                "load_before": load,
                "keep": str(keep),
                "rows": rows,
            },
            indent=1,
        )
    )
    return 0


if __name__ == "__main__":
    sys.exit(main())
