"""Simulated scans: what lies under the scanner, how large its scan will be, and of which prints."""

from __future__ import annotations

import hashlib
import json
import math
import re
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import tifffile
from pydantic import TypeAdapter, ValidationError

from gcode.motion.executed import ExecutedMotion
from printctl.errors import UsageError
from printctl.machine.records.journal import Journal
from printctl.machine.records.record import ContactRecord
from printctl.pipeline.judging.measurement_record import Corrections, add_record
from printctl.pipeline.judging.verdict import MOST_REASONS, verdict
from printctl.pipeline.past.past_print import PrintEntry, entry_of
from printctl.pipeline.running.plate.results import plate_verdict, well_figures
from printctl.pipeline.running.print_scan import StatedPrint, scan_print
from printctl.pipeline.simulated_scan import scan_size_words
from printctl.pipeline.stages.scan import digest_scan, load_scan, scan_defects
from printctl.recipe.section_files import read_record
from printctl.recipe.sections.measuring import FileScan, SimulatedScan
from printctl.recipe.sections.record import RecordPart
from registration import read_scan
from registration.files.writers import write_scan_zarr
from registration.measuring.judging import Tolerances, VesselLimits, judge, judge_plain
from registration.measuring.judging.tolerance import Override, symmetric
from registration.scan import Scan
from registration.wall_reference import WallCalibration
from tests.printctl.networks import vessels
from tests.registration.files.readers.crafted import counts
from tests.registration.files.readers.crafted import scan as crafted_scan
from tests.registration.measuring.judging.registered import (
    CONFORMANCE,
    change,
    registration,
    vessel,
)

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
    ContactRecord(1, "", "", str(job), "generic_marlin", "/dev/pts/1", 1e9, care=care).save(folder)
    entry = entry_of(folder / "journal.log")
    assert entry is not None
    return entry


def test_a_print_without_a_recipe_is_scanned_with_its_sidecar(tmp_path: Path) -> None:
    entry, said = printed(tmp_path / "part.gcode.print"), list[str]()
    area = math.pi / 4 * 4.61**2
    strokes(area).save(tmp_path / "part.gcode.print" / "executed.npz")
    wanted = {"simulated": None, "voxel_um": (60, 60, 40), "seed": 3, "shrink_percent": 0.0}
    facts = scan_print(entry, StatedPrint(), wanted, None, said.append)
    assert said[1].startswith("the scan will be ")
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


def test_how_a_print_was_written_follows_from_its_map_or_is_a_guess_that_is_told(
    tmp_path: Path,
) -> None:
    entry, said = printed(tmp_path / "part.gcode.print"), list[str]()
    strokes().save(tmp_path / "part.gcode.print" / "executed.npz")
    wanted = {"simulated": None, "voxel_um": (80, 80, 80), "seed": 3}
    assert scan_print(entry, StatedPrint(), wanted, None, said.append)["modality"] == "OCT"
    assert "--embedded: as filaments" in said[0]
    np.savez(tmp_path / "part.map.npz", source=np.zeros(1), source_kind="vessel")
    told = list[str]()
    assert scan_print(entry, StatedPrint(), wanted, None, told.append)["modality"] == "micro-CT"
    assert not any("--embedded" in one for one in told)


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
NETWORK = vessels([[0, 0, 1], [10, 0, 1]])
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


# --- verdict on a print: pass, fail, undecided
FLOW = {
    "pressure_drop_pa": 12.0,
    "designed_pressure_drop_pa": 10.0,
    "vessels": [{"vessel": v, "fed": True, "share": 0.52, "designed_share": 0.5} for v in (0, 1)],
}


def good(number: int, error: float = 5.0, **more: Any) -> dict[str, Any]:
    return vessel(number, np.full(20, error), u_um=8.0, **more)


def judged(*vessels: dict[str, Any], **more: Any) -> dict[str, Any]:
    numbers = registration(*(vessels or (good(0), good(1))), perfusion=FLOW) | more
    return verdict(judge_plain(numbers, 100.0, 10.0))


