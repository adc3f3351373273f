"""`printctl overlay`, on a handmade run folder and scan.

A block of 4 × 3 × 0.5 mm in five layers with a slot from y 1.4 to 1.6; when it was scanned, one
line of the second layer had given no ink, and the fifth layer wasn't printed.
"""

from __future__ import annotations

import csv
import io
import json
import math
import shutil
from collections.abc import Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import manifold3d
import numpy as np
import pytest
from PIL import Image
from rich.console import Console

from design.network import VesselNetwork
from design.network_files.csv_format import write_network_csv
from design.solids import write_stl
from firmware_profiles import Ink, Syringe, load
from kernels.arrays import FloatArray
from printctl.pipeline.prepared.written_layers import read_written
from printctl.recipe import parse_recipe
from registration import ScanOverrides, write_scan_tiff
from registration.corrected import corrected_scan
from registration.devices.optics import OctCalibration, read_calibration, write_calibration
from registration.errors import ScanFileError
from registration.files.writers import write_scan, write_scan_oct
from registration.wall_reference import WallCalibration
from sim.devices.scanner.oct import OctOptions, simulate_oct
from sim.devices.scanner.placing import Placing, ScannerOutput
from tests.printctl.cli.shell import Shell
from tests.registration import parts
from tests.registration.devices.optics.optical import FAULT, blank, dots, reflecting
from tests.registration.files.readers.crafted import counts, scan
from tests.registration.parts import analytic_deposit, as_scan, solid

SIZE, PLACE = (4.0, 3.0, 0.5), (10.0, 20.0, 1.0)
LINE, LAYER = 0.2, 0.1
ROWS = [round(0.1 + LINE * k, 3) for k in range(15) if k != 7]
GONE_LAYER, GONE_ROW = 2, 3
RECIPE: dict[str, Any] = {
    "schema": 1,
    "name": "slot",
    "tissue": {"shape": "block", "size_mm": list(SIZE)},
    "vasculature": {"network": "network.csv", "unit": "mm"},
    "toolpath": {"method": "fresh", "layer_um": 1e3 * LAYER, "line_um": 1e3 * LINE},
    "printer": {"place_mm": list(PLACE)},
}


def gcode(rows: Sequence[float] = ROWS) -> tuple[str, list[int], list[int]]:
    """The file, the layer of each line, and the lines that write."""
    syringe, ink = load(Syringe, "hamilton_1ml"), load(Ink, "collagen_fresh")
    each = LINE * LAYER * SIZE[0] / (math.pi / 4 * syringe.inner_mm**2 * ink.flow_factor)
    text, layer, writes, pushed = ["G21", "G90", "M82", "G92 X12 Y21 Z9 E0"], [-1] * 4, [], 0.0
    for k in range(5):
        for y in rows:
            pushed += each
            text.append(f"G0 X{PLACE[0]:g} Y{PLACE[1] + y:g} Z{PLACE[2] + LAYER * (k + 1):g} F2400")
            text.append(f"G1 X{PLACE[0] + SIZE[0]:g} E{pushed:.5f} F1200")
            layer += [k, k]
            writes.append(len(text))
    return "\n".join(text) + "\n", layer, writes


def make_run(folder: Path, rows: Sequence[float] = ROWS, **toolpath: Any) -> None:
    folder.mkdir()
    said = RECIPE | {"toolpath": {**RECIPE["toolpath"], **toolpath}}
    recipe = parse_recipe(said, "here").model_dump(mode="json", by_alias=True)
    (folder / "manifest.json").write_text(json.dumps({"facts": {"recipe": recipe}, "stages": {}}))
    whole = manifold3d.Manifold.cube(SIZE)
    slot = manifold3d.Manifold.cube((SIZE[0], LINE, SIZE[2])).translate((0, 1.4, 0))
    write_stl(folder / "tissue.stl", solid(whole))
    write_stl(folder / "lumen.stl", solid(slot))
    write_stl(folder / "solid.stl", solid(whole - slot))
    axis = np.array([[0, 1.5, 0.25], [SIZE[0], 1.5, 0.25]])
    one = np.array([[0, 1]]), np.array([0.15]), np.array([4]), np.zeros(1)
    write_network_csv(folder / "network.csv", VesselNetwork.from_segments(axis, *one))
    text, layer, _ = gcode(rows)
    (folder / "part.gcode").write_text(text)
    np.savez(folder / "part.map.npz", source=np.array(layer), source_kind=np.array("layer"))


def gel_distance(points: FloatArray) -> FloatArray:
    """Signed distance to what was printed, negative inside (a bound near edges)."""

    def box(low: tuple[float, float, float], high: tuple[float, float, float]) -> FloatArray:
        return np.asarray(np.maximum(low - points, points - high).max(axis=-1))

    printed = box((0, 0, 0), (SIZE[0], SIZE[1], 4 * LAYER))
    slot = box((-1, 1.4, -1), (5, 1.6, 1))
    y, z = ROWS[GONE_ROW], LAYER * (GONE_LAYER - 1)
    gone = box((1, y - LINE / 2, z), (3, y + LINE / 2, z + LAYER))
    return np.maximum(printed, -np.minimum(slot, gone))


