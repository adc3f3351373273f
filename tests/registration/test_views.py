"""Raw pictures of findings and sections, with designed and found contours."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest

from design.solids import Solid
from registration import RegistrationReport, Scan, report_dict
from registration.measuring.judging import Tolerances, VesselLimits, judge
from registration.measuring.judging.tolerance import symmetric
from registration.overlay.cut import Shades
from registration.report.views import Views, add_scan_places, load_views, save_views, take_views
from registration.report.views.stack import PIXELS
from tests.registration.parts import as_scan, planar_construct
from tests.registration.registered import planar_part


@dataclass(frozen=True)
class Case:
    scan: Scan
    found: RegistrationReport
    model: Solid
    numbers: dict[str, Any]
    views: Views


@pytest.fixture(scope="module")
def case(tmp_path_factory: pytest.TempPathFactory) -> Case:
    """A planar part, held against limits so narrow that every vessel has findings."""
    scanned, found = planar_part(tmp_path_factory)
    scan, model = as_scan(scanned), planar_construct()
    numbers = judge(report_dict(found), Tolerances(VesselLimits(symmetric(0.5))))
    add_scan_places(numbers, scan, found)
    return Case(scan, found, model, numbers, take_views(scan, model, found, numbers))


def test_every_finding_has_its_own_b_scan_voxel_by_voxel(case: Case) -> None:
    assert len(case.views.findings) == len(case.numbers["findings"]) > 0
    shades = Shades.of(case.scan)
    dz, _, dx = case.scan.geometric_voxel_mm
    for view in case.views.findings:
        place = case.numbers["findings"][view.finding]["scan_place"]
        left, _, _, top = view.b_scan.extent_mm
        first = round(top / dz + 0.5), round(left / dx + 0.5)
        ny, nx = view.b_scan.grey.shape
        raw = case.scan.volume[first[0] : first[0] + ny, place["b_scan"], first[1] : first[1] + nx]
        np.testing.assert_array_equal(view.b_scan.grey, shades.grey(raw))


def test_a_sections_outline_has_the_reported_diameter_and_parts_dark_from_bright(case):
    stack = case.views.sections
    side = (np.arange(PIXELS) + 0.5) / PIXELS * 2 - 1
    for k in range(0, len(stack.vessel), 40):
        row = case.numbers["vessels"][stack.vessel[k]]
        radii = np.linalg.norm(stack.wall[k] - stack.wall[k].mean(axis=0), axis=1)
        # The rays' middle isn't quite the outline's.
        reported = row["diameter_um"][stack.index[k]] / 2e3
        assert np.sqrt(np.mean(radii**2)) == pytest.approx(reported, rel=0.01)
        middle = stack.wall[k].mean(axis=0)
        away = np.hypot(*np.meshgrid(*(stack.half[k] * side - m for m in middle)))
        picture = stack.grey[k]
        assert picture[away < 0.7 * reported].mean() < 0.6 * picture[away > 1.3 * reported].mean()


def test_pictures_come_back_from_their_file_and_the_same_ones_give_the_same_bytes(case, tmp_path):
    save_views(tmp_path / "a.npz", case.views)
    again = load_views(tmp_path / "a.npz")
    save_views(tmp_path / "b.npz", again)
    assert (tmp_path / "a.npz").read_bytes() == (tmp_path / "b.npz").read_bytes()
    assert again.findings[0].b_scan.title == case.views.findings[0].b_scan.title
    np.testing.assert_array_equal(again.sections.grey, case.views.sections.grey)
