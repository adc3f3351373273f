"""Lumen openings of an embedded print, from known filaments."""

from __future__ import annotations

import numpy as np
import pytest

from design.network import VesselNetwork
from firmware_profiles import Printer, load
from printctl.checks.lumens import (
    FilamentCheck,
    Writing,
    check_filaments,
    find_filament_place,
    read_filaments,
)
from printctl.checks.lumens.filament_check import necks, segment_distances
from printctl.errors import UsageError
from tests.printctl.checks.lumens.small_gcode import UL_PER_E
from tests.printctl.checks.lumens.written_filaments import plunger_gcode

PRINTER = load(Printer, "generic_marlin")
WRITING = Writing(PRINTER, UL_PER_E)
HERE = np.zeros(3)
A, FORK = (10.0, 10.0, 5.0), (14.0, 10.0, 6.0)
B, C = (18.0, 12.0, 6.0), (18.0, 8.0, 8.0)


def fork(radii: tuple[float, float, float] = (0.4, 0.3, 0.3), trees=(0, 0, 0)) -> VesselNetwork:
    nodes = np.array([A, FORK, B, C])
    ends = np.array([[0, 1], [1, 2], [1, 3]])
    return VesselNetwork.from_segments(
        nodes, ends, np.array(radii), np.zeros(3, np.int64), np.array(trees)
    )


def check(passes, network: VesselNetwork, place=HERE, **more) -> FilamentCheck:
    ideal, stepped = read_filaments(plunger_gcode(passes, **more), WRITING)
    return check_filaments(ideal, stepped, network, place, 0.05)


WHOLE = [([A, FORK, B], 0.8), ([FORK, C], 0.6)]


def test_vessels_are_as_open_as_their_filaments_are_thick() -> None:
    found = check([([A, FORK], 0.8), ([FORK, B], 0.6), ([FORK, C], 0.5)], fork())
    assert found.refusal is None
    assert found.ideal.narrowest_mm == pytest.approx([0.8, 0.6, 0.5], abs=1e-3)
    assert found.ideal.conductance[1] == pytest.approx(1.0, abs=5e-3)
    # Poiseuille: (0.5 / 0.6)^4, but for the fork's own zone, which the others' ink fills.
    assert 0.48 < found.ideal.conductance[2] < 0.56
    assert found.passes == 3
    assert found.joints == pytest.approx([0.5 / 0.6], abs=0.01)


def test_a_filament_that_ends_short_of_the_joint_is_named() -> None:
    away = np.array(FORK) + 0.3 * (np.array(C) - FORK)
    found = check([([A, FORK, B], 0.8), ([away, C], 0.6)], fork())
    assert found.ideal.closed.tolist() == [False, False, True]
    assert "not written through: vessel 2 (1 of 3)" in str(found.refusal)
    assert found.joints.min() == 0
    at = found.ideal.at_mm[2]
    assert 0 < np.linalg.norm(at - FORK) < np.linalg.norm(away - FORK)


def test_a_vessel_that_the_plan_left_out_is_no_reason_to_refuse() -> None:
    """`toolpath.leave_out`, a refused crossing's remedy, was refused here (2026-11-26)."""
    ideal, stepped = read_filaments(plunger_gcode([([A, FORK, B], 0.8)]), WRITING)
    found = check_filaments(ideal, stepped, fork(), HERE, 0.05, frozenset({2}))
    assert found.refusal is None
    assert found.ideal.closed.tolist() == [False, False, True]
    other = check_filaments(ideal, stepped, fork(), HERE, 0.05, frozenset({1}))
    assert "not written through: vessel 2 (1 of 3)" in str(other.refusal)


def test_filaments_that_only_touch_leave_a_neck() -> None:
    """Two balls of radius 0.3 whose middles are 0.4 apart meet in a circle of radius √0.05."""
    whole = np.array([[10.0, 10, 5], [20, 10, 5]])
    network = VesselNetwork.from_segments(
        whole, np.array([[0, 1]]), np.array([0.3]), np.zeros(1, np.int64), np.zeros(1, np.int64)
    )
    passes = [([[10, 10, 5], [14.8, 10, 5]], 0.6), ([[15.2, 10, 5], [20, 10, 5]], 0.6)]
    found = check(passes, network)
    assert found.ideal.narrowest_mm[0] == pytest.approx(2 * np.sqrt(0.05), abs=0.02)
    assert found.refusal is None


def test_filaments_beside_their_vessels_count_for_as_much_as_lies_on_the_axis() -> None:
    moved = [(np.asarray(points) + [0, 0.1, 0], d) for points, d in WHOLE]
    assert check(moved, fork()).refusal is None
    far = [(np.asarray(points) + [0, 1.5, 0], d) for points, d in WHOLE]
    assert "not written through: vessel 0, 1, 2" in str(check(far, fork()).refusal)


