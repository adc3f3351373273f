"""Interruption marks: comments that don't change the commands."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from design.toolpath import MoveBuilder, Toolpath
from design.toolpath.embedded import EmbeddedOptions, plan_embedded
from design.toolpath.fresh import FreshOptions
from design.toolpath.gcode import GcodeOptions, write_gcode
from firmware_profiles import Printer, Syringe, load
from tests.design.toolpath.gcode_reader import Machine
from tests.design.toolpath.plans import fresh_toolpath
from tests.design.toolpath.shapes import as_solid, block, random_tree, upright

PRINTER = load(Printer, "generic_marlin")
SYRINGE = load(Syringe, "hamilton_1ml")
PLACE = np.array([60.0, 70.0, 20.0])


def read(toolpath: Toolpath) -> Machine:
    return Machine().read(write_gcode(toolpath, PRINTER, SYRINGE, PLACE).data)


def fresh(**options: float) -> Toolpath:
    return fresh_toolpath(as_solid(block(4, 3, 0.3) - upright(2, 1.5, 1)), FreshOptions(**options))


def test_each_layer_ends_once_relieved_and_at_the_next_ones_height():
    machine = read(fresh())
    ends = [k for k, text in enumerate(machine.lines) if text.startswith(";LAYER_END")]
    assert [machine.lines[k] for k in ends] == [f";LAYER_END:{k}" for k in range(len(ends))]
    assert len(ends) == 5
    for k in ends[:-1]:
        assert machine.lines[k + 1] == ";RELOAD"
        # One layer, and what keeps the needle off the fresh ink or above the open lumen.
        rise = float(machine.states[k][0]["Z"] - machine.states[k - 3][0]["Z"])
        above = min((FreshOptions.hop_mm, FreshOptions.lift_mm), key=lambda mm: abs(rise - mm))
        assert rise == pytest.approx(0.06 + above)
        plunger = [float(state[1]) for state in machine.states[: k + 1]]
        assert plunger[-1] < max(plunger)
    assert machine.lines[ends[-1] + 1] != ";RELOAD"


def test_each_pass_ends_with_a_free_way_straight_up():
    options = EmbeddedOptions()
    plan = plan_embedded(random_tree(20, 10, 3, 0.1), options)
    machine = read(plan.toolpath)
    ends = [k for k, text in enumerate(machine.lines) if text.startswith(";PASS_END")]
    assert len(ends) == plan.report.passes > 3
    assert [text for text in machine.lines if text == ";RELOAD"] == [";RELOAD"] * (len(ends) - 1)
    written = []
    for before, after in zip([9, *ends], ends[:-1], strict=False):
        for last, here in pairwise(machine.states[before:after]):
            if here[1] > last[1]:
                way = [[float(state[0][axis]) for axis in "XYZ"] for state in (last, here)]
                written.append(np.linspace(*way, 50))
        tip = np.array([float(machine.states[after][0][axis]) for axis in "XYZ"])
        ink = np.concatenate(written)
        near = np.linalg.norm((ink - tip)[:, :2], axis=1) < options.needle_outer_mm / 2 + 0.1
        assert (ink[near, 2] < tip[2]).all()


def test_marks_change_no_command():
    toolpath = fresh()
    one_layer = replace(toolpath, source=np.zeros_like(toolpath.source))
    assert read(toolpath).commands == read(one_layer).commands
    assert read(one_layer).lines[-4:-3] == [";LAYER_END:0"]


def test_e_counted_anew_comes_after_the_mark():
    builder = MoveBuilder((0, 0, 0.06), "layer", 0.06)
    for layer in range(6):
        z = 0.06 * (layer + 1)
        if layer:
            builder.plunge(-0.02, 0.4, layer)
            builder.travel(np.array([[*builder.tip[:2], z]]), 5, layer)
            builder.plunge(0.02, 0.4, layer)
        points = np.array([[60.0 * (layer % 2 == 0), 0, z]])
        builder.write(points, np.array([250.0]), 20, layer)
    gcode = write_gcode(builder.build(), PRINTER, SYRINGE, PLACE, GcodeOptions(relieve_ul=0))
    machine = Machine().read(gcode.data)
    assert sum(text.startswith("G92") for text in machine.lines) > 1
    assert machine.lines.count(";RELOAD") == 5
