"""Exports, read back by other programs' readers."""

from __future__ import annotations

import base64
import csv
from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree

import nrrd
import numpy as np
import pytest

from registration import RegistrationReport, Scan
from registration.files.exports import (
    write_axes_vtp,
    write_scan_nrrd,
    write_surface_vtp,
    write_tables,
)
from registration.measuring.gauging import Defect
from tests.registration.parts import as_scan, planar_network
from tests.registration.registered import planar_part

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
