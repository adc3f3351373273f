"""Simulated scans: what lies under the scanner, how large its scan will be, and of which prints."""

from __future__ import annotations

import hashlib
import json
import math
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import tifffile
from pydantic import TypeAdapter, ValidationError

from design.network import VesselNetwork
from printctl.cli.register import read_record
from printctl.errors import UsageError
from printctl.machine.link.history_entry import PrintEntry, entry_of
from printctl.machine.link.journal import Journal
from printctl.machine.link.record import LinkRecord
from printctl.pipeline.measurement_record import Corrections, add_record
from printctl.pipeline.print_scan import StatedPrint, scan_print
from printctl.pipeline.simulated_scan import scan_size_words
from printctl.pipeline.stages.scan import digest_scan, load_scan, scan_defects
from printctl.recipe.making import FileScan, SimulatedScan
from printctl.recipe.record import RecordPart
from registration import read_scan
from registration.files.writers import write_scan_zarr
from registration.scan import Scan
from registration.wall_reference import WallCalibration
from sim.gcode.motion.executed import ExecutedMotion
from tests.registration.files.readers.crafted import counts
from tests.registration.files.readers.crafted import scan as crafted_scan

BOX = np.array([[0.0, 0.0, 0.0], [24.0, 20.0, 3.0]])


def strokes(area_mm2: float = 1.0) -> ExecutedMotion:
    """Four layers of eight level lines beside each other, 0.2 mm apart and high."""
    rows = [(k, line) for k in range(4) for line in range(8)]
    start = np.array([(10.0, 10 + 0.2 * line, 0.2 * (k + 1)) for k, line in rows])
    end = start + [3.0, 0.0, 0.0]
    pushed = 3.0 * 0.2 * 0.2 / area_mm2 * np.arange(len(rows) + 1)
    times = np.arange(len(rows) + 1.0)
    return ExecutedMotion(
        start, end, pushed[:-1], pushed[1:], times[:-1], times[1:], np.arange(len(rows))
    )


def printed(folder: Path, syringe: str = "hamilton_1ml") -> PrintEntry:
    """What `printctl print` leaves of a file of any slicer on the simulated printer."""
    folder.mkdir()
    job = folder.with_name("part.gcode")
    job.write_bytes(b"G1 X1\n")
    journal = Journal(folder / "journal.log")
    digest = hashlib.sha256(job.read_bytes()).hexdigest()
    journal.add("job", name=job.name, path=str(job), sha256=digest, lines=1, port="/dev/pts/1",
                profile="generic_marlin", pid=1, started=1e9)  # fmt: skip
    journal.close()
    care = {"syringe": syringe}
    LinkRecord(1, "", "", str(job), "generic_marlin", "/dev/pts/1", 1e9, care=care).save(folder)
    entry = entry_of(folder / "journal.log")
    assert entry is not None
    return entry


def test_a_print_without_a_recipe_is_scanned_with_its_sidecar(tmp_path: Path) -> None:
    entry, said = printed(tmp_path / "part.gcode.print"), list[str]()
    area = math.pi / 4 * 4.61**2
    strokes(area).save(tmp_path / "part.gcode.print" / "executed.npz")
    wanted = {"simulated": None, "voxel_um": (60, 60, 40), "seed": 3, "shrink_percent": 0.0}
    facts = scan_print(entry, StatedPrint(), wanted, None, said.append)
    assert said[0].startswith("the scan will be ")
    path = Path(facts["scan"])
    assert path == tmp_path / "part.gcode.print" / "scan.tif"
    found = read_scan(path)
    assert (found.modality, found.voxel_mm) == ("oct", (0.04, 0.06, 0.06))
    gel = (found.volume > 500).sum() * np.prod(found.geometric_voxel_mm)
    assert gel == pytest.approx(3.0 * 1.6 * 0.8, rel=0.35)
    # The sidecar alone tells how any other program's copy of the stack lies.
    bare = tmp_path / "bare.tif"
    tifffile.imwrite(bare, found.volume)
    bare.with_suffix(".json").write_text(Path(facts["sidecar"]).read_text())
    assert read_scan(bare).voxel_mm == found.voxel_mm


