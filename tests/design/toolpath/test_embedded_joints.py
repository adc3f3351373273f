"""Choice of the pass to extend at an embedded joint, on passes laid by hand."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from design.toolpath.embedded import EmbeddedOptions
from design.toolpath.embedded.joints import Joiner
from design.toolpath.embedded.schedule import Leg, Pass
from tests.design.toolpath.embedded_parts import parts_of
from tests.design.toolpath.shapes import network, polylines, ring

OPTIONS = EmbeddedOptions(overlap_radii=4.0)
REACH = 4 * 0.15
# Two vessels head on at the origin; one bar over the left one near it, one over the right one.
NODES = [(-4, 0, 0), (0, 0, 0), (4, 0, 0), (-0.7, -2, 1), (-0.7, 2, 1), (0.7, -2, 1), (0.7, 2, 1)]
HEAD_ON = network(NODES, [(0, 1), (2, 1), (3, 4), (5, 6)], 0.15)
LEFT, RIGHT, OVER_LEFT, OVER_RIGHT = range(4)


def joined(net, vessels, options=OPTIONS):
    """Each vessel a pass from its first point to its last; `vessels` may hold (vessel, step)."""
    flat = [v[0] if isinstance(v, tuple) else v for one in vessels for v in _listed(one)]
    assert sorted(flat) == list(range(net.vessel_count))  # every vessel is in a pass
    parts = parts_of(net, options)
    joiner = Joiner(parts.elements, parts.squares, parts.meetings, parts.needle)
    return joiner.join([Pass(tuple(leg_of(parts, v) for v in _listed(one))) for one in vessels])


def _listed(one):
    return one if isinstance(one, list) else [one]


def leg_of(parts, asked):
    vessel, step = asked if isinstance(asked, tuple) else (asked, 1)
    low, high = parts.elements.first[vessel : vessel + 2].tolist()
    return Leg(low if step > 0 else high - 1, step, high - low)


def counts(found):
    return found.joints, found.overlapped, found.through, len(found.open)


def test_an_end_without_ink_isnt_carried_on():
    alone = network([*NODES[:2], *NODES[3:]], [(0, 1), (2, 3), (4, 5)], 0.15)
    found = joined(alone, [0, 1, 2])
    assert counts(found) == (0, 0, 0, 0)
    assert not found.before.any()
    assert not found.beyond.any()


def test_the_later_end_goes_on_into_the_ink():
    found = joined(HEAD_ON, [LEFT, RIGHT, OVER_LEFT, OVER_RIGHT])
    assert counts(found) == (1, 1, 0, 0)
    assert found.beyond == pytest.approx([0, REACH, 0, 0])
    back = joined(HEAD_ON, [LEFT, (RIGHT, -1), OVER_LEFT, OVER_RIGHT])
    assert back.before == pytest.approx([0, REACH, 0, 0])


def test_the_earlier_side_goes_on_where_the_later_is_blocked():
    found = joined(HEAD_ON, [LEFT, OVER_LEFT, RIGHT, OVER_RIGHT])
    assert counts(found) == (1, 1, 0, 0)
    assert found.beyond == pytest.approx([REACH, 0, 0, 0])


def test_a_joint_is_open_where_both_sides_are_blocked(monkeypatch):
    monkeypatch.setattr("design.toolpath.embedded.joints.PARTS", (1.0,))
    found = joined(HEAD_ON, [OVER_RIGHT, LEFT, OVER_LEFT, RIGHT])
    assert counts(found) == (1, 0, 0, 1)
    assert not found.beyond.any()
    (left,) = found.open
    assert (left.vessel, left.other, left.place_mm, left.part) == (RIGHT, LEFT, (0, 0, 0), 0)
    parts = parts_of(HEAD_ON, OPTIONS)
    first, after = np.array(found.reorderings).T
    assert set(parts.elements.vessel[after].tolist()) == {OVER_LEFT}
    assert set(parts.elements.end[first, 1].tolist()) == {1}


def test_where_both_sides_are_blocked_a_shorter_overlap_closes():
    found = joined(HEAD_ON, [OVER_RIGHT, LEFT, OVER_LEFT, RIGHT])
    assert counts(found) == (1, 1, 0, 0)
    (weak,) = found.shortened
    assert (weak.vessel, weak.other, weak.part) == (RIGHT, LEFT, pytest.approx(0.5))
    assert found.beyond == pytest.approx([0, 0, 0, REACH / 2])
    assert found.reorderings  # of the next round: another order would leave room for all of it


def test_an_overlap_keeps_clear_of_what_comes_later():
    """A vessel below, written last, would take the shaft through the right one's overlap."""
    under = network([*NODES[:3], (-0.5, -2, -1), (-0.5, 2, -1)], [(0, 1), (2, 1), (3, 4)], 0.15)
    found = joined(under, [LEFT, RIGHT, 2])
    assert not found.brushed
    assert found.beyond == pytest.approx([REACH, 0, 0])
    assert joined(under, [2, LEFT, RIGHT]).beyond == pytest.approx([0, 0, REACH])


