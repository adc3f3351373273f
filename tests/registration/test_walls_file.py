"""Wall offset calibration: measured, saved, applied."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from registration.alignment import Fit
from registration.errors import RegistrationError
from registration.gauging import ScannedSurface
from registration.gauging.sections import cut_sections
from registration.overlay import Cutter, Raster
from registration.scan import Scan
from registration.segmentation import Segmentation, SegmentationOptions, segment
from registration.segmentation.volume import GelField
from registration.walls_file import WallCalibration, measured_walls, read_walls, write_walls
from tests.registration.test_gauging import bore, planes

WALLS = WallCalibration(4.5, 0.6, 400.0, 1000.0, 10)


def test_offset_is_half_of_what_diameters_lack_with_students_interval() -> None:
    known = np.array([400.0, 600.0, 1000.0])
    lacking = np.array([8.0, 10.0, 9.0, 13.0])
    found = measured_walls([known] * 4, [known - lack for lack in lacking])
    assert found.offset_um == pytest.approx(5.0)
    # t of 0.975 at 3 degrees of freedom is 3.182; the offsets are 4, 5, 4.5 and 6.5.
    sd = np.std([4, 5, 4.5, 6.5], ddof=1)
    assert found.interval_um == pytest.approx(3.182 * sd / 2, rel=1e-3)
    assert (found.from_um, found.to_um, found.scans) == (400.0, 1000.0, 4)


def test_one_channel_tells_nothing_and_another_part_is_refused() -> None:
    with pytest.raises(RegistrationError, match="several channels"):
        measured_walls([np.array([400.0])], [np.array([390.0])])
    with pytest.raises(RegistrationError, match="voxel size"):
        measured_walls([np.array([400.0, 500.0])], [np.array([100.0, 150.0])])


def test_file_is_read_back(tmp_path: Path) -> None:
    write_walls(tmp_path / "walls.yaml", WALLS)
    assert read_walls(tmp_path / "walls.yaml") == WALLS


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("nonsense", "schema"),
        ("schema: printctl-walls-1\noffset_um: 3\n", "must hold"),
        (
            "{schema: printctl-walls-1, offset_um: 300, interval_um: 1, from_um: 1, to_um: 2, "
            "scans: 1}",
            "within 100 um",
        ),
    ],
)
def test_what_is_no_calibration_is_refused(tmp_path: Path, text: str, reason: str) -> None:
    (tmp_path / "walls.yaml").write_text(text)
    with pytest.raises(RegistrationError, match=reason):
        read_walls(tmp_path / "walls.yaml")
    with pytest.raises(RegistrationError, match="calibrate walls"):
        read_walls(tmp_path / "none.yaml")


def test_sections_are_wider_by_twice_the_offset() -> None:
    field = bore(0.4)
    moved = GelField(*(getattr(field, name) for name in FIELD), wall_mm=0.005)
    plain, found = (cut_sections(each, planes(0.4, [1.0, 2.0])).diameter for each in (field, moved))
    np.testing.assert_allclose(found - plain, 0.010, atol=1e-9)


def bright_ball(wall_mm: float) -> Segmentation:
    """A ball of 0.6 mm full of contrast agent, in gel."""
    index = np.indices((40, 40, 40)) - 19.5
    grey = np.random.default_rng(0).integers(80, 120, index.shape[1:])
    grey += 1000 * (np.linalg.norm(index, axis=0) < 12)
    scan = Scan(grey.astype(np.uint16), (0.05,) * 3, 1.0, False, "linear", "microct", False, Path())
    return segment(scan, SegmentationOptions(0.05, lumens="bright", wall_mm=wall_mm))


def radii(ball: Segmentation) -> np.ndarray:
    return np.linalg.norm(ball.surface.vertices - MIDDLE, axis=1)


def test_a_bright_ball_in_gel_is_wider_by_it() -> None:
    plain, moved = (radii(bright_ball(wall)).mean() for wall in (0.0, 0.01))
    assert moved - plain == pytest.approx(0.01, rel=0.05)


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


@pytest.mark.parametrize("wall", [0.01, 0.0, -0.01])
def test_a_cut_through_a_bright_ball_is_wider_by_it(wall: float) -> None:
    """As the overlay holds it against the lines: by the area of what isn't gel."""
    ball = bright_ball(wall)
    scan = Scan(np.zeros((40, 40, 40)), (0.05,) * 3, 1.0, False, "linear", "microct", False, Path())
    raster = Raster((0.2, 0.2), 0.004, (390, 390))
    found = Cutter(scan, ball, np.eye(4)).cut(raster, float(MIDDLE[2]))
    across = 2e3 * np.sqrt((~found.gel).sum() * raster.pixel_mm**2 / np.pi)
    level = 2e3 * radii(bright_ball(0.0)).mean()
    assert across == pytest.approx(level + 2e3 * wall, abs=2)


MIDDLE = np.full(3, 19.5 * 0.05)
STILL = (np.eye(3), np.zeros(3), np.ones(3), np.zeros(3))
FIELD = ("values", "level", "sign", "voxel_mm", "origin_mm", "blur_mm")
