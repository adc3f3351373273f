"""Vessels that run along each other are one, those side by side are not; X-CAVATE's files."""

import re
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from design.errors import NetworkError
from design.hemodynamics import FlowConditions, solve_flow
from design.network import VesselKind, VesselNetwork
from design.network_files.by_suffix import read_network, read_with_notes, write_network
from design.network_files.merge import merge_shared, side_by_side
from design.network_files.xcavate import read_network_xcavate
from kernels.arrays import FloatArray
from tests.design.networks import polylines
from tests.design.tissue.kept import shared

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


def vessels(*lines: FloatArray, radius: float = 1.0, shared: bool = False) -> VesselNetwork:
    """Vessels with nodes of their own, or with a node wherever ends are at the same place."""
    made = polylines(lines, radius)
    if shared:
        return made
    ends = np.concatenate([each[[0, -1]] for each in lines])
    own = np.arange(len(ends)).reshape(-1, 2)
    return replace(made, nodes=ends, vessel_nodes=own, tree=np.arange(len(lines)))


def merged(*lines: FloatArray, radius: float = 1.0) -> VesselNetwork:
    return merge_shared(Path("lines"), vessels(*lines, radius=radius)).network


def drop(one: VesselNetwork) -> float:
    """Pressure drop of a flow of 1 µL/s, Pa."""
    return float(np.ptp(solve_flow(one, FlowConditions(1e-3, inlet_flow_ul_s=1.0)).pressure))


WANTED = vessels(*(line(*way) for way in TREE), shared=True)


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
    given = vessels(*doubled, line(FORK, LEFT), line(FORK, FORK2), shared=True)
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
    found, notes = merge_shared(Path("lines"), vessels(*(line(*way)[::-1] for way in WAYS)))
    assert (len(found.inlets()), len(found.outlets())) == (3, 1)
    assert "all 3 lines run to one end, which is more likely the inlet" in notes[0]


def test_legs_of_a_hairpin_are_two_vessels(tmp_path: Path) -> None:
    legs = [line((0, 0, 0), (1, 0, 0)), line((3, 0, 0), (4, 0, 0)), line((1, 0, 0), (2, 40, 0)),
            line((2, 40, 0), (3, 0, 0))]  # fmt: skip
    hairpin = polylines(legs, np.repeat([0.3, 0.3, 0.15, 0.1], [len(one) for one in legs]))
    assert merge_shared(Path("lines"), hairpin) == (hairpin, ())
    # Formats that number nodes: no lines are merged, but those that are there twice.
    beside = polylines([*legs, line((0, 0.01, 0), (1, 0.01, 0)), legs[0][::-1]], 1.0)
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


# X-CAVATE's files: reading, joining on axes, errors named with their line.


# A trunk along x, 4 cm long and 0.1 cm in radius, and a branch that begins 0.05 cm off its axis.
TRUNK = """Vessel: 0, Number of Points: 3

0, 0, 0, 0.1
2, 0, 0, 0.1
4, 0, 0, 0.1
"""
BRANCH = """Vessel: 1, Number of Points: 3
1, 0.05, 0, 0.04
1, 1, 0, 0.04
1, 2, 0, 0.03"""


def _written(folder: Path, text: str) -> Path:
    path = folder / "network.txt"
    path.write_text(text)
    return path


def test_a_branch_is_put_on_the_trunks_axis(tmp_path: Path) -> None:
    found = read_network_xcavate(_written(tmp_path, TRUNK + BRANCH))
    network = found.network
    assert network.vessel_count == 3
    assert sorted(network.degree().tolist()) == [1, 1, 1, 3]
    joint = network.nodes[np.argmax(network.degree())]
    assert joint.tolist() == [10.0, 0.0, 0.0]
    assert sorted(network.lengths().tolist()) == [10.0, 20.0, 30.0]
    (snap,) = found.snaps
    assert (snap.vessel, snap.onto, snap.end) == (1, 0, "start")
    assert snap.moved_mm == pytest.approx(0.5)
    assert "0.500 mm at most (start of the file's vessel 1, on vessel 0); free" in found.notes[0]
    assert network.radius.max() == 1.0
    assert network.radius.min() == pytest.approx(0.3)


