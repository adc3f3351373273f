"""Complete registrations on simulated scans of analytic parts; their files and pictures."""

import base64
import csv
import json
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import manifold3d
import nrrd
import numpy as np
import pytest

from design.solids import Solid
from kernels.arrays import FloatArray
from registration import (
    RegistrationError,
    RegistrationReport,
    Scan,
    register_scan,
    report_dict,
    write_tables,
)
from registration.errors import AlignmentError, SegmentationError
from registration.files.exports import write_axes_vtp, write_scan_nrrd, write_surface_vtp
from registration.measuring.gauging import Defect, ScannedSurface
from registration.measuring.judging import Tolerances, VesselLimits, judge
from registration.measuring.judging.tolerance import symmetric
from registration.overlay.cut import Shades
from registration.segmentation import Segmentation, SegmentationOptions, segment
from registration.wall_reference import ReferenceScan, WallCalibration, measured_walls
from report.views import Views, add_scan_places, load_views, save_views, take_views
from report.views.stack import PIXELS
from sim.devices.scanner.oct import OctOptions, simulate_oct
from tests.design.networks import network as network_of
from tests.design.networks import polyline
from tests.registration import parts
from tests.registration.parts import (
    BLOCK,
    as_scan,
    bent_network,
    corners,
    lumens,
    planar_construct,
    planar_network,
    solid,
    target_error,
)
from tests.registration.phantom import ladder, ladder_construct
from tests.registration.registered import FAST, microct_of, planar_part


@pytest.fixture(scope="module")
def planar(tmp_path_factory):
    return planar_part(tmp_path_factory)


def test_pose_diameters_and_shrinkage_of_a_planar_print_are_recovered(planar):
    scanned, report = planar
    assert target_error(corners(BLOCK), report.scaled_scan_to_part, scanned.pose_truth) < 0.030
    assert not report.ambiguous
    for vessel in report.vessels[5:9]:
        assert vessel.sections > 50
        assert vessel.measured_um == pytest.approx(0.985 * vessel.designed_um, abs=30)
    assert all(abs(vessel.error_percent) < 10 for vessel in report.vessels)
    assert all(vessel.open for vessel in report.vessels)
    assert report.all_open
    assert report.rigid.rms_um > 40
    assert report.scaled.rms_um < 20
    assert report.scaled.within[100] > 0.99
    np.testing.assert_allclose(report.scale, 0.985, atol=0.006)
    x, _, z = report.surface.vertices.T
    end = (x < 0.3) & report.seen & (z < 2.7)
    assert np.median(report.deviation_um[end]) > 30


def test_places_in_gel_and_lumens_are_told_apart(planar):
    told = planar[1].gel_at
    assert told is not None
    np.testing.assert_array_equal(told, [1.0] * 15 + [0.0] * 4 + [np.nan])


@pytest.mark.slow
def test_mirrored_scan_is_refused_as_mirrored(planar):
    scan = as_scan(planar[0])
    turned = replace(scan, volume=scan.volume[:, ::-1].copy())
    with pytest.raises(AlignmentError, match="mirror image"):
        register_scan(turned, planar_construct(), planar_network(), FAST)


@pytest.mark.slow
def test_light_from_below_is_noticed(planar):
    scan = as_scan(planar[0])
    turned = replace(scan, volume=np.ascontiguousarray(scan.volume[::-1]))
    with pytest.raises(SegmentationError, match="upside down"):
        register_scan(turned, planar_construct(), planar_network())


def test_network_of_another_frame_is_refused(planar):
    moved = planar_network().moved(np.array([0.0, 0.65, 0.0]))
    with pytest.raises(RegistrationError, match="same"):
        register_scan(as_scan(planar[0]), planar_construct(), moved)


@pytest.mark.slow
def test_embedded_lumens_in_microct_are_registered_from_any_rotation_dark_or_bright() -> None:
    network = bent_network()
    scanned = microct_of(network, network, seed=3)
    report = register_scan(as_scan(scanned), solid(lumens(network)), network, FAST)
    assert target_error(network.nodes, report.scaled_scan_to_part, scanned.pose_truth) < 0.020
    assert report.scaled.rms_um < 20
    assert report.all_open
    for vessel in report.vessels:
        assert abs(vessel.error_percent) < 6
    scan = replace(as_scan(scanned), volume=np.uint16(40000) - scanned.volume)
    report = register_scan(scan, solid(lumens(network)), network, replace(FAST, lumens="bright"))
    assert report.all_open
    with pytest.raises(SegmentationError, match="bright"):
        register_scan(scan, solid(lumens(network)), network)


@pytest.mark.slow
def test_occluded_vessel_is_found_closed_and_its_neighbours_open() -> None:
    network = bent_network()
    cut = network.nodes.copy()
    ends = [cut[1] + share * (cut[2] - cut[1]) for share in (0.3, 0.75)]
    pairs = [[0, 1], [1, 6], [7, 2], [1, 3], [3, 4], [3, 5]]
    gap = network_of([*cut, *ends], pairs, [0.6, 0.45, 0.45, 0.5, 0.35, 0.35])
    scan = as_scan(microct_of(network, gap, seed=5))
    report = register_scan(scan, solid(lumens(network)), network, FAST)
    assert [vessel.open for vessel in report.vessels] == [True, False, True, True, True]
    assert report.vessels[1].narrowest_um == 0
    assert not report.all_open
    assert any("Closed vessels: 1" in note for note in report.notes)


