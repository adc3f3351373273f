"""Streamed G-code: byte for byte equal to the job written as a whole."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from design.errors import ToolpathError
from design.toolpath.fresh import FreshLayers, FreshOptions, plan_fresh
from design.toolpath.gcode import Gcode, GcodeOptions, save_gcode, stream_gcode, write_gcode
from design.toolpath.toolpath import join_toolpaths
from firmware_profiles import Printer, Syringe, load
from tests.design.toolpath.shapes import as_solid, block, upright

SYRINGE = load(Syringe, "hamilton_1ml")
PLACE = np.array([60.0, 70.0, 20.0])
KNOWN = (60.0, 70.0, 45.0)


@cache
def drilled():
    return as_solid(block(6, 5, 0.6) - upright(2, 1.5, 1))


def streamed(parts, top, printer, options):
    return list(stream_gcode(parts, printer, SYRINGE, PLACE, options, top))


@pytest.mark.parametrize("start", [None, KNOWN])
@pytest.mark.parametrize(
    ("name", "more"),
    [
        ("generic_marlin", {}),
        ("marlin_avr", {}),
        ("klipper_bioprinter", {}),
        ("pneumatic_marlin", {"flow_ul_s": 0.12}),
    ],
)
def test_layers_written_one_by_one_are_the_job_of_their_whole(name, more, start):
    printer, options = load(Printer, name), GcodeOptions(start_mm=start, **more)
    layers = FreshLayers(drilled(), FreshOptions())
    parts = list(layers)
    assert len(parts) == 10
    whole = join_toolpaths(parts)
    top = float(whole.end[:, 2].max())
    got = Gcode.joined(streamed(parts, top, printer, options))
    expected = write_gcode(whole, printer, SYRINGE, PLACE, options)
    assert got.data == expected.data
    for name in ("line_source", "line_move", "line_kind"):
        np.testing.assert_array_equal(getattr(got, name), getattr(expected, name))


def test_the_plunger_s_count_goes_on_over_the_parts():
    printer = load(Printer, "generic_marlin")
    parts = [
        replace(part, volume_ul=400 * part.volume_ul)
        for part in FreshLayers(drilled(), FreshOptions())
    ]
    whole = join_toolpaths(parts)
    top = float(whole.end[:, 2].max())
    got = Gcode.joined(streamed(parts, top, printer, None))
    assert got.data.count(b"G92") > 5
    assert got.data == write_gcode(whole, printer, SYRINGE, PLACE).data


def test_a_part_is_given_back_before_the_next_but_one_is_asked_for():
    asked = []

    def parts():
        for part in FreshLayers(drilled(), FreshOptions()):
            asked.append(len(asked))
            yield part

    printer, layers = load(Printer, "generic_marlin"), FreshLayers(drilled(), FreshOptions())
    job = stream_gcode(parts(), printer, SYRINGE, PLACE, None, layers.top_mm)
    for number in range(4):
        next(job)
        assert len(asked) == number + 2


def test_layers_say_their_top_before_they_are_made_and_their_numbers_after():
    layers = FreshLayers(drilled(), FreshOptions())
    top = layers.top_mm
    highest = max(float(part.end[:, 2].max()) for part in layers)
    assert highest <= top <= highest + FreshOptions.lift_mm
    assert layers.report().written_ul == pytest.approx(
        plan_fresh(drilled(), FreshOptions()).report.written_ul
    )
    assert len(list(layers)) == len(list(layers))


def test_a_job_that_fails_on_the_way_leaves_no_file(tmp_path):
    out, lines = tmp_path / "job.gcode", tmp_path / "job.map.npz"
    parts = list(FreshLayers(drilled(), FreshOptions()))
    job = stream_gcode(parts, load(Printer, "generic_marlin"), SYRINGE, PLACE, None, 0.4)
    with pytest.raises(ToolpathError):
        save_gcode(out, lines, job)
    assert list(tmp_path.iterdir()) == []
