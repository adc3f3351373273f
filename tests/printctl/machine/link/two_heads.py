"""Two-head job of the product's writer, and its prints on the simulated Marlin."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from design.toolpath.gcode import GcodeOptions, HeadLoad, write_gcode
from design.toolpath.toolpath import MoveBuilder
from firmware_profiles import Printer, Syringe, load
from gcode.dry_run.run import dry_run
from printctl.machine.ports.clock import VirtualClock
from sim.devices.families.marlin_printer import MarlinPrinter
from tests.printctl.machine.link.jobs import parse_job

TWO = load(Printer, "two_syringe_marlin")
SYRINGES = (load(Syringe, "hamilton_1ml"), load(Syringe, "hamilton_2_5ml"))
START = (60.0, 70.0, 30.0)
PLACE = np.array([60.0, 70.0, 5.0])
FAST = tuple(head.model_copy(update={"moving_s": 0.05}) for head in TWO.heads)
QUICK = TWO.model_copy(update={"heads": FAST})


def job_of(heads: tuple[int, ...], moves: int = 6, ul: float = 0.4) -> bytes:
    """A pass per entry by that head: relieved, lifted, across, down, primed, then a zigzag."""
    builder, tools = MoveBuilder(np.array([0.0, 0.0, 1.0]), "vessel"), []
    counted = 0
    for number, head in enumerate(heads):
        begin = np.array([1.0 * number, 0.0, 1.0])
        if number:
            up, across = np.array([*builder.tip[:2], 4.0]), np.array([*begin[:2], 4.0])
            builder.plunge(-0.1, 0.4, number)
            builder.travel(up[None], 20.0, number)
            before = sum(len(run.end) for run in builder._runs)
            tools += [heads[number - 1]] * (before - counted)
            counted = before
            builder.travel(np.array([across, begin]), 20.0, number)
            if head in heads[:number]:
                builder.plunge(0.1, 0.4, number)
        along = np.arange(1, moves + 1)
        points = np.column_stack([begin[0] + along % 2 * 0.5, along * 0.5, np.full(moves, 1.0)])
        builder.write(points, np.full(moves, ul), 5.0, number)
        now = sum(len(run.end) for run in builder._runs)
        tools += [head] * (now - counted)
        counted = now
    path = replace(builder.build(), tool=np.array(tools, dtype=np.int64))
    loads = tuple(HeadLoad(syringe, relieve_ul=0.1) for syringe in SYRINGES)
    options = GcodeOptions(start_mm=START, heads=loads, safe_z_mm=20.0)
    return write_gcode(path, QUICK, SYRINGES[0], PLACE, options).data


DATA = job_of((0, 1, 0, 1, 1, 0))
JOB = parse_job(DATA, "test.gcode", QUICK)


FORESEEN = dry_run(DATA, QUICK, START).executed


def machine(**more: Any) -> tuple[MarlinPrinter, VirtualClock]:
    return MarlinPrinter(QUICK, START, **more), VirtualClock()