# Scans that can't show the part, by a wrong unit, and scans of noise alone are refused plainly.


def scan(voxel_mm: float) -> Scan:
    values = np.random.default_rng(0).exponential(100, (60, 60, 60)).astype(np.float32)
    return Scan(values, (voxel_mm,) * 3, 1.34, False, "linear", "oct", True, Path("noise"))


@pytest.mark.parametrize(("voxel_mm", "extent"), [(2e-5, "0.0012"), (4.0, "240")])
def test_a_scan_in_a_wrong_unit_is_refused_with_both_sizes(voxel_mm: float, extent: str) -> None:
    with pytest.raises(RegistrationError, match=f"the scan is {extent} × .*--voxel-um"):
        register_scan(scan(voxel_mm), ladder_construct(), ladder())


@pytest.mark.filterwarnings("error")
def test_noise_alone_is_refused_without_a_warning() -> None:
    with pytest.raises(SegmentationError, match="can't be told apart"):
        segment(scan(0.03))


def test_report_is_json_with_the_promised_keys(planar):
    found = json.loads(json.dumps(report_dict(planar[1]), allow_nan=False))
    assert set(found) >= {
        "rigid", "scaled", "transform_scan_to_part", "scale", "ambiguity", "histogram", "vessels",
        "notes",
    }  # fmt: skip
    assert set(found["rigid"]["within"]) == {"25", "50", "100"}
    assert len(found["histogram"]["counts"]) == len(found["histogram"]["edges_um"]) - 1
    assert sum(found["histogram"]["counts"]) == planar[1].seen.sum()
    assert set(found["vessels"][0]) >= {
        "vessel", "kind", "designed_um", "measured_um", "error_percent", "narrowest_um", "open",
        "offset_um", "rms_um", "length_mm", "seen_fraction",
    }  # fmt: skip


# Exports, read back by other programs' readers.


NETWORK = planar_network()
WIDE = 8
OCCLUSION = Defect(
    "occlusion", 1, None, 1.0, 2.0, 1.5, (6.3, 2.6, 3.7), 1000.0, 8.0, np.nan, np.nan, np.inf, True
)


@pytest.fixture(scope="module")
def registered(tmp_path_factory: pytest.TempPathFactory) -> tuple[Scan, RegistrationReport]:
    """An OCT scan through the front door, with a defect written into what was found."""
    scanned, found = planar_part(tmp_path_factory)
    return as_scan(scanned), replace(found, defects=(OCCLUSION,))


def test_a_report_shows_itself_short_as_a_table_and_drawn(planar):
    report = planar[1]
    assert repr(report).startswith(f"<RegistrationReport deviation: RMS {report.scaled.rms_um:.4g}")
    assert len(repr(report)) < 200
    pytest.importorskip("pandas")
    table = report.to_pandas()
    assert table["measured_um"].tolist() == [vessel.measured_um for vessel in report.vessels]
    heights = report.plot().patches[0].get_data().values
    np.testing.assert_array_equal(heights, report.histogram_counts)


def test_tables_hold_every_vessel_section_and_defect(tmp_path, registered):
    _, report = registered
    names = write_tables(tmp_path, report)
    assert names == ("vessels.csv", "sections.csv", "defects.csv", "characteristics.csv")
    vessels, sections, defects, zones = (
        list(csv.DictReader((tmp_path / name).read_text("utf-8").splitlines())) for name in names
    )
    assert [int(row["vessel"]) for row in vessels] == list(range(14))
    assert float(vessels[WIDE]["measured_um"]) == report.vessels[WIDE].measured_um
    assert vessels[WIDE]["open"] == "True"
    assert float(vessels[0]["share"]) == pytest.approx(1)
    assert len(sections) == sum(vessel.sections for vessel in report.vessels)
    assert [row["feature"] for row in zones] == [one.feature for one in report.characteristics]
    assert [row["kind"] for row in defects] == ["occlusion"]
    assert float(defects[0]["x_mm"]) == 6.3
    assert defects[0]["other"] == defects[0]["percent"] == defects[0]["significance"] == ""


def vtp(path: Path) -> dict[str, np.ndarray]:
    types = {"Float32": "<f4", "Float64": "<f8", "Int32": "<i4", "Int64": "<i8", "UInt8": "u1"}
    found = {}
    for array in ElementTree.parse(path).iter("DataArray"):
        raw = base64.b64decode(array.text or "")
        assert int.from_bytes(raw[:8], "little") == len(raw) - 8
        values = np.frombuffer(raw[8:], types[array.attrib["type"]])
        parts = int(array.attrib["NumberOfComponents"])
        found[array.attrib["Name"]] = values if parts == 1 else values.reshape(-1, parts)
    return found