ALL_ALONG = np.full(20, -80.0)
NARROW, CLOSED = np.zeros(40), np.zeros(40)
NARROW[18:22] = -110.0
CLOSED[18:20] = -500.0
LEAK = change(1, 1.9, 2.1) | {"kind": "leak", "size_um": 200.0, "error_um": 12.0}
BRIDGE = change(0, 1.9, 2.1) | {"kind": "bridge", "other": 1, "size_um": 178.0, "error_um": 33}
MISSING = change(1, 0.0, 4.0) | {"kind": "missing"}
GONE = {**vessel(1, np.full(20, -500.0), u_um=8.0), "open": False}
SAME = {"flag": True, "rivals": [{"lead": 1.0, "same": True, "mirrored": False}]}
OTHER = {"foreign_share": 0.66, "designed_open": 0.13, "close_share": 0.92, "other_part": True}


def unfed(*numbers: int) -> dict[str, Any]:
    rows = [{**row, "fed": row["vessel"] not in numbers} for row in FLOW["vessels"]]  # type: ignore[attr-defined]
    return {"perfusion": FLOW | {"vessels": rows}}


@pytest.mark.parametrize(
    ("second", "more", "verdict_is", "words"),
    [
        (good(1), {}, "passed", ["1.20 (interval not known) times", "2 of 2 vessels pass"]),
        (good(1), {"defects": [change(1, 1.0, 1.5)]}, "passed", ["No leak or bridge"]),
        (good(1), {"scaled": {"rms_um": 130.0}}, "failed", []),
        (good(1, open=False), {}, "failed", ["Vessel 1: closed"]),
        (GONE, {"defects": [MISSING]}, "failed", ["Vessel 1 is missing"]),
        (vessel(1, ALL_ALONG, u_um=8.0), {}, "failed", ["nearly all along, by 16.0 %"]),
        (vessel(1, NARROW, u_um=8.0), {}, "failed", ["−22.0 ± 1.6 % (−110 ± 8 µm), limit ±10 %"]),
        (vessel(1, CLOSED, u_um=8.0), {}, "failed", ["closed, with 500 µm designed"]),
        (good(1), {"defects": [LEAK]}, "failed", ["Vessel 1, 2.0 mm along: a way 200 ± 12 µm"]),
        (good(1), {"defects": [BRIDGE]}, "failed", ["178 ± 33 µm wide leads into vessel 1"]),
        (good(1), {"defects": [LEAK | {"doubt": "shade"}]}, "undecided", ["not proven"]),
        (good(1), unfed(0), "failed", ["1 vessel carries no flow as printed: 0"]),
        (good(1), unfed(0, 1), "failed", ["2 vessels carry no flow as printed: 0, 1"]),
        (good(1, open=False), {"ambiguity": {"flag": True}}, "undecided", ["if the pose is right"]),
        (good(1, open=False), {"ambiguity": SAME}, "failed", ["Vessel 1: closed"]),
        (good(1, open=None, unseen_mm=[[0.5, 0.9]]), {}, "undecided",
         ["not visible in the scan from 0.5 to 0.9 mm", "Perfusion not confirmed; if vessel 1"]),
        (vessel(1, np.full(20, -40.0), u_um=20.0), {"judging": CONFORMANCE}, "undecided",
         ["−8.0 ± 4.0 %", "limit ±10 %: too close to the limit", "probability of 79 %"]),
        (good(1), {"agreement": OTHER, "scale": [1.08, 0.94, 0.95]}, "failed", ["66 %", "13 %"]),
    ],
)  # fmt: skip
def test_a_print_is_judged_with_its_reasons(
    second: dict[str, Any], more: dict[str, Any], verdict_is: str, words: list[str]
) -> None:
    found = judged(good(0), second, **more)
    assert found["passed"] == (verdict_is == "passed")
    assert found["undecided"] == (verdict_is == "undecided")
    said = "; ".join(found["reasons"])
    assert all(word in said for word in words), said


