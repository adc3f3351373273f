"""Planned embedded jobs pass the shaft checker, except where the plan reports it."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from design.toolpath.embedded import EmbeddedOptions, bundled, plan_embedded
from design.toolpath.gcode import Gcode, GcodeOptions, stream_gcode, write_gcode
from firmware_profiles import Ink, Printer, Syringe, load
from printctl.checks.preflight import shaft_clearance, written_arrays
from printctl.checks.preflight.shaft import read_written_arrays
from printctl.checks.set_up import HeadLoading
from sim.gcode.dry_run.run import dry_run
from tests.design.toolpath.shapes import random_tree
from tests.slower import first_of, first_rows

NEEDLE = (0.31, 0.31, 0.0)
"""Outer diameter, its tip's, and the height of its cone."""
START = (60.0, 60.0, 90.0)
PLACE = np.array([80.0, 80.0, 40.0])
SHALLOW_MM = 0.02
"""The plan looks at three places of each element: what it calls a graze may be so deep."""


@pytest.mark.parametrize("seed", first_of(range(8), 2))
def test_the_checker_flags_nothing_that_a_plan_of_a_tree_doesnt_tell(seed: int) -> None:
    options = replace(EmbeddedOptions(), open_joints=99)
    net = random_tree(4 + 3 * seed, 12.0, seed, 0.1)
    plan = plan_embedded(net, options)
    printer, syringe = load(Printer, "generic_marlin"), load(Syringe, "hamilton_1ml")
    ink = load(Ink, "gelatin_sacrificial")
    made = write_gcode(
        plan.toolpath,
        printer,
        syringe,
        (80.0, 80.0, 40.0),
        GcodeOptions(start_mm=START, flow_factor=ink.flow_factor),
    )
    beside = written_arrays(net, PLACE, options.overlap_radii, options.clearance_mm, [NEEDLE])
    lines = {"source": made.line_source, "kind": made.line_kind}
    run = dry_run(made.data, printer, START)
    found = shaft_clearance(
        run, printer, [HeadLoading(syringe, ink, None)], read_written_arrays(lines | beside)
    )
    told = {frozenset((one.vessel, one.through)) for one in plan.report.crossings}
    deep = {frozenset((a.vessel, a.crossed)) for a in found.crossings if a.depth_mm > SHALLOW_MM}
    assert deep <= told
    assert found.summary()["written_pieces"] > len(net.vessel_nodes)


@pytest.mark.parametrize(
    ("seed", "size_mm"), first_rows([(0, 12.0), (0, 20.0), (1, 20.0), (2, 20.0), (3, 20.0)])
)
def test_bundles_pass_the_checker_but_for_what_the_plan_tells(seed: int, size_mm: float) -> None:
    options = replace(EmbeddedOptions(), open_joints=99)
    net = random_tree(5 + 2 * seed, size_mm, seed, 0.3)
    made = bundled(net, np.full(net.vessel_count, 1.2 * float(net.radius.max())))
    assert not made.is_plain
    plan = plan_embedded(made, options)
    printer, syringe = load(Printer, "generic_marlin"), load(Syringe, "hamilton_1ml")
    ink = load(Ink, "gelatin_sacrificial")
    told = GcodeOptions(start_mm=START, flow_factor=ink.flow_factor)
    beside: dict[str, Any] = {}
    job = stream_gcode([plan.toolpath], printer, syringe, PLACE, told, plan.toolpath.top_mm)
    whole = Gcode.joined(list(made.of_design(job, beside)))
    strands = np.bincount(made.owner) > 1
    beside |= written_arrays(net, PLACE, options.overlap_radii, 0.05, [NEEDLE], strands)
    lines = {"source": whole.line_source, "kind": whole.line_kind}
    run = dry_run(whole.data, printer, START)
    found = shaft_clearance(
        run, printer, [HeadLoading(syringe, ink, None)], read_written_arrays(lines | beside)
    )
    named = {frozenset((one.vessel, one.through)) for one in plan.report.crossings}
    deep = {frozenset((a.vessel, a.crossed)) for a in found.crossings if a.depth_mm > SHALLOW_MM}
    assert deep <= named
    assert found.summary()["written_pieces"] > len(made.owner)
