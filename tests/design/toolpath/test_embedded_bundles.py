"""Embedded writing of thick vessels as strands side by side."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from design.errors import ToolpathError
from design.network import VesselNetwork
from design.toolpath import MoveKind
from design.toolpath.embedded import EmbeddedOptions, bundled, plan_embedded
from design.toolpath.embedded.bundles import STRANDS
from design.toolpath.gcode import stream_gcode
from firmware_profiles import Printer, Syringe, load
from tests.design.toolpath.shapes import polyline, polylines, random_tree
from tests.slower import first_of

COARSE = EmbeddedOptions(needle_inner_mm=0.41, needle_outer_mm=0.72)


def volume(net: VesselNetwork) -> float:
    start, end, a, b, _ = net.pieces()
    length = np.linalg.norm(end - start, axis=1)
    return float((np.pi / 3 * length * (a * a + a * b + b * b)).sum())


def covered(net: VesselNetwork, at: float, radius: float) -> tuple[float, float]:
    """Of a lumen along x: share of its section that strands fill, and their farthest reach."""
    lines = [line for line, _ in net.polylines()]
    places = np.array([[np.interp(at, p[:, 0], p[:, k]) for k in (1, 2)] for p in lines])
    thick = net.radius[net.offset[:-1]]
    side = np.linspace(-radius, radius, 201)
    y, z = np.meshgrid(side, side)
    inside = np.hypot(y, z) < 0.97 * radius
    grid = np.stack([y[inside], z[inside]], axis=1)
    axis = places[0]
    near = np.linalg.norm(grid[:, None] - (places - axis), axis=2) < thick
    return near.any(axis=1).mean(), (np.linalg.norm(places - axis, axis=1) + thick).max() / radius


@pytest.mark.parametrize(("widest", "strands"), [(2.1, 1), (0.8, 7), (0.5, 19), (0.33, 37)])
def test_strands_hold_the_volume_and_fill_the_lumen(widest: float, strands: int) -> None:
    net = polyline(np.array([[0.0, 0, 5], [12, 0, 5]]), 1.0)
    made = bundled(net, np.array([widest]))
    assert len(made.owner) == strands
    assert strands in STRANDS
    assert volume(made.network) == pytest.approx(volume(net), rel=1e-9)
    assert 2 * made.network.radius.max() <= widest * (1 + 1e-9)
    filled, reach = covered(made.network, 6.0, 1.0)
    assert filled > 0.87  # the rest is flats of a hexagon, which the merged ink rounds
    assert reach < 1.05


def test_a_tapered_lumen_keeps_its_volume_and_thin_vessels_are_left_alone() -> None:
    lines = [np.array([[0.0, 0, 5], [12, 0, 5]]), np.array([[12.0, 0, 5], [20, 0, 5]])]
    net = replace(polylines(lines, 1.0), radius=np.array([1.2, 0.6, 0.3, 0.3]))
    made = bundled(net, np.array([0.95, 0.95]))
    assert made.owner.tolist() == [0, 1] + [0] * 6
    assert volume(made.network) == pytest.approx(volume(net), rel=1e-3)
    assert np.array_equal(made.network.vessel_nodes[:2], net.vessel_nodes)


@pytest.mark.parametrize("end", first_of([(0.0, 0.0, 13.0), (12.0, 0.0, 5.0), (3.0, 0.0, 15.0)], 2))
def test_a_lone_bundle_is_written_without_a_crossing(end: tuple[float, float, float]) -> None:
    net = polyline(np.array([[0.0, 0, 5], end]), 1.0)
    plan = plan_embedded(bundled(net, np.array([0.8])), COARSE)
    assert not plan.report.crossings
    assert plan.report.vessels == 1
    written = plan.toolpath.kind == MoveKind.WRITE
    inside = plan.toolpath.volume_ul[written].sum() - plan.report.overlap_ul
    assert inside == pytest.approx(volume(net), rel=1e-6)


def test_the_report_and_the_job_name_the_design_s_vessels() -> None:
    net = random_tree(8, 16.0, 3, 0.2)
    net = replace(net, radius=net.radius * 1.6)
    made = bundled(net, np.full(net.vessel_count, 0.9 * 2 * net.radius.max()))
    assert not made.is_plain
    plan = plan_embedded(made, replace(COARSE, open_joints=99))
    for told in (*plan.report.crossings, *plan.report.grazes):
        assert told.vessel != told.through
        assert max(told.vessel, told.through) < net.vessel_count
    beside: dict[str, np.ndarray] = {}
    job = stream_gcode([plan.toolpath], load(Printer, "generic_marlin"),
                       load(Syringe, "hamilton_1ml"), [80, 80, 40], None, 99.0)  # fmt: skip
    parts = list(made.of_design(job, beside))
    source = np.concatenate([part.line_source for part in parts])
    known = source >= 0
    assert np.array_equal(made.owner[beside["strand"][known]], source[known])
    marks = [line for line in parts[0].data.splitlines() if b"PASS_END" in line]
    assert len(marks) == plan.report.passes
    assert all(int(mark.split(b":")[1]) < net.vessel_count for mark in marks)


def test_more_strands_than_are_laid_are_refused() -> None:
    net = polyline(np.array([[0.0, 0, 5], [12, 0, 5]]), 2.0)
    with pytest.raises(ToolpathError, match=r"vessel 0: diameter 4\.000 mm .* 37 filaments"):
        bundled(net, np.array([0.5]))