def test_passes_side_by_side_make_one_lumen() -> None:
    """Four filaments of 0.4 mm around an axis: a lumen wider than each."""
    whole = np.array([[10.0, 10, 5], [20, 10, 5]])
    network = VesselNetwork.from_segments(
        whole, np.array([[0, 1]]), np.array([0.35]), np.zeros(1, np.int64), np.zeros(1, np.int64)
    )
    around = [(whole + [0, y, z], 0.4) for y in (-0.13, 0.13) for z in (-0.13, 0.13)]
    found = check(around, network)
    assert found.refusal is None
    assert found.ideal.mean_mm[0] > 0.5


def parallel(gap: float, trees: tuple[int, int]) -> VesselNetwork:
    """Two level vessels of 0.4 mm whose walls are designed ``gap`` apart."""
    y = 10 + 0.4 + gap
    nodes = np.array([[10.0, 10, 5], [20, 10, 5], [10, y, 5], [20, y, 5]])
    ends = np.array([[0, 1], [2, 3]])
    return VesselNetwork.from_segments(
        nodes, ends, np.array([0.2, 0.2]), np.zeros(2, np.int64), np.array(trees)
    )


@pytest.mark.parametrize("trees", [(0, 0), (0, 1)])
def test_filaments_that_swell_into_each_other_merge(trees: tuple[int, int]) -> None:
    network = parallel(0.1, trees)
    paths = [network.points[network.offset[k] : network.offset[k + 1]] for k in (0, 1)]
    thin = check([(path, 0.4) for path in paths], network)
    assert thin.merges == ()
    thick = check([(path, 0.6) for path in paths], network)
    (merge,) = thick.merges
    assert merge.vessels == (0, 1)
    # Two circles of radius 0.3, 0.5 apart: half the chord is √(0.09 - 0.0625).
    assert merge.neck_mm == pytest.approx(2 * np.sqrt(0.09 - 0.25**2), abs=2e-3)
    if trees == (0, 1):
        assert "filaments of two trees merge: vessel 0 with 1" in str(thick.refusal)
    else:
        assert thick.refusal is None
        assert "merge beside their joints: 0 with 1" in thick.notes[0]


def test_where_the_design_joins_vessels_they_dont_merge() -> None:
    assert check(WHOLE, fork(trees=(0, 0, 1))).merges == ()


def test_motor_steps_and_few_digits_stay_small() -> None:
    found = check(WHOLE, fork(), decimals=5)
    assert found.stepped.narrowest_mm == pytest.approx(found.ideal.narrowest_mm, abs=0.02)
    assert found.stepped.conductance == pytest.approx(found.ideal.conductance, abs=0.04)


def test_the_place_follows_from_the_axes() -> None:
    place = np.array([3.0, -2.0, 1.0])
    network = VesselNetwork.from_segments(
        np.array([A, FORK, B, C]) - place, np.array([[0, 1], [1, 2], [1, 3]]),
        np.array([0.4, 0.3, 0.3]), np.zeros(3, np.int64), np.zeros(3, np.int64),
    )  # fmt: skip
    ideal, _ = read_filaments(plunger_gcode(WHOLE), WRITING)
    assert find_filament_place(ideal, network) == pytest.approx(place, abs=1e-6)
    purge = [([(0, 0, 5), (5, 0, 5)], 0.8), *WHOLE]
    more, _ = read_filaments(plunger_gcode(purge), WRITING)
    with pytest.raises(UsageError, match="--place"):
        find_filament_place(more, network)


def test_a_file_without_ink_or_without_a_bore_is_refused() -> None:
    with pytest.raises(UsageError, match="pushes ink"):
        read_filaments(b"G0 X1 Y1 Z1 F600\nG0 X2\n", WRITING)
    with pytest.raises(UsageError, match="what one E means"):
        read_filaments(plunger_gcode(WHOLE), Writing(PRINTER))


def test_distances_of_pieces_are_those_of_many_sampled_points() -> None:
    random = np.random.default_rng(1)
    ends = random.normal(size=(4, 40, 3))
    ends[1, 0] = ends[0, 0]  # a piece without length
    ends[3, 1] = ends[2, 1] + 2 * (ends[1, 1] - ends[0, 1])  # parallel ones
    away, at = segment_distances(*ends)
    share = np.linspace(0, 1, 201)
    for k in range(40):
        one = ends[0, k] + share[:, None] * (ends[1, k] - ends[0, k])
        other = ends[2, k] + share[:, None] * (ends[3, k] - ends[2, k])
        sampled = np.linalg.norm(one[:, None] - other[None], axis=2).min()
        assert away[k] <= sampled + 1e-9
        assert away[k] == pytest.approx(sampled, abs=0.02)
        assert np.isfinite(at[k]).all()


def test_necks_of_balls() -> None:
    found = necks(np.array([0.0, 0.05, 0.5, 1.0]), np.full(4, 0.4), np.array([0.3, 0.3, 0.4, 0.4]))
    assert found == pytest.approx([0.6, 0.6, 2 * np.sqrt(0.16 - 0.0625), 0.0])
