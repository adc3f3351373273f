"""Compensation of a network and a solid, against results worked out by hand."""

import numpy as np
import pytest

from design.errors import NetworkError, ToolpathError
from design.network import VesselNetwork
from design.solids import Solid
from design.toolpath.correction import Corrections, Stretch, check_outside, check_walls


def network() -> VesselNetwork:
    """An inlet along x that parts into two channels, all 0.4 mm wide but the last, 0.8."""
    return VesselNetwork.from_segments(
        np.array([[0.0, 0, 0], [2, 0, 0], [6, 2, 0], [6, -2, 0]]),
        np.array([[0, 1], [1, 2], [1, 3]]),
        np.array([0.2, 0.2, 0.4]),
        np.full(3, 4),
        np.zeros(3),
    )


def test_a_stretch_keeps_its_middle_and_the_lumens_volume() -> None:
    design = network()
    stretch = Stretch((1.02, 1.05, 1.10), (3.0, 0.0, -1.0))
    written = stretch.network(design)
    np.testing.assert_allclose(written.nodes[1], [3 - 1.02, 0, -1 + 1.10])
    np.testing.assert_allclose(stretch.back(written.nodes), design.nodes, atol=1e-12)
    assert stretch.matrix @ [6, 2, 0, 1] == pytest.approx([*written.nodes[2], 1])
    volume = written.radius[::2] ** 2 * written.lengths()
    before = design.radius[::2] ** 2 * design.lengths()
    np.testing.assert_allclose(volume / before, 1.02 * 1.05 * 1.10)


def test_a_vessel_along_x_widens_by_the_other_two_axes() -> None:
    stretch = Stretch((1.08, 1.02, 1.05), (0.0, 0.0, 0.0))
    assert stretch.across(np.array([[1.0, 0, 0]]))[0] == pytest.approx(np.sqrt(1.02 * 1.05))


def test_radial_offset_follows_the_designed_diameter_within_what_was_measured() -> None:
    made = Corrections(
        radial_mm=0.02, radial_slope=0.05, radial_at_mm=0.4, radial_range_mm=(0.4, 0.6)
    )
    local = made.locally(network())
    np.testing.assert_allclose(local.radius, [0.22] * 4 + [0.43] * 2)


def test_a_moved_node_takes_all_its_vessels_along_and_no_other() -> None:
    design = network()
    local = Corrections(offset_mm={1: (0.0, 0.1, 0.0)}).locally(design)
    np.testing.assert_allclose(local.nodes[1], [2, 0.1, 0])
    for vessel, ends in enumerate(local.vessel_nodes):
        points, _ = local.polyline(vessel)
        np.testing.assert_allclose(points[[0, -1]], local.nodes[ends])
    np.testing.assert_allclose(local.nodes[[0, 2, 3]], design.nodes[[0, 2, 3]])


@pytest.mark.parametrize(
    ("made", "says"),
    [
        (Corrections(diameter_mm={0: 0.09}), r"vessel 0: its diameter of 400 um .* limit 80 um"),
        (Corrections(diameter_mm={2: -0.16}), r"vessel 2: .* -160 um, limit 150 um"),
        (Corrections(radial_mm=0.045), r"vessel 0: .*limit 80 um"),
        (Corrections(offset_mm={1: (0.1, 0.1, 0.1)}), r"node 1: it would be moved by 173 um"),
        (Corrections(Stretch((1.0, 1.2, 1.0))), "1.200 times as long along y"),
        (Corrections(Stretch((float("nan"), 1.0, 1.0))), "along x"),
        (Corrections(diameter_mm={7: 0.01}), "vessel 7 .* isn't in the network, which has 3"),
        (Corrections(offset_mm={-1: (0, 0, 0)}), "node -1 .* another design"),
    ],
)
def test_what_is_beyond_a_limit_is_refused(made: Corrections, says: str) -> None:
    with pytest.raises(ToolpathError, match=says):
        made.written(network())


def beside(gap_mm: float) -> VesselNetwork:
    """Two vessels of 0.4 mm that aren't joined, with a wall between them."""
    y = 0.4 + gap_mm
    return VesselNetwork.from_segments(
        np.array([[0.0, 0, 0], [4, 0, 0], [0, y, 0], [4, y, 0]]),
        np.array([[0, 1], [2, 3]]),
        np.full(2, 0.2),
        np.full(2, 4),
        np.array([0, 1]),
    )


def test_walls_that_a_correction_makes_too_thin_or_takes_away_are_refused() -> None:
    design = beside(0.2)
    with pytest.raises(ToolpathError, match=r"vessels 0 and 1: .* 130 um of wall .* limit 150 um"):
        check_walls(design, Corrections(diameter_mm={0: 0.07, 1: 0.07}).locally(design), 0.15)
    check_walls(design, Corrections(diameter_mm={0: 0.04}).locally(design), 0.15)
    design = beside(0.05)
    with pytest.raises(NetworkError, match="overlap"):
        check_walls(design, Corrections(diameter_mm={0: 0.08, 1: 0.08}).locally(design), 0.15)


class Slab:
    """All below y = 0.4; its surface is the plane."""

    def distance(self, points: np.ndarray) -> np.ndarray:
        return np.asarray(points[:, 1] - 0.4)


def test_lumens_that_come_too_near_to_the_outside_are_refused() -> None:
    design = VesselNetwork.from_segments(
        np.array([[0.0, 0, 0], [9, 0, 0]]), np.array([[0, 1]]), np.array([0.2]),
        np.array([4]), np.array([0]),
    )  # fmt: skip
    check_outside(design, Corrections(diameter_mm={0: 0.07}).locally(design), Slab(), 0.15)
    near = Corrections(offset_mm={0: (0, 0.08, 0), 1: (0, 0.08, 0)}).locally(design)
    with pytest.raises(ToolpathError, match="120 um between it and the outside, limit 150 um"):
        check_outside(design, near, Slab(), 0.15)


def test_a_stretched_solid_is_as_large_as_asked() -> None:
    corners = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])
    faces = np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]], dtype=np.int32)
    larger = Stretch((1.02, 1.0, 1.05), (0.5, 0.5, 0.0)).solid(Solid(corners, faces))
    np.testing.assert_allclose(larger.bounds, [[-0.01, 0, 0], [1.01, 1, 1.05]], atol=1e-6)
    assert np.array_equal(larger.vertices, larger.vertices.astype(np.float32))
