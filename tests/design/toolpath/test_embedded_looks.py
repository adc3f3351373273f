"""Places to look within passes, before what follows bars the needle's way to a gap."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from design.toolpath import MoveKind, Toolpath
from design.toolpath.embedded import EmbeddedOptions, plan_embedded
from design.toolpath.gcode import stream_gcode
from firmware_profiles import Printer, Syringe, load
from tests.design.toolpath.shapes import polyline, random_tree

OPTIONS = EmbeddedOptions(open_joints=99)
LOOKED = replace(OPTIONS, look_within=True)
RADIUS = 0.15


def leaning(degrees: float, long_mm: float = 6.0) -> Toolpath:
    """A straight vessel that rises so steeply."""
    slope = math.radians(degrees)
    ends = [[0.0, 0, 5], [long_mm * math.cos(slope), 0, 5 + long_mm * math.sin(slope)]]
    return plan_embedded(polyline(np.array(ends), RADIUS), LOOKED).toolpath


def looks(path: Toolpath) -> np.ndarray:
    """Places to look, (n, 3)."""
    return path.end[path.kind == MoveKind.LOOK]


@pytest.mark.parametrize("degrees", [0, 30, 50])
def test_a_gentle_slope_is_looked_at_when_it_is_whole(degrees: float) -> None:
    assert len(looks(leaning(degrees))) == 0


@pytest.mark.parametrize("degrees", [70, 90])
def test_a_steep_one_is_looked_at_before_it_bars_the_way_to_itself(degrees: float) -> None:
    path = leaning(degrees)
    ways = np.linalg.norm(np.diff([path.start[0], *looks(path), path.end[-1]], axis=0), axis=1)
    joint = math.sqrt(2) * (0.155 + RADIUS) + 0.5 * RADIUS
    assert ways.max() <= joint
    assert ways[:-1].min() > joint - 0.25  # whole elements: no more looks than that takes


def test_nothing_is_written_otherwise_for_being_looked_at() -> None:
    net = random_tree(12, 9.0, 3, 0.2)
    plain, looked = (plan_embedded(net, one).toolpath for one in (OPTIONS, LOOKED))
    assert 0 < len(looks(looked)) < 60
    assert len(looks(plain)) == 0
    assert looked.written_ul == pytest.approx(plain.written_ul)
    corners = {tuple(row) for row in looked.end[looked.kind == MoveKind.WRITE].round(6).tolist()}
    assert corners >= {tuple(row) for row in plain.end[plain.kind == MoveKind.WRITE].round(6)}
    travels = [path.end[path.kind == MoveKind.TRAVEL] for path in (plain, looked)]
    assert np.allclose(*travels)


def test_each_stands_in_the_job_where_its_part_is_written() -> None:
    path = leaning(70)
    job = stream_gcode([path], load(Printer, "generic_marlin"), load(Syringe, "hamilton_1ml"),
                       [80, 80, 40], None, 99.0)  # fmt: skip
    lines = b"".join(part.data for part in job).decode().splitlines()
    places = [lines[k - 1] for k, line in enumerate(lines) if line == ";PART_END:0"]
    heights = [float(line.split(" Z")[1].split()[0]) - 40 for line in places]
    assert heights == pytest.approx(looks(path)[:, 2], abs=0.001)
