"""Scan writers: round trip, and metadata for other readers."""

import json
import zipfile
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest

from gcode.deposit.lay import Deposit
from registration import RegistrationError, Scan, read_scan
from registration.files.writers import write_scan, write_scan_oct, write_scan_zarr
from sim.devices.scanner.oct import OctOptions, simulate_oct
from tests.registration.files.readers.crafted import counts, scan

SAME = ("voxel_mm", "refractive_index", "optical_depth", "modality", "depth_down", "handedness")


@pytest.mark.parametrize("name", ["s.tif", "s.zarr"])
@pytest.mark.parametrize("kind", ["uint8", "uint16", "int16", "float32"])
@pytest.mark.parametrize("handedness", ["right", "unknown"])
def test_tiff_and_zarr_come_back_exactly(tmp_path, name, kind, handedness):
    original = scan(volume=counts(70, 6, 5).astype(kind), scale="db", handedness=handedness)
    write_scan(tmp_path / name, original)
    found = read_scan(tmp_path / name)
    np.testing.assert_array_equal(found.volume, original.volume)
    assert found.volume.dtype == original.volume.dtype
    assert all(getattr(found, n) == getattr(original, n) for n in (*SAME, "scale"))


@pytest.mark.parametrize("optical", [True, False])
def test_oct_comes_back_in_decibels(tmp_path: Path, optical: bool) -> None:
    original = scan(optical_depth=optical)
    write_scan(tmp_path / "s.oct", original)
    found = read_scan(tmp_path / "s.oct")
    assert found.scale == "db"
    back = 10 ** (found.volume.astype(float) / 10)
    np.testing.assert_allclose(back, np.maximum(counts(), 0.5), rtol=1e-5)
    assert all(getattr(found, n) == getattr(original, n) for n in SAME)


def test_oct_is_laid_out_as_thorimage_does(tmp_path: Path) -> None:
    write_scan_oct(tmp_path / "s.oct", scan(scale="db", volume=counts().astype(np.float32)))
    with zipfile.ZipFile(tmp_path / "s.oct") as archive:
        names = {info.orig_filename for info in archive.infolist()}
        root = ElementTree.fromstring(archive.read("Header.xml"))
        data = np.frombuffer(archive.read("data\\Intensity.data"), "<f4")
    assert names == {"Header.xml", "data\\Intensity.data"}
    sizes = [int(root.findtext(f"Image/SizePixel/Size{axis}") or 0) for axis in "YXZ"]
    # Depth fastest, then x, then y: as Thorlabs' own MATLAB function reshapes it.
    np.testing.assert_array_equal(data.reshape(sizes), counts().transpose(1, 2, 0))
    assert float(root.findtext("Image/SizeReal/SizeZ") or 0) == pytest.approx(9 * 0.02)
    assert root.findtext("Acquisition/RefractiveIndex") == "1.0"


def test_ome_zarr_says_its_voxels_to_others(tmp_path: Path) -> None:
    write_scan_zarr(tmp_path / "s.ome.zarr", scan())
    said = json.loads((tmp_path / "s.ome.zarr" / ".zattrs").read_text())["multiscales"][0]
    assert [axis["name"] for axis in said["axes"]] == ["z", "y", "x"]
    (scale,) = said["datasets"][0]["coordinateTransformations"]
    assert scale["scale"] == pytest.approx([0.02 / 1.34, 0.03, 0.031])
    assert said["name"] == "s"


def test_what_a_format_cant_hold_is_refused(tmp_path: Path) -> None:
    with pytest.raises(RegistrationError, match="holds OCT"):
        write_scan(tmp_path / "s.oct", scan(modality="microct"))
    with pytest.raises(RegistrationError, match="name it so"):
        write_scan(tmp_path / "s.png", scan())


@pytest.mark.parametrize("name", ["scan.oct", "scan.zarr"])
def test_a_simulated_scan_passes_through_either_format(tmp_path: Path, name: str) -> None:
    block = np.zeros((30, 40, 50), np.uint8)
    block[5:25, 5:35, 5:45] = 255
    found = simulate_oct(Deposit(block, np.zeros(3), 0.05, "layered", 40.0, 0.0), OctOptions(), 3)
    original = Scan(
        found.volume, found.voxel_mm, found.refractive_index, found.optical_depth, found.scale,
        found.modality, found.depth_down, Path("x"),
    )  # fmt: skip
    write_scan(tmp_path / name, original)
    back = read_scan(tmp_path / name)
    linear = 10 ** (back.volume / 10) if back.scale == "db" else back.volume
    np.testing.assert_allclose(linear, np.maximum(found.volume, 0.5), rtol=1e-4, atol=0.5)
    assert back.geometric_voxel_mm == original.geometric_voxel_mm