def test_what_brushes_every_overlap_is_named(monkeypatch):
    monkeypatch.setattr("design.toolpath.embedded.joints.PARTS", (1.0,))
    bars = [(-0.5, -2, -1), (-0.5, 2, -1), (0.5, -2, -1), (0.5, 2, -1)]
    found = joined(
        network([*NODES[:3], *bars], [(0, 1), (2, 1), (3, 4), (5, 6)], 0.15), [0, 1, 2, 3]
    )
    assert counts(found) == (1, 1, 0, 0)
    assert found.brushed
    assert any(one.entered for one in found.brushed)


def test_what_ended_at_a_node_goes_on_when_a_pass_goes_through_it():
    tee = network([(-3, 0, 0), (0, 0, 0), (3, 0, 0), (0, -3, 0)], [(0, 1), (1, 2), (3, 1)], 0.15)
    found = joined(tee, [2, [0, 1]])
    assert counts(found) == (2, 1, 1, 0)
    assert found.beyond == pytest.approx([REACH, 0])
    later = joined(tee, [[0, 1], 2])
    assert counts(later) == (2, 1, 1, 0)
    assert later.beyond == pytest.approx([0, REACH])


def test_of_ends_at_a_node_one_that_goes_on_is_enough_for_what_goes_through():
    star = network(
        [(0, 0, 0), (-3, 0, 0), (3, 0, 0), (0, 3, 0), (0, -3, 0)],
        [(1, 0), (0, 2), (3, 0), (4, 0)],
        0.15,
    )
    found = joined(star, [2, 3, [0, 1]])
    assert counts(found) == (3, 2, 1, 0)
    assert found.beyond == pytest.approx([0, REACH, 0])


def test_passes_that_go_through_one_node_need_no_overlap():
    cross = network(
        [(0, 0, 0), (-3, 0, 0), (3, 0, 0), (0, 3, 0), (0, -3, 0)],
        [(1, 0), (0, 2), (3, 0), (0, 4)],
        0.15,
    )
    found = joined(cross, [[0, 1], [2, 3]])
    assert counts(found) == (3, 1, 2, 0)
    assert not found.beyond.any()


def test_a_ring_goes_on_over_its_own_beginning():
    found = joined(polylines([ring(3.0, 0.0)], 0.15), [0])
    assert counts(found) == (1, 1, 0, 0)
    assert (found.before[0], found.beyond[0]) == (0, pytest.approx(REACH))


def test_the_overlap_is_told_in_radii_of_the_thinner_one():
    net = replace(HEAD_ON, radius=np.repeat([0.15, 0.2, 0.1, 0.1], 2))
    found = joined(net, [LEFT, RIGHT, OVER_LEFT, OVER_RIGHT])
    assert found.beyond == pytest.approx([0, REACH, 0, 0])


def test_a_pass_doesnt_go_on_under_its_own_ink():
    """Its beginning lies over where it would go on to; it ends where another one ended."""
    over = np.array([[-0.7, 2, 1.0], [-0.7, -2, 1], [3, -4, 1], [4, 0, 0], [0, 0, 0]])
    net = polylines([np.array([[-4.0, 0, 0], [0, 0, 0]]), over], 0.15)
    found = joined(net, [0, 1])
    assert counts(found) == (1, 1, 0, 0)
    assert found.beyond == pytest.approx([REACH, 0])