def test_a_print_whose_motors_nobody_recorded_is_refused(tmp_path: Path) -> None:
    entry = printed(tmp_path / "part.gcode.print")
    with pytest.raises(UsageError, match="simulated printer"):
        scan_print(entry, StatedPrint(), {"simulated": "oct"}, None, print)


def test_a_large_scan_wants_to_be_asked_for_and_a_smaller_one_is_proposed() -> None:
    fine = SimulatedScan(simulated="oct", voxel_um=(12, 12, 10))
    with pytest.raises(UsageError) as refused:
        scan_size_words(fine, BOX, 1, "--large")
    assert "GB" in str(refused.value)
    proposed = str(refused.value).split("voxels of ")[2].split(" µm")[0]
    x, y, z = (float(word) for word in proposed.split(", "))
    smaller = scan_size_words(fine.model_copy(update={"voxel_um": (x, y, z)}), BOX, 1, "")
    assert 120 < float(smaller.split("will be ")[1].split(" MB")[0]) <= 200
    assert "GB" in scan_size_words(fine.model_copy(update={"large": True}), BOX, 1, "")


# --- rerun of a run's scan stage after any change of the user's scan
def loaded(folder: Path, **said: Any) -> Any:
    """A scan as a recipe that says this of it reads it."""
    context: Any = SimpleNamespace(recipe_folder=folder, scan_part=FileScan(**said))
    return load_scan(context)


def test_a_recipe_says_what_the_file_doesnt(tmp_path: Path) -> None:
    counts(9, 10, 11).tofile(tmp_path / "s.raw")
    sidecar = {"shape": [9, 10, 11], "dtype": "uint16", "byte_order": "little", "axes": "zyx"}
    (tmp_path / "s.json").write_text(json.dumps(sidecar))
    found = loaded(
        tmp_path,
        file="s.raw",
        voxel_um=(30, 20, 10),
        axes="yzx",
        refractive_index=1.4,
        optical_depth=True,
        modality="oct",
        scale="db",
        counts_per_db=1,
        depth_down=False,
        mirrored=False,
    )
    assert found.volume.shape == (10, 9, 11)
    assert found.voxel_mm == pytest.approx((0.01, 0.02, 0.03))
    assert (found.scale, found.refractive_index, found.optical_depth) == ("db", 1.4, True)
    assert not found.depth_down


# --- recipe's simulated print defects: their positions in the printer's frame
NETWORK = VesselNetwork.from_segments(
    np.array([[0.0, 0, 1], [10, 0, 1]]), np.array([[0, 1]]), np.array([0.2]), np.zeros(1),
    np.zeros(1),
)  # fmt: skip
PLACE = np.array([60.0, 50.0, 0.5])


def ordered(*defects: dict[str, object]) -> SimulatedScan:
    return TypeAdapter(SimulatedScan).validate_python(
        {"simulated": "oct", "defects": list(defects)}
    )


def test_each_kind_lies_along_its_vessel_in_the_printers_frame() -> None:
    part = ordered(
        {"defect": "bulge", "vessel": 0, "at": 0.3, "height_um": 60, "towards": [0, 1, 0]},
        {"defect": "stenosis", "vessel": 0, "percent": 40},
        {"defect": "occlusion", "vessel": 0, "length_mm": 0.8},
        {"defect": "missing", "vessel": 0},
        {"defect": "leak", "vessel": 0, "diameter_um": 200, "to": [5, 0, 4]},
    )
    bulge, stenosis, occlusion, missing, leak = scan_defects(part.defects, NETWORK, PLACE)
    np.testing.assert_allclose(bulge.path, [[60, 50, 1.5], [70, 50, 1.5]])
    assert (bulge.at_mm, bulge.height_mm, bulge.radius_mm) == (3.0, 0.06, 0.2)
    np.testing.assert_array_equal(bulge.side, [0, 1, 0])
    assert stenosis.left == pytest.approx(0.6)
    assert occlusion.length_mm == 0.8
    assert occlusion.radius_mm > 0.2
    assert missing.kind == "missing"
    np.testing.assert_allclose(leak.path, [[65, 50, 1.5], [65, 50, 4.5]])
    assert leak.radius_mm == pytest.approx(0.1)


