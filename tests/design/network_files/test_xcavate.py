"""X-CAVATE network files: reading, joining on axes, errors named with their line."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from design.errors import NetworkError
from design.network import VesselKind
from design.network_files.xcavate import read_network_xcavate

SHARED = Path("/work/shared/data")

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
        (TRUNK.replace("2, 0, 0, 0.1", "2, 0, 0, -1"), "line 4: radius -1 cm isn't above 0"),
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
    path = SHARED / f"xcavate_network_{name}_vessels.txt"
    if not path.exists():
        pytest.skip("shared data isn't there")
    found = read_network_xcavate(path, SHARED / f"xcavate_inlet_outlet_{name}_vessels.txt")
    network, joints = found.network, 2 * lines - 2
    # All but the inlet and the outlet join something, each at a place of its own.
    assert len(found.snaps) == joints
    assert network.vessel_count == lines + joints
    assert len(network.inlets()) == len(network.outlets()) == 1
    assert network.nodes[network.inlets()[0]] == pytest.approx(inlet)
    assert max(snap.moved_mm for snap in found.snaps) < 0.2