HALF_TURN = {"lead": 1.0, "same": True, "mirrored": False, "motion": "a half turn about z",
             "differs_um": 0.2}  # fmt: skip
TURNED = {"flag": True, "doubts": ["the same"], "rivals": [HALF_TURN | {"vessels": [1, 0]}]}


def test_of_a_symmetric_design_a_verdict_that_all_its_poses_share_stands() -> None:
    found = judged(good(0), good(1), ambiguity=TURNED)
    assert found["passed"]
    assert any("vessels 0 and 1 can't be told apart" in one for one in found["reasons"])
    narrow = judged(good(0), vessel(1, NARROW, u_um=8.0), ambiguity=TURNED)
    assert (narrow["passed"], narrow["undecided"]) == (False, False)
    assert narrow["reasons"][0].startswith("Vessel 0 or 1, ")
    # A doubt beyond the symmetry stays one.
    more = TURNED | {"doubts": ["the same", "The scan doesn't fix its turn about z"]}
    assert judged(good(0), ambiguity=more)["undecided"]


def test_vessels_that_would_swap_are_named_where_the_verdict_depends_on_it() -> None:
    rows = [vessel(0, np.zeros(20), 500.0, u_um=8.0), vessel(1, np.zeros(20), 560.0, u_um=8.0)]
    numbers = registration(*rows, ambiguity=TURNED, perfusion=FLOW)
    found = verdict(judge_plain(numbers, 100.0, 10.0))
    assert found["undecided"]
    assert "500 and 560 µm wide" in found["reasons"][0]
    assert found["reasons"][1].startswith("Vessel 1, 0.1 mm along: diameter +12.0")
    assert found["reasons"][1].endswith("if this is vessel 0")


def test_equal_vessels_with_tolerances_of_their_own_are_tried_both_ways() -> None:
    wide = Override(frozenset({1}), frozenset(), {"diameter": symmetric(30.0)})
    tolerances = Tolerances(VesselLimits(), overrides=(wide,))
    for errors, outcome in (
        ((0.0, 0.0), "pass"),
        ((0.0, 80.0), "undecided"),
        ((80.0,) * 2, "fail"),
    ):
        rows = [good(number, error) for number, error in enumerate(errors)]
        judged_rows = judge(registration(*rows, ambiguity=TURNED, perfusion=FLOW), tolerances)
        assert judged_rows["judging"]["decision"] == outcome, errors


def test_a_pass_beyond_its_limit_explains_itself() -> None:
    errors = np.clip(np.random.default_rng(1).normal(0.0, 20.0, 60), -45.0, 45.0)
    errors[30] = -52.0
    row = vessel(0, errors, noise_um=20.0, u_um=40.0, measured_interval_95_um=6.0)
    found = judged(row, good(1), judging=CONFORMANCE)
    assert found["passed"]
    (said,) = (one for one in found["reasons"] if "−10.4 ± 8.0 %" in one)
    assert "this single reading is beyond the limit by less than its own scatter" in said


def not_judged(tolerances: Tolerances) -> list[str]:
    faces = {"outer_faces": {"scaled": {"p95_um": 21.2, "max_um": 508.0}}}
    numbers = registration(good(0), good(1), perfusion=FLOW, by_surface=faces)
    reasons = verdict(judge(numbers, tolerances))["reasons"]
    return [reason for reason in reasons if reason.startswith("Not evaluated")]


def test_a_pass_says_that_place_and_outer_faces_were_not_judged() -> None:
    (said,) = not_judged(Tolerances())
    assert "position of lumens (position_um)" in said
    assert "outer faces (face_profile_um): 95 % within 21 µm" in said
    assert said.endswith("largest deviation 508 µm")


