"""Wall offset measured on a reference, and applied to scans of its kind."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import manifold3d
import numpy as np
import pytest

from design.network import VesselNetwork
from kernels.arrays import FloatArray
from registration import register_scan
from registration.alignment import Fit
from registration.errors import RegistrationError
from registration.measuring.gauging import ScannedSurface
from registration.scan import Scan
from registration.segmentation import Segmentation, SegmentationOptions, segment
from registration.wall_reference import ReferenceScan, WallCalibration, measured_walls
from sim.devices.scanner import OctOptions, simulate_oct
from tests.registration import parts
from tests.registration.registered import FAST

OCT: dict[str, Any] = {"modality": "oct", "voxel_um": (25.0, 25.0, 15.0)}


def scan(known: list[float], lack: float, **kind: Any) -> ReferenceScan:
    """A scan of a reference whose lumens lack so much of their diameters, um."""
    um = np.array(known)
    return ReferenceScan(um, um - lack, OCT | kind)


@pytest.mark.parametrize("known", [[400.0, 600.0, 1000.0], [600.0]])
def test_offset_is_half_of_what_diameters_lack_with_students_interval(known: list[float]) -> None:
    """One lumen of a capillary, scanned several times, is enough."""
    scans = [scan(known, lack) for lack in (8.0, 10.0, 9.0, 13.0)]
    found = measured_walls(scans)
    assert found.offset_um == pytest.approx(5.0)
    # t of 0.975 at 3 degrees of freedom is 3.182; the offsets are 4, 5, 4.5 and 6.5.
    chance = 3.182 * np.std([4, 5, 4.5, 6.5], ddof=1) / 2
    assert found.interval_um == pytest.approx(chance, rel=1e-3)
    assert (found.from_um, found.to_um, found.scans) == (known[0], known[-1], 4)
    assert (found.modality, found.voxel_um) == ("oct", (25.0, 25.0, 15.0))
    # U of 6 um of diameters known too wide or too narrow together is 3 um of each wall.
    assert measured_walls(scans, 6.0).interval_um == pytest.approx(np.hypot(chance, 3.0), rel=1e-3)


def test_one_lumen_scanned_once_and_another_part_and_scans_of_two_kinds_are_refused() -> None:
    with pytest.raises(RegistrationError, match="several times"):
        measured_walls([scan([600.0], 8.0)])

    with pytest.raises(RegistrationError, match="given twice"):
        measured_walls([scan([600.0], 8.0), scan([600.0], 8.0)])
    with pytest.raises(RegistrationError, match="voxel size"):
        measured_walls([scan([400.0, 500.0], 320.0)])
    for kind in ({"modality": "microct"}, {"voxel_um": (25.0, 25.0, 30.0)}, {"material": "B"}):
        with pytest.raises(RegistrationError, match=next(iter(kind))):
            measured_walls([scan([400.0], 8.0, material="A"), scan([400.0], 8.0, **kind)])


def test_a_capillarys_diameter_moves_by_twice_the_offset_and_says_what_it_rests_on() -> None:
    size, width = np.array([6.0, 2.4, 2.0]), 0.6
    ends = np.array([[0.0, 1.2, 1.0], [6.0, 1.2, 1.0]])
    one = np.array([[0, 1]]), np.array([width / 2]), np.array([4]), np.zeros(1)
    network = VesselNetwork.from_segments(ends, *one)

    def gel(points: FloatArray) -> FloatArray:
        box = (np.abs(points - size / 2) - size / 2).max(axis=-1)
        return np.maximum(box, -parts.lumen_distance(network, points))

    bore = parts.rod(ends[0] - [1, 0, 0], ends[1] + [1, 0, 0], width / 2, 64)
    model = parts.solid(manifold3d.Manifold.cube(tuple(size)) - bore)
    ink = parts.analytic_deposit(gel, np.zeros(3), size, 0.02)
    scanned = parts.as_scan(simulate_oct(ink, OctOptions(voxel_mm=(0.03,) * 3), 1))
    walls = WallCalibration(10.0, 1.0, 500.0, 700.0, 3)
    plain, moved = (
        register_scan(each, model, network, FAST)
        for each in (scanned, replace(scanned, walls=walls))
    )
    (was,), (now,) = plain.vessels, moved.vessels
    assert now.measured_um - was.measured_um == pytest.approx(20.0, abs=1.5)
    assert now.measured_u_um < was.measured_u_um
    notes = [{term.name: term.note for term in one.budget.terms} for one in (was, now)]
    assert [one["level of the wall"] for one in notes] == [
        "halfway to the gel",
        "offset of the reference",
    ]
    assert any("+10.0 µm into the gel, the offset of a reference" in note for note in moved.notes)


def bright_ball(wall_mm: float) -> Segmentation:
    """A ball of 0.6 mm full of contrast agent, in gel."""
    index = np.indices((40, 40, 40)) - 19.5
    grey = np.random.default_rng(0).integers(80, 120, index.shape[1:])
    grey += 1000 * (np.linalg.norm(index, axis=0) < 12)
    scan = Scan(grey.astype(np.uint16), (0.05,) * 3, 1.0, False, "linear", "microct", False, Path())
    return segment(scan, SegmentationOptions(0.05, lumens="bright", wall_mm=wall_mm))


def radii(ball: Segmentation) -> np.ndarray:
    return np.linalg.norm(ball.surface.vertices - MIDDLE, axis=1)


@pytest.mark.parametrize("wall", [0.01, -0.01])
def test_the_way_back_ends_at_the_moved_wall(wall: float) -> None:
    """Also from places between it and where the field has its level."""
    way = np.random.default_rng(1).normal(size=(400, 3))
    way /= np.linalg.norm(way, axis=1)[:, None]
    level = radii(bright_ball(0.0)).mean()
    surface = ScannedSurface.of(bright_ball(wall))
    for radius in (level, level + wall / 2, level + 3 * wall):
        found = surface.deviations_back(MIDDLE + radius * way, Fit(*STILL))
        # Free where the ball reaches beyond.
        assert np.median(found) == pytest.approx(level + wall - radius, abs=0.001)


MIDDLE = np.full(3, 19.5 * 0.05)
STILL = (np.eye(3), np.zeros(3), np.ones(3), np.zeros(3))
