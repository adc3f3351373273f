"""Solids and FRESH layers: unions, and lumens that stay open: ``make bench-solids``.

PrusaSlicer runs beside the product where it is installed (``apt-get install prusa-slicer``), as a
process of its own with `solids_prusa.ini`. ``--only NAME`` measures a part; ``--quick`` leaves the
20,000 segments and the large part out.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
from collections.abc import Callable, Iterator
from typing import Any

from benchmarks.machine import commit, machine
from benchmarks.solids_large import rows as large_rows
from benchmarks.solids_slicing import rows as slicing_rows
from benchmarks.solids_union import rows as union_rows

Row = dict[str, Any]
JOBS: dict[str, Callable[[bool], Iterator[Row]]] = {
    "slicing": lambda quick: slicing_rows(),
    "union": union_rows,
    "large": lambda quick: iter(()) if quick else large_rows(),
}


def main() -> None:
    """Measure and print the benchmark's one JSON object."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--only", choices=sorted(JOBS), help="only these rows")
    parser.add_argument("--quick", action="store_true", help="without the long rows")
    asked = parser.parse_args()
    measured, load = commit(), os.getloadavg()[0]
    rows: list[Row] = []
    for name, job in JOBS.items():
        if asked.only in (None, name):
            for found in job(asked.quick):
                print(json.dumps(found), file=sys.stderr, flush=True)
                rows.append(found)
    about = {"machine": machine(), "commit": measured, "load_before": load}
    print(json.dumps(about | {"rows": rows}, indent=1))


if __name__ == "__main__":
    main()
