"""Embedded travels: above obstacles, as low as possible, slow near ink."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from design.toolpath import MoveKind
from design.toolpath.embedded import (
    EmbeddedHeads,
    EmbeddedOptions,
    plan_embedded,
)
from design.toolpath.embedded.write import ground_under, highest_along, lay
from tests.design.toolpath.plans import embedded_toolpath
from tests.design.toolpath.shapes import cage, polylines, random_tree
from tests.slower import first_of

OPTIONS = EmbeddedOptions()
WIDE = replace(OPTIONS, needle_outer_mm=0.7, lift_mm=0.5)


def way_sampled(start, end, step=0.02):
    count = int(np.ceil(np.linalg.norm(end - start) / step)) + 1
    return np.linspace(start, end, count + 1)


def tops_under(ink, radius, way, shaft_mm):
    """Tops of the ink that a needle on a way comes upon, -inf for none."""
    gap = np.hypot(*(ink[:, None, :2] - way[None, :, :2]).transpose(2, 0, 1)).min(axis=1)
    under = gap < shaft_mm + radius
    return (ink[:, 2] + radius)[under].max(initial=-np.inf)


def written_before(toolpath, move):
    """Ink (n, 3), its radius and the top of its move, of all moves before one."""
    found = []
    for k in np.flatnonzero(toolpath.kind[:move] == MoveKind.WRITE):
        a, b = toolpath.start[k], toolpath.end[k]
        points = way_sampled(a, b, 0.05)
        radius = np.sqrt(toolpath.volume_ul[k] / np.linalg.norm(b - a) / np.pi)
        told = np.broadcast_to([radius, max(a[2], b[2])], (len(points), 2))
        found.append(np.hstack([points, told]))
    ink = np.concatenate(found) if found else np.empty((0, 5))
    return ink[:, :3], ink[:, 3], ink[:, 4]


PATHS = {
    "tree": (random_tree(20, 10, 3, 0.1), OPTIONS),
    "cage": (cage(8, 3.0, 4.0), OPTIONS),
    "wide needle": (random_tree(10, 12, 1, 0.2), WIDE),
}


@pytest.mark.parametrize("name", PATHS)
def test_travels_pass_above_what_lies_under_their_way_by_the_lift(name):
    net, options = PATHS[name]
    toolpath = plan_embedded(net, replace(options, open_joints=9)).toolpath
    across = 0
    for move in np.flatnonzero(toolpath.kind == MoveKind.TRAVEL).tolist():
        start, end = toolpath.start[move], toolpath.end[move]
        if np.array_equal(start[:2], end[:2]):
            continue
        across += 1
        assert start[2] == end[2]  # no diagonal through the print
        ink, radius, high = written_before(toolpath, move)
        way = way_sampled(start, end, 0.05)
        assert end[2] >= tops_under(ink, radius, way, options.shaft_mm) + options.lift_mm - 1e-9
        # No higher than its own ends and the ink about its way ask for.
        wide = tops_under(np.column_stack([ink[:, :2], high]), radius, way, options.shaft_mm * 2)
        after = np.flatnonzero(toolpath.kind[move:] == MoveKind.WRITE)[0] + move
        before = np.flatnonzero(toolpath.kind[:move] == MoveKind.WRITE)[-1]
        ends = max(toolpath.end[before, 2], toolpath.start[after, 2])
        assert end[2] <= max(wide, ends) + options.lift_mm + 1e-9
    assert across > 5


@pytest.mark.parametrize("name", PATHS)
def test_the_needle_goes_up_and_down_fast_only_where_no_ink_stands_about(name):
    net, options = PATHS[name]
    toolpath = plan_embedded(net, replace(options, open_joints=9)).toolpath
    fast = (toolpath.kind == MoveKind.TRAVEL) & (toolpath.speed_mm_s > options.lift_speed_mm_s)
    upright = (toolpath.start[:, :2] == toolpath.end[:, :2]).all(axis=1)
    rows = np.flatnonzero(fast & upright).tolist()
    slow = (toolpath.kind == MoveKind.TRAVEL) & ~fast
    assert rows
    assert slow.any()
    for move in rows:
        ink, radius, _ = written_before(toolpath, move)
        top = tops_under(ink, radius, toolpath.end[[move]], options.shaft_mm)
        lowest = min(toolpath.start[move, 2], toolpath.end[move, 2])
        assert lowest >= top + options.lift_mm - 1e-9


def test_low_travels_are_taken_where_the_way_is_free():
    toolpath = embedded_toolpath(random_tree(20, 10, 3, 0.1), OPTIONS)
    across = np.any(toolpath.start[:, :2] != toolpath.end[:, :2], axis=1)
    level = toolpath.end[(toolpath.kind == MoveKind.TRAVEL) & across, 2]
    written = toolpath.end[toolpath.kind == MoveKind.WRITE, 2]
    assert (level < written.max()).sum() > len(level) / 2


def test_a_head_is_changed_above_everything_written():
    net = random_tree(12, 10, 3, 0.1)
    heads = EmbeddedHeads((OPTIONS, OPTIONS), np.arange(net.vessel_count) % 2)
    toolpath = plan_embedded(net, heads).toolpath
    changes = np.flatnonzero(np.diff(toolpath.tool) != 0)
    assert len(changes) > 0
    for row in changes.tolist():
        ink, radius, _ = written_before(toolpath, row + 1)
        assert toolpath.end[row, 2] >= (ink[:, 2] + radius).max() + OPTIONS.lift_mm - 1e-9


def kinds_between(toolpath, vessel, after):
    """Kinds of the moves between the last one that writes a vessel and the first of the next."""
    write = toolpath.kind == MoveKind.WRITE
    last = np.flatnonzero(write & (toolpath.source == vessel))[-1]
    first = np.flatnonzero(write & (toolpath.source == after))[0]
    return toolpath.kind[last + 1 : first].tolist()


def test_the_plunger_is_relieved_in_place_where_a_pass_goes_on_much_thinner():
    line = np.array([[0.0, 0, 0], [5, 0, 0], [10, 0, 0]])
    net = polylines([line[:2], line[1:]], 0.15)
    stepped = replace(net, radius=np.repeat([0.4, 0.15], 2))
    assert kinds_between(embedded_toolpath(stepped, OPTIONS), 0, 1) == [
        MoveKind.RETRACT,
        MoveKind.PRIME,
    ]
    alike = replace(net, radius=np.repeat([0.2, 0.15], 2))
    assert kinds_between(embedded_toolpath(alike, OPTIONS), 0, 1) == []


SHAFT = 0.2


@pytest.mark.parametrize("seed", first_of(range(6), 2))
def test_the_ground_is_never_below_the_highest_ink_nor_far_above(seed):
    rng = np.random.default_rng(seed)
    line = np.cumsum(rng.normal(0, [0.5, 0.5, 1.0], (12, 3)), axis=0)
    radius = rng.uniform(0.05, 0.3, 12)
    ground = ground_under(line, SHAFT, 0.3)
    lay(ground, line, radius, SHAFT)
    thick = np.maximum(radius[1:], radius[:-1])
    pieces = [way_sampled(a, b) for a, b in pairwise(line)]
    ink = np.concatenate(pieces)
    width = np.repeat(thick, [len(piece) for piece in pieces])
    tip = np.repeat(np.maximum(line[1:, 2], line[:-1, 2]), [len(piece) for piece in pieces])
    for _ in range(40):
        a, b = rng.uniform(line.min(axis=0) - 1, line.max(axis=0) + 1, (2, 3))
        found = highest_along(ground, a, b)
        way = way_sampled(a, b)
        assert found >= tops_under(ink, width, way, SHAFT)
        # Cells are a third of the shaft's radius wide: two of them more, and the stretch's top.
        high = np.column_stack([ink[:, :2], tip])
        assert found <= tops_under(high, width, way, SHAFT * 5 / 3 + 0.03)
