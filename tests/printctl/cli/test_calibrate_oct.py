"""`printctl calibrate oct`, and the `register` options on scan geometry."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from registration import ScanOverrides, write_scan_tiff
from registration.corrected import corrected_scan
from registration.devices.optics import OctCalibration, read_calibration, write_calibration
from registration.errors import ScanFileError
from registration.files.writers import write_scan_oct
from tests.printctl.cli.shell import Shell
from tests.registration.devices.optics.optical import FAULT, blank, dots, reflecting
from tests.registration.files.readers.crafted import counts, scan

VOXEL = (0.02, 0.03, 0.03)


@pytest.fixture
def run(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Shell:
    return Shell(monkeypatch, capsys, "calibrate", "oct")


@pytest.fixture
def targets(tmp_path: Path) -> Path:
    """Two views of a grid and a step of 1 mm, as .oct files."""
    for name, height in (("low", 0.6), ("high", 1.6)):
        shown = reflecting(
            blank((100, 120, 120), VOXEL),
            FAULT,
            lambda x, y, h=height: h + 0.01 * x,
            dots(0.5, 0.05),
        )
        write_scan_oct(tmp_path / f"{name}.oct", shown)
    step = reflecting(
        blank((100, 40, 60), VOXEL),
        OctCalibration(),
        lambda x, y: 0.4 + np.where(x > 0.9, 1.0, 0.0),
        lambda x, y: 40 + 0 * x,
    )
    write_scan_oct(tmp_path / "step.oct", step)
    return tmp_path


def test_grid_and_step_make_a_file_that_register_reads(run: Shell, targets: Path) -> None:
    out = targets / "device.yaml"
    code, text, _ = run(
        "--grid", f"{targets / 'low.oct'}", "--grid", f"{targets / 'high.oct'}",
        "--pitch-um", "500", "--step", f"{targets / 'step.oct'}", "--height-um", "1000",
        "--write", f"{out}", "--json",
    )  # fmt: skip
    assert code == 0
    told = json.loads(text)
    fan = told["estimates"]["fan along x"]
    assert fan["value"] == pytest.approx(FAULT.fan_per_mm[0], abs=0.001)
    assert fan["low"] < fan["value"] < fan["high"]
    assert told["estimates"]["scale of depth in air"]["value"] == pytest.approx(1.0, abs=0.002)
    found = read_calibration(out)
    assert found.depth_scale == pytest.approx(1.0, abs=0.002)
    assert not found.depth_standard
    np.testing.assert_allclose(found.lateral, FAULT.lateral, atol=0.002)


def reference(folder: Path, name: str, measured_um: float, **said: object) -> str:
    """A report of a capillary of 600 um."""
    vessel = {"open": True, "sections": 40, "designed_um": 600.0, "measured_um": measured_um}
    scan = {"modality": "oct", "voxel_um": [25.0, 25.0, 15.0]}
    numbers = {"vessels": [vessel], "measured_by": scan, "walls": None, **said}
    (folder / name).mkdir()
    (folder / name / "registration.json").write_text(json.dumps({"registration": numbers}))
    return name


@pytest.mark.parametrize("old_name", [False, True])
def test_a_reference_is_written_beside_grid_and_step(
    run: Shell, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, old_name: bool
) -> None:
    monkeypatch.chdir(tmp_path)
    device = replace(FAULT, refractive_index=1.35, depth_standard=True)
    write_calibration(Path("device.yaml"), device)
    record = {"material": "GelMA", "instrument": None}
    names = [
        reference(tmp_path, f"r{k}", um, record=record)
        for k, um in enumerate((590.0, 588.0, 592.0))
    ]
    given = [word for name in names for word in ("--reference", name)]
    u_um = 0.0 if old_name else 4.0
    if old_name:
        run.first = ("calibrate", "walls")
        given = names
    else:
        given += ["--reference-u-um", "4"]
    code, text, said = run(*given, "--write", "device.yaml", "--json")
    assert code == 0, said
    assert ("calibrate oct --reference" in said) == old_name
    told = json.loads(text)["estimates"]["walls lie further into the gel by"]
    assert told["value"] == pytest.approx(5.0)
    # Offsets of 5, 6 and 4 um: t of 0.975 at 2 degrees of freedom is 4.303.
    half = np.hypot(4.303 * 1.0 / np.sqrt(3), u_um / 2)
    assert told["high"] - told["value"] == pytest.approx(half, rel=1e-3)
    found = read_calibration(Path("device.yaml"))
    assert replace(found, walls=None) == device
    assert found.walls is not None
    assert found.walls.interval_um == pytest.approx(half, rel=1e-3)
    assert (found.walls.scans, found.walls.material) == (3, "GelMA")
    assert found.walls.voxel_um == (25.0, 25.0, 15.0)


@pytest.mark.parametrize(
    ("said", "reason"),
    [
        ({"walls": {"offset_um": 5.0}}, "already"),
        ({"agreement": {"other_part": True}}, "another part"),
        ({"vessels": []}, "no lumen"),
        ({"measured_by": None}, "no registration.json of a scan"),
    ],
)
def test_a_report_that_is_no_reference_is_refused(
    run: Shell, tmp_path: Path, said: dict[str, object], reason: str
) -> None:
    reference(tmp_path, "r", 590.0, **said)
    code, _, err = run("--reference", f"{tmp_path / 'r'}")
    assert (code, reason in err) == (1, True), err


@pytest.mark.parametrize(
    ("options", "reason"),
    [
        ([], "--reference"),
        (["--grid", "low.oct"], "--pitch-um"),
        (["--step", "step.oct"], "--height-um"),
        (["--step", "step.oct", "--height-um", "5000"], "depth scale"),
        (["--step", "none.oct", "--height-um", "500"], "no such scan"),
        (["--step", "step.oct", "--height-um", "500", "--voxel-um", "a,b"], "--voxel-um"),
    ],
)
def test_what_is_missing_or_wrong_is_named(
    run: Shell, targets: Path, monkeypatch: pytest.MonkeyPatch, options: list[str], reason: str
) -> None:
    monkeypatch.chdir(targets)
    code, text, said = run(*options)
    assert code in (1, 2)
    assert text == ""
    assert reason in said


def test_a_scan_is_corrected_by_its_devices_calibration(tmp_path: Path) -> None:
    path, device = tmp_path / "s.tif", tmp_path / "device.yaml"
    write_scan_tiff(path, scan(volume=counts(20, 20, 20)))
    write_calibration(device, replace(FAULT, refractive_index=1.40, depth_standard=True))
    plain = corrected_scan(path, ScanOverrides(), None, False)
    found = corrected_scan(path, ScanOverrides(), device, False)
    assert plain.optical_depth
    assert not found.optical_depth
    assert found.depth_standard
    assert any("not corrected" in note for note in plain.notes)
    assert found.voxel_mm[0] == pytest.approx(0.02 / 1.40)
    assert "index 1.4 " in found.notes[-1]
    with pytest.raises(ScanFileError, match="no calibration"):
        corrected_scan(path, ScanOverrides(), tmp_path / "none.yaml", False)
