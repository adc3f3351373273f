"""Scan to report: pose, scale, intervals, diameters, defects: ``make bench-registration``.

Scans are a phantom's (`registration_phantom`), made without any of the product's code. ``--only
NAME`` measures a part; ``--quick`` takes a tenth of the cases.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
from collections.abc import Callable, Iterator
from typing import Any

from benchmarks.machine import commit, machine
from benchmarks.registration_pose import interval_rows, landing_rows
from benchmarks.registration_vessels import diameter_rows, whole_rows

Row = dict[str, Any]
JOBS: dict[str, Callable[[bool], Iterator[Row]]] = {
    "whole": whole_rows,
    "landing": landing_rows,
    "intervals": interval_rows,
    "diameters": diameter_rows,
}


def main() -> None:
    """Measure and print the benchmark's one JSON object."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--only", choices=sorted(JOBS), help="only these rows")
    parser.add_argument("--quick", action="store_true", help="a tenth of the cases")
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
