"""Vessels that run along each other are one; vessels side by side are not."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from design.hemodynamics import FlowConditions, solve_flow
from design.network import VesselNetwork
from design.network_files.by_suffix import read_network, write_network
from design.network_files.merge import merge_shared, side_by_side
from kernels.arrays import FloatArray

ROOT, FORK, FORK2 = (0.0, 0.0, 0.0), (0.0, 0.0, 10.0), (6.0, 0.0, 16.0)
LEFT, RIGHT, FAR = (-6.0, 0.0, 16.0), (12.0, 0.0, 16.0), (6.0, 0.0, 24.0)
WAYS = [(ROOT, FORK, LEFT), (ROOT, FORK, FORK2, RIGHT), (ROOT, FORK, FORK2, FAR)]
TREE = [(ROOT, FORK), (FORK, LEFT), (FORK, FORK2), (FORK2, RIGHT), (FORK2, FAR)]


def line(*corners: tuple[float, float, float], points: int = 0, seed: int = 0) -> FloatArray:
    """A polyline through corners; with more ``points`` at random places between them."""
    fixed = np.array(corners)
    length = np.r_[0.0, np.cumsum(np.linalg.norm(np.diff(fixed, axis=0), axis=1))]
    more = np.random.default_rng(seed).uniform(0.0, length[-1], points)
    at = np.sort(np.r_[length, more])
    return np.stack([np.interp(at, length, fixed[:, k]) for k in range(3)], axis=1)


def network(*lines: FloatArray, radius: float = 1.0, shared: bool = False) -> VesselNetwork:
    """Vessels with nodes of their own, or with a node wherever ends are at the same place."""
    ends = np.concatenate([each[[0, -1]] for each in lines])
    nodes, number = ends, np.arange(len(ends))
    if shared:
        nodes, number = np.unique(ends, axis=0, return_inverse=True)
    count = len(lines)
    points = np.concatenate(lines)
    return VesselNetwork(
        nodes=nodes,
        vessel_nodes=number.reshape(-1, 2),
        kind=np.zeros(count, dtype=np.int64),
        tree=np.zeros(count, dtype=np.int64) if shared else np.arange(count),
        offset=np.r_[0, np.cumsum([len(each) for each in lines])],
        points=points,
        radius=np.full(len(points), radius),
    )


def merged(*lines: FloatArray, radius: float = 1.0) -> VesselNetwork:
    return merge_shared(Path("lines"), network(*lines, radius=radius)).network


def drop(one: VesselNetwork) -> float:
    """Pressure drop of a flow of 1 µL/s, Pa."""
    return float(np.ptp(solve_flow(one, FlowConditions(1e-3, inlet_flow_ul_s=1.0)).pressure))


WANTED = network(*(line(*way) for way in TREE), shared=True)


@pytest.mark.parametrize("points", [0, 40])
@pytest.mark.parametrize("offset", [0.0, 0.1, 0.25])
@pytest.mark.parametrize("turned", [(), (0,), (2,), (0, 1)])
def test_ways_through_a_tree_are_the_tree(points, offset, turned):
    lines = [
        line(*way, points=points, seed=k) + [0.0, offset * (k == 1), 0.0]
        for k, way in enumerate(WAYS)
    ]
    found = merged(*(each[::-1] if k in turned else each for k, each in enumerate(lines)))
    assert found.vessel_count == 5
    assert (len(found.inlets()), len(found.outlets())) == (1, 3)
    assert len(np.unique(found.tree)) == 1
    assert found.lengths().sum() == pytest.approx(WANTED.lengths().sum(), rel=0.02)
    assert drop(found) == pytest.approx(drop(WANTED), rel=0.03)


def test_pieces_between_shared_nodes_are_merged_and_said() -> None:
    """As a reader leaves lines of the same points: every piece twice between its two nodes."""
    steps = [(0.0, 0.0, float(z)) for z in range(11)]
    doubled = [line(*pair) for pair in pairwise(steps)] * 2
    given = network(*doubled, line(FORK, LEFT), line(FORK, FORK2), shared=True)
    found, notes = merge_shared(Path("lines"), given)
    assert sorted(found.lengths()) == pytest.approx([np.sqrt(72), np.sqrt(72), 10.0])
    assert "10 of 22 merged with others over 10 mm" in notes[0]


def test_a_stretch_in_the_middle_is_one_vessel() -> None:
    one = line((-5, 0, -5), (0, 0, 0), (0, 0, 12), (-5, 0, 17), points=30)
    two = line((5, 0.1, -5), (0, 0.1, 0), (0, 0.1, 12), (5, 0.1, 17), points=30, seed=1)
    found = merged(one, two)
    assert found.vessel_count == 5
    assert (len(found.inlets()), len(found.outlets())) == (2, 2)
    assert found.lengths().max() == pytest.approx(12.0, abs=0.3)


@pytest.mark.parametrize(("away", "vessels"), [(0.9, 1), (1.0, 1), (1.6, 4), (3.0, 4)])
def test_a_line_that_leaves_the_lumen_between_makes_a_loop(away: float, vessels: int) -> None:
    """As a chord of a coarse line cuts a corner; the other line leaves it to another vessel."""
    found = merged(
        line((0, 0, 0), (0, 0, 30)),
        line((0, 0.1, 0), (0, 0.1, 10), (0, away, 14), (0, 0.1, 18), (0, 0.1, 30)),
    )
    assert found.vessel_count == vessels
    assert (len(found.inlets()), len(found.outlets())) == (1, 1)


def test_lines_that_all_run_to_one_end_are_questioned() -> None:
    found, notes = merge_shared(Path("lines"), network(*(line(*way)[::-1] for way in WAYS)))
    assert (len(found.inlets()), len(found.outlets())) == (3, 1)
    assert "all 3 lines run to one end, which is more likely the inlet" in notes[0]


def test_legs_of_a_hairpin_are_two_vessels(tmp_path: Path) -> None:
    legs = [line((0, 0, 0), (1, 0, 0)), line((3, 0, 0), (4, 0, 0)), line((1, 0, 0), (2, 40, 0)),
            line((2, 40, 0), (3, 0, 0))]  # fmt: skip
    hairpin = replace(network(*legs, shared=True), radius=np.repeat([0.3, 0.3, 0.15, 0.1], 2))
    assert merge_shared(Path("lines"), hairpin) == (hairpin, ())
    # Formats that number nodes: no lines are merged, but those that are there twice.
    beside = network(*legs, line((0, 0.01, 0), (1, 0.01, 0)), legs[0][::-1], shared=True)
    for name in ("a.json", "a.npz", "a.csv"):
        write_network(tmp_path / name, beside)
        found = read_network(tmp_path / name, "mm")
        assert found.lengths().sum() == pytest.approx(beside.lengths()[:5].sum()), name


@pytest.mark.parametrize(("apart", "told"), [(0.5, True), (0.9, True), (1.2, False), (2.1, False)])
def test_vessels_within_a_radius_of_each_other_are_told(apart: float, told: bool) -> None:
    beside = line((apart, 0.0, 2.0), (apart, 0.0, 8.0))
    found = merged(line(ROOT, FORK), beside)
    assert found.vessel_count == 2
    assert bool(side_by_side(found)) == told
    assert not side_by_side(WANTED)