@pytest.mark.parametrize(("off_cm", "joined"), [(0.104, True), (0.106, False)])
def test_the_reach_is_the_trunks_radius_and_5_percent(tmp_path, off_cm, joined):
    text = TRUNK + BRANCH.replace("1, 0.05", f"1, {off_cm}")
    assert len(read_network_xcavate(_written(tmp_path, text)).snaps) == joined


def test_detached_vessels_are_named_with_their_distance(tmp_path: Path) -> None:
    apart = BRANCH.replace("1, 0.05", "1, 0.2") + "\nVessel: 7, Number of Points: 2\n"
    # Vessel 7 joins vessel 1; vessel 9's middle passes 3.58 mm beside the trunk's end at 40 mm.
    apart += "1.02, 1, 0, 0.02\n3, 1, 0, 0.02\nVessel: 9, Number of Points: 2\n"
    apart += "3.9, 0, -1, 0.03\n4.4, 0, 0, 0.03\n"
    notes = read_network_xcavate(_written(tmp_path, TRUNK + apart)).notes
    branch = "in 3 pieces; apart from the largest: vessels 1, 7 (vessel 1, 2 mm from vessel 0); "
    assert f"{branch}vessel 9 ({4 / np.hypot(0.5, 1):.3g} mm from vessel 0)" in notes[-1]
    assert len(read_network_xcavate(_written(tmp_path, TRUNK + BRANCH)).notes) == 1


def test_improbable_sizes_need_the_unit_which_every_reader_takes(tmp_path: Path) -> None:
    in_mm = "Vessel: 0, Number of Points: 2\n0, 0, 0, 0.5\n20, 0, 0, 0.5\n"
    path = _written(tmp_path, in_mm)
    with pytest.raises(NetworkError, match=r"200 mm long.*shorter than 150 mm.*give unit"):
        read_with_notes(path)
    network = read_with_notes(path, "mm").network
    assert (network.lengths().tolist(), network.radius.tolist()) == ([20.0], [0.5, 0.5])
    ends = tmp_path / "ends.txt"
    ends.write_text("inlet\n20, 0, 0")
    assert read_with_notes(path, "mm", ends).network.nodes[0].tolist() == [20.0, 0.0, 0.0]
    assert read_with_notes(path, "cm").network.lengths().tolist() == [200.0]


def test_ends_that_meet_end_to_end_share_a_node_and_loops_close(tmp_path: Path) -> None:
    # A square of four vessels, each ending 0.01 cm beside the next one's beginning.
    corners = [(0, 0), (1, 0), (1, 1), (0, 1)]
    text = ""
    for k, (x, y) in enumerate(corners):
        to = corners[(k + 1) % 4]
        text += (
            f"Vessel: {k}, Number of Points: 2\n{x}, {y}, 0.01, 0.05\n{to[0]}, {to[1]}, 0, 0.05\n"
        )
    network = read_network_xcavate(_written(tmp_path, text)).network
    assert network.vessel_count == 4
    assert network.degree().tolist() == [2, 2, 2, 2]


def test_an_end_within_which_another_lies_is_not_free(tmp_path: Path) -> None:
    lines = ("0, 0, 0, 0.05\n1, 0, 0, 0.05\n", "1.06, 0, 0, 0.1\n2, 0, 0, 0.1\n")
    heads = (f"Vessel: {k}, Number of Points: 2\n{line}" for k, line in enumerate(lines))
    found = read_network_xcavate(_written(tmp_path, "".join(heads)))
    assert found.notes[-1].endswith("free ends (inlets, outlets or loose): 2.")


def test_a_fifth_column_says_artery_or_vein(tmp_path: Path) -> None:
    rows = ["0, 0, 0, 0.1, 1", "2, 0, 0, 0.1, 1", "2.5, 0, 0, 0.1, 0", "4, 0, 0, 0.1, 0"]
    text = "Vessel: 0, Number of Points: 4\n" + "\n".join(rows)
    network = read_network_xcavate(_written(tmp_path, text)).network
    assert network.kind.tolist() == [VesselKind.ARTERY, VesselKind.VEIN]
    assert network.lengths().tolist() == [25.0, 15.0]


