"""Joints and precedence rules, against slow oracles that sample tip and ink densely."""

from __future__ import annotations

from collections import defaultdict
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from design.toolpath.embedded import EmbeddedOptions
from design.toolpath.embedded.needle import joint_reach, radius_at
from design.toolpath.embedded.rules import find_rules, one_way
from tests.design.toolpath.embedded_parts import Parts, pairs_of, parts_of, rules_of
from tests.design.toolpath.shapes import (
    cage,
    network,
    polylines,
    random_tree,
    ring,
)

OPTIONS = EmbeddedOptions()
CONE = replace(OPTIONS, needle_outer_mm=0.8, tip_outer_mm=0.31, cone_mm=1.5)
CROSSED = network([(-2, 0, 0), (2, 0, 0), (0, -2, 0.1), (0, 2, 0.1)], [(0, 1), (2, 3)], 0.15)
TILTED_RING = polylines([ring(0.9, 1.2)], 0.15)
FORKS = network(
    [(0, 0, 0), (1.5, 0, 1.2), (2, 1, 0.3), (0.4, 0.3, 1.5)], [(0, 1), (0, 2), (3, 0)], 0.15
)


def meetings_of(net, parts: Parts):
    """(vessel, way along it, other vessel, way along that, gap) of each node and touch."""
    length = net.lengths()
    ends = [(v, k, n) for v, both in enumerate(net.vessel_nodes) for k, n in enumerate(both)]
    rows = [
        (
            v,
            j * parts.elements.length[parts.elements.vessel == v].sum(),
            w,
            k * parts.elements.length[parts.elements.vessel == w].sum(),
            0.0,
        )
        for v, j, n in ends
        for w, k, m in ends
        if n == m and (v, j) != (w, k)
    ]
    assert len(length) == net.vessel_count
    touches = parts.touches
    for (v, w), (a, b), gap in zip(touches.vessel, touches.arc, touches.gap, strict=True):
        rows += [(v, a, w, b, gap), (w, b, v, a, gap)]
    return rows


def spared(vessel, at, other, places, reach, meetings):
    """Which places (n,) along another vessel belong to a joint of the tip, at a place or (k, 1)."""
    found = (other == vessel) & (np.abs(places - at) <= reach)
    for v, own, w, there, gap in meetings:
        if v == vessel and w == other:
            found |= (np.abs(own - at) + gap <= reach) & (np.abs(places - there) <= reach)
    return found


def shaft_gap(places, needle):
    """Distance of places (k, 3), from the tip, to a shaft made of discs, the tip's the lowest."""
    across, up = np.hypot(*places[:, :2].T), places[:, 2]
    found = np.hypot(np.maximum(across - needle.shaft_mm, 0), np.minimum(up - needle.cone_mm, 0))
    height, radius = discs_of(needle)
    discs = np.hypot(np.maximum(across - radius, 0), up - height)
    return np.minimum(found, discs.min(axis=0, initial=np.inf))


@cache
def discs_of(needle):
    """Heights and radii (k, 1) of the discs of a cone, mm; none of a needle without."""
    height = np.linspace(0, needle.cone_mm, 60 if needle.cone_mm else 0)
    radius = np.array([radius_at(needle, one) for one in height])
    return height[:, None], radius[:, None]


def naive_rules(net, parts: Parts, slack: float):
    """Pairs of elements by all places of the tip and all places of the ink."""
    elements, needle = parts.elements, parts.needle
    meetings = defaultdict(list)
    for row in meetings_of(net, parts):
        meetings[row[0], row[2]].append(row)
    share = np.linspace(0, 1, 21)[:, None]
    ink = [
        elements.point[a] + share * (elements.point[b] - elements.point[a]) for a, b in elements.end
    ]
    along = elements.arc[:, None] + share.T * elements.length[:, None]
    thick = elements.radius.max(axis=1)
    middle = elements.point[elements.end].mean(axis=1)
    found = set()
    for i, vessel in enumerate(elements.vessel.tolist()):
        far = np.hypot(*(middle - middle[i])[:, :2].T)
        for j in np.flatnonzero(far < needle.shaft_mm + 2 * thick.max() + 0.4).tolist():
            reach = joint_reach(needle, max(thick[i], thick[j])) - slack
            other = int(elements.vessel[j])
            at, near = along[i][::2, None], meetings[vessel, other]
            left = ~spared(vessel, at, other, along[j], reach, near)
            from_tips = (ink[j] - ink[i][::2, None])[left]
            if i != j and len(from_tips) and shaft_gap(from_tips, needle).min() < thick[j] + slack:
                found.add((i, j))
    return found


@pytest.mark.parametrize(
    ("net", "options"),
    [
        (random_tree(4, 3, 1, 0.1), OPTIONS),
        (random_tree(4, 3, 2, 0.1), replace(OPTIONS, overlap_radii=1.5)),
        (random_tree(2, 3, 5, 0.1), CONE),
        (FORKS, OPTIONS),
        (CROSSED, OPTIONS),
        (TILTED_RING, OPTIONS),
        pytest.param(cage(3, 0.8, 1.0), OPTIONS, marks=pytest.mark.slow),
    ],
)
def test_rules_are_those_of_all_tips_and_all_ink(net, options):
    parts = parts_of(net, options)
    rules = find_rules(parts.elements, parts.squares, parts.meetings, parts.needle)
    found = set(pairs_of(rules))
    assert found or net is CROSSED  # all of which is one joint
    assert naive_rules(net, parts, -0.01) <= found <= naive_rules(net, parts, 0.01)


def test_of_two_vessels_that_bar_each_other_one_goes_first_altogether():
    """By themselves (0, 2) and (3, 1) would stay: the two would be written in turns."""
    pairs = {(0, 2): 3.0, (2, 0): 1.0, (1, 3): 1.0, (3, 1): 2.0, (3, 0): 9.0}
    kept = one_way(rules_of(pairs, 4), np.array([0, 0, 1, 1]))
    assert pairs_of(kept) == {(0, 2): 3.0, (1, 3): 1.0, (3, 0): 9.0}
