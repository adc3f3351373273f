"""Command line shared by the benchmarks."""

from __future__ import annotations

import argparse
import json
import os
import sys
from collections.abc import Callable, Iterator, Mapping
from typing import Any

from benchmarks.machine import commit, machine

Row = dict[str, Any]
Job = Callable[[bool], Iterator[Row]]
"""Rows of one part of a benchmark; told whether to be quick."""


def run(jobs: Mapping[str, Job], description: str | None) -> None:
    """Measure all jobs, or the one asked for, and print the benchmark's one JSON object."""
    parser = argparse.ArgumentParser(description=description)
    parser.add_argument("--only", choices=sorted(jobs), help="only these rows")
    parser.add_argument("--quick", action="store_true", help="without what takes long")
    asked = parser.parse_args()
    measured, load = commit(), os.getloadavg()[0]
    rows: list[Row] = []
    for name, job in jobs.items():
        if asked.only in (None, name):
            for found in job(asked.quick):
                print(json.dumps(found), file=sys.stderr, flush=True)
                rows.append(found)
    about = {"machine": machine(), "commit": measured, "load_before": load}
    print(json.dumps(about | {"rows": rows}, indent=1))