def test_places_that_stand_out_are_told_with_or_without_a_limit() -> None:
    pit = {"at_mm": [1.0, -2.04, 2.6], "deviation_um": 350.4, "area_mm2": 0.8}
    excess = {"at_mm": [0.0, 0.0, 0.0], "deviation_um": -120.0, "area_mm2": 0.3}
    faces = {"outer_faces": {"scaled": {"max_um": None}, "places": [pit, excess, pit, pit]}}
    numbers = registration(good(0), good(1), perfusion=FLOW, by_surface=faces)
    for tolerances in (Tolerances(), Tolerances(face_profile_um=500.0)):
        (said,) = (
            r for r in verdict(judge(numbers, tolerances))["reasons"] if "Outer faces deviate" in r
        )
        assert "gel missing by 350 µm over 0.8 mm² at x 1.0, y −2.0, z 2.6 mm" in said
        assert "gel in excess by 120 µm over 0.3 mm²" in said
        assert said.endswith("; 1 more")


def test_what_has_a_limit_is_not_called_unjudged() -> None:
    placed = VesselLimits(position_um=60.0)
    (said,) = not_judged(Tolerances(placed))
    assert "position_um" not in said
    assert not_judged(Tolerances(placed, face_profile_um=100.0)) == []


def test_unseen_vessel_beside_a_failure_is_a_failure() -> None:
    result = judged(good(0, -100.0), good(1, open=None))
    assert (result["passed"], result["undecided"]) == (False, False)
    assert not any("Every vessel is perfused" in reason for reason in result["reasons"])


@pytest.mark.parametrize(("defect", "vessels"), [(LEAK, [1]), (BRIDGE, [0, 1])])
def test_a_way_out_fails_the_vessels_that_it_joins(defect: Any, vessels: list[int]) -> None:
    rows = judge_plain(
        registration(good(0), good(1), perfusion=FLOW, defects=[defect]), 100.0, 10.0
    )["vessels"]
    assert [row["vessel"] for row in rows if row["decision"] == "fail"] == vessels


def test_of_an_ambiguous_pose_it_isnt_said_that_there_are_no_leaks() -> None:
    reasons = judged(good(0), ambiguity={"flag": True})["reasons"]
    assert not any(reason.startswith("No leak") for reason in reasons)


@pytest.mark.parametrize(("count", "more"), [(1, "1 more fails"), (20, "20 more fail")])
def test_many_reasons_are_counted(count: int, more: str) -> None:
    result = judged(*(good(n, open=False) for n in range(MOST_REASONS + count)))
    assert sum(reason.endswith("closed") for reason in result["reasons"]) == MOST_REASONS
    assert any(reason.startswith(more) for reason in result["reasons"])


KNOWN = {"u_um": 8.0, "measured_interval_95_um": 8.0}


def shifted(sizes: list[float], errors: list[float], scale: float) -> dict[str, Any]:
    """Verdict on straight vessels of those diameters, each off by so much all along."""
    rows = [
        vessel(n, np.full(20, error), designed_um=size, **KNOWN)
        for n, (size, error) in enumerate(zip(sizes, errors, strict=True))
    ]
    return judged(*rows, scale=[scale] * 3, judging=CONFORMANCE)


SIZES = [300.0, 400.0, 500.0, 600.0, 700.0, 800.0] * 5


@pytest.mark.parametrize(
    ("errors", "scale", "said"),
    [
        ([-0.15 * s for s in SIZES], 0.86, ("by 15.0 %", "as the whole part shrank (by 14.0 %)")),
        ([-80.0] * 30, 0.99, ("80 ± 8 µm, whatever their diameter", "isn't shrinkage")),
        ([80.0] * 30, 0.99, ("wider than designed by 80", "lines are narrower")),
    ],
)
def test_one_shift_of_all_lumens_is_one_sentence(
    errors: list[float], scale: float, said: tuple[str, ...]
) -> None:
    result = shifted(SIZES, errors, scale)
    (cause,) = result["causes"]
    assert result["reasons"][0] == cause
    assert all(text in cause for text in said)
    assert sum(" mm along: diameter" in one for one in result["reasons"]) == MOST_REASONS


def of_lumens(sizes: list[float], factor: float, **more: Any) -> dict[str, Any]:
    """Verdict on the lumens of an embedded print, all wider by one factor."""
    rows = [
        vessel(n, np.full(20, (factor - 1) * size), designed_um=size, **KNOWN)
        for n, size in enumerate(sizes)
    ]
    alone = {"lumens": None, "outer_faces": None}
    return judged(*rows, scale=[0.99] * 3, judging=CONFORMANCE, by_surface=alone, **more)