@cache
def scanned() -> ScannerOutput:
    """By simulated OCT: tilted and turned a little, nothing shrunk."""
    ink = analytic_deposit(gel_distance, np.zeros(3), np.array([4.0, 3.0, 0.4]), 0.02)
    placing = Placing(shrink=(1, 1, 1))
    return simulate_oct(ink, OctOptions(voxel_mm=(0.015, 0.02, 0.02), placing=placing), 3)


@pytest.fixture
def overlay(tmp_path: Path, shell: Shell) -> Shell:
    make_run(tmp_path / "run")
    write_scan(tmp_path / "scan.tif", as_scan(scanned()))
    pose = np.linalg.inv(scanned().pose_truth)
    pose[:3, 3] -= parts.PLACE
    (tmp_path / "registration.json").write_text(json.dumps({"scaled_scan_to_part": pose.tolist()}))
    return shell.of("overlay", "scan.tif", "--out", "out", "--model")


POSE = ("--pose", "registration.json")


def test_a_scan_in_mid_print_shows_the_missing_line_and_its_line_of_the_file(
    tmp_path: Path, overlay: Shell
) -> None:
    code, out, _ = overlay("run", *POSE)
    assert code == 0
    assert out.startswith("The pose is that of registration.json, scaled fit; this scan itself")
    assert "4 printed, 1 not printed" in out
    line = gcode()[2][len(ROWS) * (GONE_LAYER - 1) + GONE_ROW]
    assert f"line {line} of the G-code" in out
    data = json.loads((tmp_path / "out/overlay.json").read_text())
    gap = data["layers"][GONE_LAYER - 1]["gaps"][0]
    assert gap["lines"] == [line]
    assert gap["at_mm"][1:] == pytest.approx([ROWS[GONE_ROW], 0.15], abs=0.04)
    assert gap["area_mm2"] == pytest.approx(2 * LINE, rel=0.25)
    assert [one["gap_count"] for one in data["layers"]] == [0, 1, 0, 0, None]
    assert [one["blob_count"] for one in data["layers"]] == [0, 0, 0, 0, None]
    rows = list(csv.DictReader(io.StringIO((tmp_path / "out/overlay.csv").read_text())))
    assert rows[1]["largest_gap_lines"] == str(line)
    assert rows[4]["status"] == "not printed"
    names = sorted(path.name for path in (tmp_path / "out").iterdir())
    pictures = [f"layer_{k:04d}.png" for k in range(1, 6)]
    assert names == [*pictures, "overlay.csv", "overlay.html", "overlay.json"]
    page = (tmp_path / "out/overlay.html").read_text(encoding="utf-8")
    assert page.count("data:image/png;base64,") == 5
    assert f"Line {line} of the G-code should have filled it." in page
    assert "http" not in page.replace("http-equiv", "")


@pytest.mark.slow
def test_a_calibration_of_walls_moves_gels_border(tmp_path: Path, overlay: Shell) -> None:
    """The slot of 0.2 mm is free of lines; its walls further back leave less gel in it."""
    share = []
    for offset_um in (-60.0, -20.0, 20.0):
        walls = WallCalibration(offset_um, 0.6, 150.0, 250.0, 10)
        write_calibration(tmp_path / "device.yaml", OctCalibration(walls=walls))
        option = "--walls" if offset_um < 0 else "--oct-calibration"
        data = overlay.json("run", *POSE, "--layer", "3", option, "device.yaml")
        assert data["walls"]["offset_um"] == offset_um
        share.append(data["layers"][0]["gel_in_free_share"])
    # Both walls of 0.2 mm go 40 um aside.
    assert share[0] - share[1] == pytest.approx(2 * 0.04 / LINE, abs=0.12)
    # Where they are further out than the slot's own no gel is left in it.
    assert share[2] < 0.05
    page = (tmp_path / "out/overlay.html").read_text(encoding="utf-8")
    assert "Walls were moved +20.0 µm into the gel" in page
    overlay.refuses("scan.tif: no calibration there", "run", *POSE, "--walls", "scan.tif", code=1)


def test_only_the_layers_that_are_asked_for(tmp_path: Path, overlay: Shell) -> None:
    data = overlay.json("run", *POSE, "--layer", "5", "--layer", "3")
    assert [one["layer"] for one in data["layers"]] == [3, 5]
    assert data["layer_count"] == 5
    assert sum(data["status_counts"].values()) == 2
    with Image.open(tmp_path / "out/layer_0005.png") as picture:
        assert picture.mode == "P"
        assert 900 < picture.size[0] < 1300


