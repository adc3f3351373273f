"""Complete registrations on simulated scans of analytic parts."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from design.network import VesselNetwork
from registration import register_scan, report_dict
from registration.errors import AlignmentError, RegistrationError, SegmentationError
from registration.scan import Scan
from registration.segmentation import segment
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


def test_planar_pose_is_recovered_within_30_um(planar):
    scanned, report = planar
    assert target_error(corners(BLOCK), report.scaled_scan_to_part, scanned.pose_truth) < 0.030
    assert not report.ambiguous


def test_planar_diameters_are_those_of_the_shrunken_print(planar):
    _, report = planar
    for vessel in report.vessels[5:9]:
        assert vessel.sections > 50
        assert vessel.measured_um == pytest.approx(0.985 * vessel.designed_um, abs=30)
    assert all(abs(vessel.error_percent) < 10 for vessel in report.vessels)
    assert all(vessel.open for vessel in report.vessels)
    assert report.all_open


def test_rigid_fit_reads_shrinkage_as_deviation_and_the_scaled_fit_does_not(planar):
    _, report = planar
    assert report.rigid.rms_um > 40
    assert report.scaled.rms_um < 20
    assert report.scaled.within[100] > 0.99
    np.testing.assert_allclose(report.scale, 0.985, atol=0.006)


def test_shrunken_outer_faces_deviate_positively(planar):
    _, report = planar
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
def test_embedded_lumens_in_microct_are_registered_from_any_rotation() -> None:
    network = bent_network()
    scanned = microct_of(network, network, seed=3)
    report = register_scan(as_scan(scanned), solid(lumens(network)), network, FAST)
    assert target_error(network.nodes, report.scaled_scan_to_part, scanned.pose_truth) < 0.020
    assert report.scaled.rms_um < 20
    assert report.all_open
    for vessel in report.vessels:
        assert abs(vessel.error_percent) < 6


@pytest.mark.slow
def test_bright_lumens_are_found_when_told() -> None:
    network = bent_network()
    scanned = microct_of(network, network, seed=3)
    scan = replace(as_scan(scanned), volume=np.uint16(40000) - scanned.volume)
    report = register_scan(scan, solid(lumens(network)), network, replace(FAST, lumens="bright"))
    assert report.all_open
    with pytest.raises(SegmentationError, match="bright"):
        register_scan(scan, solid(lumens(network)), network)


@pytest.mark.slow
def test_occluded_vessel_is_found_closed_and_its_neighbours_open() -> None:
    network = bent_network()
    cut = network.nodes.copy()
    gap = VesselNetwork.from_segments(
        np.vstack([cut, cut[1] + 0.3 * (cut[2] - cut[1]), cut[1] + 0.75 * (cut[2] - cut[1])]),
        np.array([[0, 1], [1, 6], [7, 2], [1, 3], [3, 4], [3, 5]]),
        np.array([0.6, 0.45, 0.45, 0.5, 0.35, 0.35]),
        np.zeros(6),
        np.zeros(6),
    )
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
    with pytest.raises(RegistrationError, match=f"the scan is {extent} × .*check --voxel-um"):
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
