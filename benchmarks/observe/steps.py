"""Benchmark of the observer's flow control: writing time from a step of ± 30 % to flow back.

The prints of `benchmarks.observe.prints`, written at 4 mm/s, whose flow steps at a random place of
the first two layers. Counted is the time of the job's own writing from the step to the insert
behind which the flow stays within 5 % of what it should be.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from benchmarks.common import Row, limited, scratch
from benchmarks.observe.prints import (
    PITCH_MM,
    PRINTER,
    SIZE_MM,
    World,
    camera_file,
    job_text,
    observed,
)
from firmware_profiles import Printer, load
from gcode.deposit.ink_faults import Drift, InkFaults
from printctl.machine.job.job import file_count, parse_job
from printctl.machine.job.look_places import look_places
from printctl.machine.job.marks import Mark, MarkKind, Marks

SPEED_MM_S, EVERY = 4.0, "5 s written"
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


def rows(quick: bool) -> Iterator[Row]:
    """Yield steps up and down in turns; quick has one down."""
    rng = np.random.default_rng(1)
    took: dict[float, list[float]] = {0.7: [], 1.3: []}
    for k in range(1 if quick else 6):
        begin = float(rng.uniform(0, 2 * SIZE_MM * (SIZE_MM / PITCH_MM + 1)))
        factor = list(took)[k % 2]
        faults = InkFaults((Drift(fault="drift", written_mm=begin, factor=factor),), 1)
        with scratch() as place:
            path = place / "job.gcode"
            path.write_bytes(job_text(SPEED_MM_S))
            world = observed(path.parent, faults, camera_file(path.parent, rng), path, EVERY)
            took[factor].append(seconds_to_right(world, begin, factor, path.read_bytes()))
    for factor, times in took.items():
        if times:
            name = f"step by {100 * (factor - 1):+.0f} %: writing time until within 5 %, longest"
            yield limited(name, max(times), f"s of {len(times)} prints", 10.0)
