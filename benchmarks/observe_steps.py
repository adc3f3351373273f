"""Benchmark of the observer's flow control: writing time from a step of ± 30 % to flow back.

``python -m benchmarks.observe_steps --prints 6 --every "5 s written"``. The prints of
`benchmarks.observe_prints`, written at 4 mm/s, whose flow steps at a random place of the first two
layers. Counted is the time of the job's own writing from the step to the insert behind which the
flow stays within 5 % of what is asked for. Up and down take turns. Each step is told on stderr.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.machine import machine, row
from benchmarks.observe_prints import (
    PITCH_MM,
    PRINTER,
    SIZE_MM,
    World,
    camera_file,
    job_text,
    observed,
)
from firmware_profiles import Printer, load
from printctl.machine.link.inserts import file_count
from printctl.machine.link.job import parse_job
from printctl.machine.link.look_places import look_places
from printctl.machine.link.marks import Mark, MarkKind, Marks
from sim.gcode.deposit.ink_faults import Drift, InkFaults

SPEED_MM_S = 4.0
WITHIN = 0.05


def seconds_to_right(world: World, begin_mm: float, factor: float, own: bytes) -> float:
    """Writing time from the step until the flow is right for good; infinite where it never is."""
    found = np.inf
    for k, insert in enumerate(world.job.inserts):
        done = file_count(insert.after, world.job.positions[:k])
        since = written_mm(own, done) - begin_mm
        if since < 0:
            continue
        right = abs(factor * insert.flow - 1) <= WITHIN
        found = min(found, since / SPEED_MM_S) if right else np.inf
    return float(found)


def written_mm(own: bytes, done: int) -> float:
    """Way that the file's first commands write, mm."""
    job = parse_job(own, "job", load(Printer, PRINTER))
    marks = Marks([Mark(done, MarkKind.LAYER)])
    return look_places(job.lines, marks, (), within=False).written[0].way_mm


def _rows(factor: float, took: list[float]) -> list[dict[str, Any]]:
    """Rows of the steps by one factor."""
    step = f"step by {100 * (factor - 1):+.0f} %, {len(took)} prints: writing time until within 5 %"
    return [
        row(f"{step}, median", round(float(np.median(took)), 1), "s"),
        row(f"{step}, longest", round(max(took), 1), "s", "<= 10", max(took) <= 10),
    ]


def main() -> None:
    """Run and print JSON."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--prints", type=int, default=6)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--every", default="5 s written")
    said = parser.parse_args()
    rng = np.random.default_rng(said.seed)
    found: dict[float, list[float]] = {0.7: [], 1.3: []}
    for k in range(said.prints):
        begin = float(rng.uniform(0, 2 * SIZE_MM * (SIZE_MM / PITCH_MM + 1)))
        factor = list(found)[k % 2]
        faults = InkFaults((Drift(fault="drift", written_mm=begin, factor=factor),), 1)
        with tempfile.TemporaryDirectory() as place:
            path = Path(place) / "job.gcode"
            path.write_bytes(job_text(SPEED_MM_S))
            world = observed(path.parent, faults, camera_file(path.parent, rng), path, said.every)
            took = seconds_to_right(world, begin, factor, path.read_bytes())
        found[factor].append(took)
        print(f"step by {factor} at {begin:.1f} mm: {took:.1f} s", file=sys.stderr, flush=True)
    rows = [one for factor, took in found.items() if took for one in _rows(factor, took)]
    print(json.dumps({"machine": machine(), "every": said.every, "rows": rows}, indent=1))


if __name__ == "__main__":
    main()