@pytest.mark.parametrize("sizes", [[442.0, 578.0, 574.0], [500.0]])
def test_lumens_wider_by_one_factor_tell_the_flow_of_the_ink(sizes: list[float]) -> None:
    (cause,) = of_lumens(sizes, 0.99 * 2.5**0.5)["causes"]
    flow, interval = map(int, re.findall(r"flow was (\d+) ± (\d+) % of the planned", cause)[0])
    assert abs(flow - 250) <= interval <= 10
    assert "wrong syringe" in cause


def test_lumens_within_tolerance_blame_no_flow() -> None:
    assert of_lumens([442.0, 578.0, 574.0], 1.02)["causes"] == []


@pytest.mark.parametrize(("um", "passed"), [(400.0, False), (60.0, True)])
def test_shifted_layers_are_named_first_and_fail_beyond_the_limit(um: float, passed: bool) -> None:
    shift = {
        "from_mm": 1.2, "to_mm": None, "shift_um": [-um, 1.0], "interval_95_um": [2.0, 2.0],
    }  # fmt: skip
    result = judged(good(0), as_printed={"ends_mm": None, "shift": shift}, judging=CONFORMANCE)
    assert result["passed"] is passed
    assert result["reasons"][0] == result["causes"][0]
    named = f"Layers from z = 1.20 mm up are shifted sideways by x −{um:.0f} ± 2 µm, y +1 ± 2 µm"
    assert result["causes"][0].startswith(named)


def test_a_print_that_ended_early_fails_for_that_first() -> None:
    ended = {"ends_mm": 1.2, "missing_mm": 1.8, "shift": None}
    result = judged(good(0), as_printed=ended)
    assert (result["passed"], result["undecided"]) == (False, False)
    assert result["reasons"][0].startswith(
        "The print ends at z = 1.20 mm, 1.80 mm below the top of the design"
    )


def test_a_scan_of_another_part_has_the_same_keys_in_its_verdict() -> None:
    other = judged(good(0), agreement=OTHER)
    assert other.keys() == judged(good(0)).keys()
    assert other["causes"] == other["reasons"]


def test_the_worst_fails_are_listed_first() -> None:
    errors = [0.0] * 40
    errors[30], errors[12] = -160.0, -90.0
    result = shifted([500.0] * 40, errors, 1.0)
    assert result["causes"] == []
    fails = [one for one in result["reasons"] if "out of tolerance" in one]
    assert [one.split(",")[0] for one in fails] == ["Vessel 30", "Vessel 12"]


# --- verdict on a plate, from the verdicts on its wells
def well(passed: bool, undecided: bool) -> dict[str, Any]:
    verdict = {"passed": passed, "undecided": undecided, "reasons": ["Vessel 0: open"]}
    numbers = {"vessels": [{"error_percent": 1.0}], "scaled": {"rms_um": 9.0}}
    found = well_figures({"verdict": verdict, "registration": numbers})
    return {"well": "A1", "label": "one", **found}


GOOD, OPEN, BAD = well(True, False), well(False, True), well(False, False)


@pytest.mark.parametrize(
    ("wells", "passed", "undecided"),
    [
        ([GOOD, GOOD], True, False),
        ([GOOD, OPEN], False, True),
        ([OPEN, BAD], False, False),
        ([BAD, GOOD], False, False),
    ],
)
def test_one_undecided_well_leaves_the_plate_undecided(
    wells: list[dict[str, Any]], passed: bool, undecided: bool
) -> None:
    found = plate_verdict(wells, 3)
    assert (found["passed"], found["undecided"]) == (passed, undecided)
    assert found["reasons"][0].startswith(f"A1 (one) {wells[0]['outcome']}: Vessel 0")
    assert "1 of 3 wells weren't scanned" in found["reasons"][-1]