def test_inlets_and_outlets_turn_vessels_round(tmp_path: Path) -> None:
    path, ends = _written(tmp_path, TRUNK), tmp_path / "ends.txt"
    ends.write_text("inlet\n4, 0, 0\noutlet\n0, 0, 0")
    assert read_network_xcavate(path).network.nodes[0].tolist() == [0.0, 0.0, 0.0]
    network = read_network_xcavate(path, ends).network
    assert network.nodes[network.inlets()].tolist() == [[40.0, 0.0, 0.0]]
    ends.write_text("inlet\n3, 0, 0")
    with pytest.raises(NetworkError, match=r"ends\.txt, line 2: .* inlet is 10 mm away"):
        read_network_xcavate(path, ends)
    ends.write_text("4, 0, 0\n")
    with pytest.raises(NetworkError, match=r"line 1: '4, 0, 0' isn't 'inlet', 'outlet' or"):
        read_network_xcavate(path, ends)


@pytest.mark.parametrize("shift", [-0.02, 0.0, 0.02])
@pytest.mark.parametrize("aside", [0.005, 0.015, 0.025])
def test_lines_through_one_trunk_are_merged_before_ends_are_moved(tmp_path, shift, aside):
    lines = [
        [*((x / 10, 0, 0) for x in range(11)), (1.6, 0.6, 0)],
        [*((x / 10 + shift, aside, 0) for x in range(11)), (1.6, -0.6, 0)],
        [*((x / 10 - shift, 0, aside) for x in range(11)), (1.6, 0, 0.6)],
    ]
    text = "".join(
        f"Vessel: {k}, Number of Points: {len(each)}\n"
        + "".join(f"{x}, {y}, {z}, 0.1\n" for x, y, z in each)
        for k, each in enumerate(lines)
    )
    network = read_network_xcavate(_written(tmp_path, text)).network
    assert (network.vessel_count, len(network.inlets()), len(network.outlets())) == (4, 1, 3)
    assert network.lengths().sum() == pytest.approx(10 + 3 * 72**0.5, rel=0.03)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "no line 'Vessel: 0"),
        ("1, 2, 3, 4\n" + TRUNK, "line 1: '1, 2, 3, 4' stands before any"),
        (TRUNK.replace("2, 0, 0, 0.1", "2, 0, zero, 0.1"), "line 4: '2, 0, zero, 0.1' isn't num"),
        (TRUNK.replace("2, 0, 0, 0.1", "2, 0, 0"), "line 4: 3 numbers; each point needs"),
        (TRUNK.replace("2, 0, 0, 0.1", "2, 0, 0, 0.1, 1"), "line 4: 5 numbers; each point needs"),
        (TRUNK.replace("2, 0, 0, 0.1", "2, 0, 0, -1"), "line 4: radius -1 isn't above 0"),
        (TRUNK.replace("2, 0, 0, 0.1", "2, nan, 0, 1"), "line 4: .* NaN or infinite"),
        (TRUNK.replace("Points: 3", "Points: 4"), "line 1: vessel 0 announces 4 points and has 3"),
        ("Vessel: 7, Number of Points: 1\n1, 1, 1, 1", "line 1: vessel 7 has fewer than two"),
        ("Vessel: 7, Number of Points: 0\n", "line 1: vessel 7 has fewer than two"),
        (
            TRUNK + "Vessel: 1, Number of Points: 2\n1, 0.01, 0, 0.1\n1, 0.02, 0, 0.1",
            "line 7: the vessel begins and ends in the same joint",
        ),
    ],
)
def test_what_cant_be_read_is_named_with_its_line(tmp_path: Path, text: str, said: str) -> None:
    with pytest.raises(NetworkError, match=said) as caught:
        read_network_xcavate(_written(tmp_path, text))
    assert re.match(r".*network\.txt[,:] ", str(caught.value))


@pytest.mark.parametrize(
    ("name", "lines", "inlet"),
    [("4", 4, (-20, -10, 10)), ("14", 14, (-20, -10, 10)), ("cnet_100", 101, (18.8, 10, 10))],
)
def test_the_fields_own_networks_are_whole(name, lines, inlet):
    found = read_network_xcavate(
        shared(f"xcavate_network_{name}_vessels.txt"),
        shared(f"xcavate_inlet_outlet_{name}_vessels.txt"),
    )
    network, joints = found.network, 2 * lines - 2
    # All but the inlet and the outlet join something, each at a place of its own.
    assert len(found.snaps) == joints
    assert network.vessel_count == lines + joints
    assert len(network.inlets()) == len(network.outlets()) == 1
    assert network.nodes[network.inlets()[0]] == pytest.approx(inlet)
    assert max(snap.moved_mm for snap in found.snaps) < 0.2