def test_surface_carries_its_deviation(tmp_path, registered):
    _, report = registered
    write_surface_vtp(tmp_path / "a.vtp", report)
    found = vtp(tmp_path / "a.vtp")
    assert len(found["Points"]) == len(found["deviation_um"]) == len(report.surface.vertices)
    assert len(found["connectivity"]) == 3 * len(found["offsets"]) == 3 * len(report.surface.faces)
    np.testing.assert_allclose(found["deviation_um"], report.scaled_deviation_um, atol=1e-3)
    assert set(np.unique(found["seen"])) <= {0, 1}
    # The axis runs within the scanned surface's box.
    assert (found["Points"].max(axis=0) > NETWORK.polyline(WIDE)[0].max(axis=0)).all()
    assert (found["Points"].min(axis=0) < NETWORK.polyline(WIDE)[0].min(axis=0)).all()


def test_axes_carry_the_sections(tmp_path, registered):
    _, report = registered
    write_axes_vtp(tmp_path / "a.vtp", NETWORK, report)
    found = vtp(tmp_path / "a.vtp")
    own, gauge = found["vessel"] == WIDE, report.vessels[WIDE]
    np.testing.assert_allclose(found["diameter_um"][own], gauge.diameter_um)
    begin, end = NETWORK.polyline(WIDE)[0]
    away = np.linalg.norm(found["Points"][own] - begin, axis=1)
    np.testing.assert_allclose(away, gauge.along_mm)
    assert found["offsets"][-1] == len(found["Points"])
    np.testing.assert_allclose(np.cross(found["Points"][own] - begin, end - begin), 0, atol=1e-9)


@pytest.mark.parametrize("voxel", [None, 0.1])
def test_nrrd_stands_in_the_parts_frame(tmp_path, registered, voxel):
    scan, report = registered
    write_scan_nrrd(tmp_path / "a.nrrd", scan, report, voxel)
    values, header = nrrd.read(str(tmp_path / "a.nrrd"))
    assert header["space"] == "left-posterior-superior"
    if voxel is None:
        np.testing.assert_array_equal(values, scan.volume.transpose(2, 1, 0))
    # The middle of the vessel is dark, a place well beside it bright.
    inverse = np.linalg.inv(np.asarray(header["space directions"]).T)
    middle = NETWORK.polyline(WIDE)[0].mean(axis=0)

    def brightness(place: np.ndarray) -> float:
        i, j, k = np.round(inverse @ (place - header["space origin"])).astype(int)
        return float(values[i - 2 : i + 3, j - 1 : j + 2, k - 1 : k + 2].mean())

    assert brightness(middle) < 0.5 * brightness(middle + [0.0, -0.9, 0.0])


# Raw pictures of findings and sections, with designed and found contours.


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


# Offset of walls measured on a reference, and applied to scans of its kind.


OCT: dict[str, Any] = {"modality": "oct", "voxel_um": (25.0, 25.0, 15.0)}


def reference(known: list[float], lack: float, **kind: Any) -> ReferenceScan:
    """A scan of a reference whose lumens lack so much of their diameters, um."""
    um = np.array(known)
    return ReferenceScan(um, um - lack, OCT | kind)


@pytest.mark.parametrize("known", [[400.0, 600.0, 1000.0], [600.0]])
def test_offset_is_half_of_what_diameters_lack_with_students_interval(known: list[float]) -> None:
    """One lumen of a capillary, scanned several times, is enough."""
    scans = [reference(known, lack) for lack in (8.0, 10.0, 9.0, 13.0)]
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
        measured_walls([reference([600.0], 8.0)])

    with pytest.raises(RegistrationError, match="given twice"):
        measured_walls([reference([600.0], 8.0), reference([600.0], 8.0)])
    with pytest.raises(RegistrationError, match="voxel size"):
        measured_walls([reference([400.0, 500.0], 320.0)])
    for kind in ({"modality": "microct"}, {"voxel_um": (25.0, 25.0, 30.0)}, {"material": "B"}):
        with pytest.raises(RegistrationError, match=next(iter(kind))):
            measured_walls([reference([400.0], 8.0, material="A"), reference([400.0], 8.0, **kind)])


def test_a_capillarys_diameter_moves_by_twice_the_offset_and_says_what_it_rests_on() -> None:
    size, width = np.array([6.0, 2.4, 2.0]), 0.6
    ends = np.array([[0.0, 1.2, 1.0], [6.0, 1.2, 1.0]])
    network = polyline(ends, width / 2)

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
    reference = Scan(
        grey.astype(np.uint16), (0.05,) * 3, 1.0, False, "linear", "microct", False, Path()
    )
    return segment(reference, SegmentationOptions(0.05, lumens="bright", wall_mm=wall_mm))


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
        found = surface.deviations_back(MIDDLE + radius * way, parts.HERE)
        # Free where the ball reaches beyond.
        assert np.median(found) == pytest.approx(level + wall - radius, abs=0.001)


MIDDLE = np.full(3, 19.5 * 0.05)