@pytest.mark.parametrize(
    "wrong",
    [
        {"defect": "crack", "vessel": 0},
        {"defect": "missing", "vessel": 0, "length_mm": 1.0},
        {"defect": "leak", "vessel": 0},
        {"defect": "stenosis", "vessel": 0, "percent": 120},
    ],
)
def test_unknown_kinds_and_keys_are_refused(wrong: dict[str, object]) -> None:
    with pytest.raises(ValidationError):
        ordered(wrong)


# --- measurement record: stated facts kept, missing or wrong ones reported
NOW = datetime(2026, 4, 2, 12, 0, tzinfo=UTC)
RECORD = """
instrument: Acme OCT-1
serial: "0042"
certificate: {number: C-7, issued: 2025-03-01, valid_until: 2026-03-01, by: Lab X}
operator: A. Smith
part: P1
scanned: 2026-04-01T14:00+02:00
temperature_c: 31
temperature_range_c: [18, 24]
"""


def scan() -> Scan:
    volume = np.zeros((2, 2, 2), dtype=np.uint8)
    return Scan(volume, (0.01, 0.02, 0.02), 1.36, True, "db", "oct", True, Path("s.tif"))


def recorded(stated: RecordPart, part: Scan | None = None) -> dict[str, Any]:
    numbers: dict[str, Any] = {"notes": ["first"], "judging": {"rule": "JCGM 106: words"}}
    add_record(numbers, stated, part or scan(), Corrections(), NOW)
    return numbers


def test_a_record_is_kept_and_what_is_wrong_with_it_noted(tmp_path: Path) -> None:
    path = tmp_path / "record.yaml"
    path.write_text(RECORD + "material: GelMA 10 %\n")
    walls = WallCalibration(4.5, 0.6, 400.0, 1000.0, 3, None, "oct", "Acme OCT-1", "GelMA 5 %")
    found = recorded(read_record(path), replace(scan(), walls=walls))
    record, notes = found["record"], found["notes"]
    assert (record["operator"], record["part"], record["serial"]) == ("A. Smith", "P1", "0042")
    assert record["certificate"]["valid_until"] == "2026-03-01"
    assert record["age_at_registration_h"] == 24.0
    assert notes[0] == "first"
    assert "certificate ended on 2026-03-01, before the scan of 2026-04-01" in notes[1]
    assert "31 °C is outside the stated range of 18 to 24 °C" in notes[2]
    assert notes[3].startswith("The walls' offset was measured with material GelMA 5 %, and this")
    assert len(notes) == 4
    assert "place of the walls, by a reference of known diameters" in record["corrected"]
    assert "beam's fan and bow" in record["not_corrected"]


@pytest.mark.parametrize(
    ("line", "why"),
    [
        ("scanned: 2026-04-01T14:00", "has no time zone"),
        ("certificate: {issued: soon}", "is no date"),
        ("temperature_range_c: [24, 18]", "let it rise"),
        ("colour: red", "colour"),
    ],
)
def test_a_wrong_record_is_refused(tmp_path: Path, line: str, why: str) -> None:
    path = tmp_path / "record.yaml"
    path.write_text(line + "\n")
    with pytest.raises(UsageError, match=why):
        read_record(path)


def test_every_file_of_a_folder_counts(tmp_path: Path) -> None:
    path = tmp_path / "s.zarr"
    write_scan_zarr(path, scan())
    before = digest_scan(path)
    write_scan_zarr(path, crafted_scan(volume=counts() + 1))
    assert digest_scan(path) != before


def test_the_scans_of_a_list_count(tmp_path: Path) -> None:
    path = tmp_path / "all.yaml"
    entries = "[{file: a.tif, at_mm: [0, 0, 0]}, {file: all.yaml, at_mm: [1, 0, 0]}]"
    path.write_text("{mosaic: tiles, scans: " + entries + "}")
    assert digest_scan(path)[1] == ""
    (tmp_path / "a.tif").write_bytes(b"1")
    before = digest_scan(path)
    (tmp_path / "a.tif").write_bytes(b"2")
    assert digest_scan(path) != before
