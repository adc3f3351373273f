"""Checker of embedded prints: counts crossings, names open joints, passes clean prints."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from benchmarks.checkers.embedded_ink import STEP_MM, read_axes
from benchmarks.checkers.embedded_judge import judge
from benchmarks.checkers.read_gcode import read_moves

Points = NDArray[np.float64]

NEEDLE = 0.4
BORE = 4.0
TOP = 20.0
R = 0.2


def network(path: Path, vessels: list[tuple[Any, tuple[int, int]]], radius: float = R) -> Path:
    """A `network.csv`: polylines, each with its two nodes; inner points get nodes of their own."""
    rows = ["vessel,node0,node1,x0,y0,z0,x1,y1,z1,radius0_mm,radius1_mm,kind,tree"]
    inner = 1000
    for number, (points, (first, last)) in enumerate(vessels):
        points = np.asarray(points, dtype=np.float64)
        nodes = [first, *range(inner, inner + len(points) - 2), last]
        inner += len(points)
        for k in range(len(points) - 1):
            places = ",".join(map(str, [*points[k], *points[k + 1]]))
            rows.append(f"{number},{nodes[k]},{nodes[k + 1]},{places},{radius},{radius},artery,0")
    path.write_text("\n".join(rows) + "\n")
    return path


class Job:
    """G-code by hand: passes with the flow of their radius, lifts between them."""

    def __init__(self, relative: bool = False) -> None:
        self.relative, self.e = relative, 0.0
        self.lines = ["G21", "G90", "M83" if relative else "M82", "G92 X0 Y0 Z20 E0"]

    def go(self, *places: tuple[float, float, float]) -> Job:
        """Travel."""
        self.lines += [f"G0 X{x:.4f} Y{y:.4f} Z{z:.4f} F1200" for x, y, z in places]
        return self

    def write(self, points: Any, radius: float = R, speed: float = 5.0) -> Job:
        """Come from above, write, and go up again."""
        points = np.asarray(points, dtype=np.float64)
        x, y, z = points[0]
        self.go((x, y, TOP), (x, y, z))
        for start, end in pairwise(points):
            pushed = float(np.linalg.norm(end - start)) * radius**2 / (BORE / 2) ** 2
            self.e += pushed
            x, y, z = end
            said = pushed if self.relative else self.e
            self.lines.append(f"G1 X{x:.4f} Y{y:.4f} Z{z:.4f} E{said:.6f} F{speed * 60:g}")
        return self.go((x, y, TOP))

    def judged(self, folder: Path, network_csv: Path, **more: Any) -> dict[str, Any]:
        """What the checker says."""
        path = folder / "job.gcode"
        path.write_text("\n".join(self.lines) + "\n")
        return judge(path, network_csv, NEEDLE, syringe_bore_mm=BORE, **more)


def helix(turns: float, pitch: float, across: float) -> Points:
    angle = np.linspace(0, 2 * np.pi * turns, int(60 * turns) + 1)
    wide = across / 2
    return np.column_stack(
        [10 + wide * np.cos(angle), 10 + wide * np.sin(angle), 1 + pitch * angle / (2 * np.pi)]
    )


def test_a_helix_written_upward_is_clean_and_downward_is_not(tmp_path: Path) -> None:
    way = helix(3, 2.0, 6.0)
    csv = network(tmp_path / "n.csv", [(way, (0, 1))])
    up = Job().write(way).judged(tmp_path, csv)
    assert (up["bad_moves"], up["passes"], up["joints"], up["cuts"]) == (0, 1, 0, 0)
    assert up["volume_error_percent"] == pytest.approx(0, abs=0.1)
    assert up["overlap_ul"] == pytest.approx(0, abs=1e-3)
    down = Job().write(way[::-1]).judged(tmp_path, csv)
    # From the second turn on the shaft goes through the first: 2 of 3 turns of 60 moves, one or two
    # more by which both are as wide as they are, and the way up.
    assert 121 <= down["bad_moves"] <= 124
    assert down["bad"][0]["vessel"] == down["bad"][0]["through"] == 0


@pytest.mark.parametrize(
    ("gap_mm", "bad"), [(0.38, True), (0.42, False)], ids=["within both radii", "beyond them"]
)
def test_the_shaft_above_the_tip_counts_to_its_outer_radius(
    tmp_path: Path, gap_mm: float, bad: bool
) -> None:
    # Shaft 0.2 and ink 0.2: the vessel 3 mm below is cleared from 0.4 mm beside on.
    above = [(1, 5, 6), (9, 5, 6)]
    below = [(1, 5 + gap_mm, 3), (9, 5 + gap_mm, 3)]
    csv = network(tmp_path / "n.csv", [(above, (0, 1)), (below, (2, 3))])
    assert Job().write(below).write(above).judged(tmp_path, csv)["bad_moves"] == 0
    wrong = Job().write(above).write(below).judged(tmp_path, csv)
    # The way down, the writing, the way up.
    assert wrong["bad_moves"] == (3 if bad else 0)
    assert wrong["bad_passes"] == bad
    if bad:
        assert {(b["kind"], b["vessel"], b["through"]) for b in wrong["bad"]} == {
            ("writing", 1, 0),
            ("travel", 1, 0),
        }
        assert wrong["bad"][0]["depth_mm"] == pytest.approx(0.02, abs=0.005)


def test_each_planted_travel_through_ink_is_counted(tmp_path: Path) -> None:
    wall = [(1, 5, 3), (9, 5, 3)]
    csv = network(tmp_path / "n.csv", [(wall, (0, 1))])
    low, high = 2.9, 3.3
    clean = Job().write(wall).go((2, 1, TOP), (2, 1, high), (2, 9, high), (4, 9, high))
    assert clean.judged(tmp_path, csv)["bad_moves"] == 0
    found = clean.go((4, 9, low), (4, 1, low), (6, 1, low), (6, 9, low)).judged(tmp_path, csv)
    assert (found["bad_moves"], found["bad_travels"]) == (2, 2)
    lines = [line.split(" F")[0] for line in clean.lines]
    assert [lines[b["line"] - 1] for b in found["bad"]] == [
        "G0 X4.0000 Y1.0000 Z2.9000",
        "G0 X6.0000 Y9.0000 Z2.9000",
    ]


def test_a_joint_without_overlap_is_open_and_named(tmp_path: Path) -> None:
    one, two = [(1, 5, 3), (5, 5, 3)], [(5, 5, 3), (9, 5, 3)]
    csv = network(tmp_path / "n.csv", [(one, (0, 1)), (two, (1, 2))])
    abutting = Job().write(one).write(two).judged(tmp_path, csv)
    assert (abutting["joints"], abutting["joints_open"], abutting["bad_moves"]) == (1, 1, 0)
    assert abutting["open"][0]["vessels"] == [0, 1]
    assert abutting["open"][0]["at_mm"] == [5, 5, 3]
    for reach, closed in ((0.06, False), (0.11, True)):
        into = [(5 - reach, 5, 3), (9, 5, 3)]
        found = Job().write(one).write(into).judged(tmp_path, csv)
        assert (found["joints_open"] == 0) == closed
    assert found["overlap_ul"] == pytest.approx(np.pi * R**2 * 0.11, rel=0.2)
    assert Job().write([*one, two[1]]).judged(tmp_path, csv)["joints_open"] == 0
    missing = Job().write(one).judged(tmp_path, csv)
    assert missing["open"][0]["why"] == "nothing is written of vessel 1 there"


def test_a_branch_that_ends_short_of_its_trunk_is_open(tmp_path: Path) -> None:
    trunk = [(1, 5, 3), (5, 5, 3), (9, 5, 3)]
    csv = network(
        tmp_path / "n.csv",
        [(trunk[:2], (0, 1)), (trunk[1:], (1, 2)), ([(5, 5, 3), (5, 9, 3)], (1, 3))],
    )
    for short, closed in ((0.0, True), (0.09, True), (0.13, False), (0.3, False)):
        branch = [(5, 5 + short, 3), (5, 9, 3)]
        for job in (Job().write(trunk).write(branch), Job().write(branch).write(trunk)):
            found = job.judged(tmp_path, csv)
            assert (found["joints_open"] == 0) == closed, short
            assert found["joints"] == 1


def test_a_cut_inside_a_vessel_is_looked_at_as_well(tmp_path: Path) -> None:
    csv = network(tmp_path / "n.csv", [([(1, 5, 3), (9, 5, 3)], (0, 1))])
    first = [(1, 5, 3), (4, 5, 3)]
    for reach, still_open in ((0.0, 1), (0.11, 0)):
        found = Job().write(first).write([(4 - reach, 5, 3), (9, 5, 3)]).judged(tmp_path, csv)
        assert (found["cuts"], found["cuts_open"], found["bad_moves"]) == (1, still_open, 0)


def test_ink_beside_the_network_is_told_apart_and_not_to_be_entered(tmp_path: Path) -> None:
    vessel, prime = [(1, 5, 3), (9, 5, 3)], [(1, 1, 5), (9, 1, 5)]
    csv = network(tmp_path / "n.csv", [(vessel, (0, 1))])
    found = Job().write(prime).write(vessel).judged(tmp_path, csv)
    assert found["beside_ul"] == pytest.approx(np.pi * R**2 * 8, rel=1e-3)
    assert found["written_ul"] == pytest.approx(np.pi * R**2 * 8, rel=1e-3)
    assert found["bad_moves"] == 0
    through = Job().write(prime).write(vessel).go((3, 0, 5), (3, 2, 5)).judged(tmp_path, csv)
    assert through["bad_moves"] == 1
    assert through["bad"][-1]["through"] == -1


def test_relative_e_place_and_speed(tmp_path: Path) -> None:
    vessel = np.array([(1, 5, 3), (9, 5, 3)])
    csv = network(tmp_path / "n.csv", [(vessel, (0, 1))])
    job = Job(relative=True).write(vessel + (10, 20, 0), speed=4.0)
    found = job.judged(tmp_path, csv, place_mm=(10, 20, 0))
    assert found["written_ul"] == pytest.approx(np.pi * R**2 * 8, rel=1e-3)
    assert found["speed_least_mm_s"] == found["speed_most_mm_s"] == 4.0


def test_what_the_reader_doesnt_know_is_refused() -> None:
    with pytest.raises(ValueError, match="line 2: 'G2 X1 Y1 I1' isn't read"):
        read_moves("G90\nG2 X1 Y1 I1")


def test_where_axes_cross_each_place_belongs_to_its_own(tmp_path: Path) -> None:
    # The other axis has a dense point 12 µm away, the own one's nearest are 20 µm off.
    own = [(0, 0, 0), (25 * STEP_MM, 0, 0)]
    x = 10.5 * STEP_MM
    other = [(x, -25 * STEP_MM, 0.012), (x, 25 * STEP_MM, 0.012)]
    axes = read_axes(network(tmp_path / "network.csv", [(own, (0, 1)), (other, (2, 3))]))
    gap, vessel, arc, _ = axes.nearest(np.array([[x, 0.0, 0.0], [x, 0.0, 0.012]]))
    assert vessel.tolist() == [0, 1]
    np.testing.assert_allclose(gap, 0, atol=1e-9)
    np.testing.assert_allclose(arc, [x, 25 * STEP_MM])