@pytest.mark.parametrize(
    ("code", "words", "command"),
    [
        (2, "--layer 9: the run has layers 1 to 5", ("run", *POSE, "--layer", "9")),
        (2, "isn't a folder", ("nowhere", *POSE)),
        (2, "has no manifest.json", (".", *POSE)),
        (1, "holds no scaled_scan_to_part", ("run", "--pose", "run/manifest.json")),
        (
            1,
            "none of slot's 5 layers lies in the scan's field of view",
            ("run", "--pose", "far.json"),
        ),
        (2, "has no layers to lay a scan over", ("embedded", *POSE)),
    ],
)
def test_what_is_wrong_is_said_in_one_message(
    code: int, words: str, command: tuple[str, ...], overlay: Shell
) -> None:
    far = np.eye(4)
    far[0, 3] = 50
    Path("far.json").write_text(json.dumps({"scaled_scan_to_part": far.tolist()}))
    shutil.copytree("run", "embedded")
    manifest = Path("embedded/manifest.json")
    data = json.loads(manifest.read_text())
    data["facts"]["recipe"]["toolpath"] = {"method": "embedded"}
    manifest.write_text(json.dumps(data))
    overlay.refuses(words, *command, code=code)
    assert not Path("out").exists()


def test_lines_written_larger_are_laid_over_the_design_in_its_size(tmp_path: Path) -> None:
    """A scaled fit takes the print back to the design's size; a rigid one leaves both alone."""
    make_run(tmp_path / "run", compensate={"shrink_percent": [2.0, 0.0, 4.0]})
    console = Console(file=io.StringIO())
    scaled, rigid = (read_written(tmp_path / "run", console, fit) for fit in ("scaled", "rigid"))
    top = rigid.layers[-1]
    assert top.high_mm == pytest.approx(5 * LAYER)
    assert top.end[:, 0].max() == pytest.approx(SIZE[0])
    top = scaled.layers[-1]
    assert top.high_mm == pytest.approx(0.96 * 5 * LAYER)
    assert top.high_mm - top.low_mm == pytest.approx(0.96 * LAYER)
    assert top.end[:, 0].max() == pytest.approx(0.98 * SIZE[0])
    assert top.end[:, 1].max() == pytest.approx(rigid.layers[-1].end[:, 1].max())
    assert not scaled.corrected
    assert "design's size" in scaled.notes[0]
    assert "as written" in rigid.notes[0]


@pytest.mark.slow
@pytest.mark.parametrize(("radial_um", "gaps"), [(-100.0, 0), (0.0, 1)])
def test_a_lumen_written_narrower_that_came_out_as_designed_is_no_gap(
    radial_um: float, gaps: int, tmp_path: Path, overlay: Shell
) -> None:
    """Here so much narrower that a line lies in it. Without a compensation that is a fault."""
    rows = [round(0.1 + LINE * k, 3) for k in range(15)]
    make_run(tmp_path / "narrower", rows, compensate={"radial_um": radial_um})
    assert overlay("narrower", *POSE, "--layer", "3")[0] == 0
    layer = json.loads((tmp_path / "out/overlay.json").read_text())["layers"][0]
    assert layer["gap_count"] == gaps
    assert layer["blob_count"] == 0
    free = LINE * SIZE[0] if radial_um else 0
    assert layer["free_mm2"] == pytest.approx(free, rel=0.05)
    said = "so that they come out as designed" in (tmp_path / "out/overlay.html").read_text("utf-8")
    assert said == bool(radial_um)


# --- `printctl calibrate oct`, and the `register` options on scan geometry
VOXEL = (0.02, 0.03, 0.03)


@pytest.fixture
def run(shell: Shell) -> Shell:
    return shell.of("calibrate", "oct")


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
    told = run.json(
        "--grid", "low.oct", "--grid", "high.oct", "--pitch-um", "500",
        "--step", "step.oct", "--height-um", "1000", "--write", "device.yaml",
    )  # fmt: skip
    fan = told["estimates"]["fan along x"]
    assert fan["value"] == pytest.approx(FAULT.fan_per_mm[0], abs=0.001)
    assert fan["low"] < fan["value"] < fan["high"]
    assert told["estimates"]["scale of depth in air"]["value"] == pytest.approx(1.0, abs=0.002)
    found = read_calibration(targets / "device.yaml")
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
    run: Shell, tmp_path: Path, old_name: bool
) -> None:
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
    run.refuses(reason, "--reference", "r", code=1)


@pytest.mark.parametrize(
    ("options", "reason", "code"),
    [
        ([], "--reference", 2),
        (["--grid", "low.oct"], "--pitch-um", 2),
        (["--step", "step.oct"], "--height-um", 2),
        (["--step", "step.oct", "--height-um", "5000"], "depth scale", 1),
        (["--step", "none.oct", "--height-um", "500"], "no such scan", 1),
        (["--step", "step.oct", "--height-um", "500", "--voxel-um", "a,b"], "--voxel-um", 2),
    ],
)
@pytest.mark.usefixtures("targets")
def test_what_is_missing_or_wrong_is_named(
    run: Shell, options: list[str], reason: str, code: int
) -> None:
    run.refuses(reason, *options, code=code)


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
