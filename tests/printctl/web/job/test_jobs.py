"""Job service without a printer: uploads, checks, records, steps after the print."""

from __future__ import annotations

import io
import json
from pathlib import Path

import pytest
from fastapi import UploadFile
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image

from firmware_profiles import Syringe, shipped_text
from printctl.checks.kinds import Kind
from printctl.checks.preflight import Budget
from printctl.web.errors import BadRequestError, ConflictError
from printctl.web.job.aftercare import Ramp, Warming, ramped_c, viability
from printctl.web.job.jobs import all_jobs, entry_of
from printctl.web.job.machine import Machine, places_to, set_up_of
from printctl.web.job.readiness import machine_refusals
from printctl.web.job.record import PrintRecord
from printctl.web.job.set_up import JobSetUp, read_declared
from tests.printctl.machine.link.layered import layered
from tests.printctl.web.job.conftest import OPERATOR, START, add


@pytest.mark.parametrize("name", ["", "..", ".gcode", "job.exe", "x/.gcode"])
def test_names_of_which_nothing_is_left_are_refused(service, name):
    with pytest.raises(BadRequestError):
        service.upload(name, io.BytesIO(b"G1 X1\n"))
    assert all_jobs(service.core.workspace) == []


@pytest.mark.parametrize(
    ("name", "kept"),
    [
        ("../up.gcode", "up.gcode"),
        ("x/y.gcode", "y.gcode"),
        ("a b.gcode", "a_b.gcode"),
        ("Großes Gefäß (1).GCO", "Gro_es_Gefa_1_.gcode"),
        ("a..b.gcode", "a.b.gcode"),
        ("x" * 99 + ".g", "x" * 58 + ".gcode"),
    ],
)
def test_an_upload_is_answered_with_the_name_it_is_kept_under(service, name, kept):
    assert service.upload(name, io.BytesIO(b"G1 X1\n")).name == kept
    assert [one.name for one in all_jobs(service.core.workspace)] == [kept]


def test_a_name_that_cant_be_used_hides_no_other_job(service):
    job, root = add(service), service.core.workspace.root
    odd = ["Gefäß.gcode", "a" * 65 + ".gcode", "my part.gcode"]
    for name in ("._part.gcode", *odd):
        (root / "jobs" / name).write_bytes(b"G1 X1\n")
    (root / "jobs" / "folder.gcode").mkdir()
    (root / "jobs" / "gone.gcode").symlink_to(root / "jobs" / "nowhere")
    (root / "runs" / "my run").mkdir()
    (root / "runs" / "my run" / "part.gcode").write_bytes(b"G1 X1\n")
    assert [one.id for one in all_jobs(service.core.workspace)] == [job]
    unusable = service.core.workspace.unusable_names("jobs/*.gcode", "runs/*")
    assert unusable == sorted([*(f"jobs/{name}" for name in odd), "runs/my run"])


def test_what_is_no_text_or_too_large_is_refused_and_leaves_nothing(service):
    with pytest.raises(BadRequestError):
        service.upload("a.gcode", io.BytesIO(b"G1 X1\n" * 200 + b"\0\1\2"))
    with pytest.raises(BadRequestError):
        service.upload("a.gcode", io.BytesIO(b""))
    assert not list((service.core.workspace.root / "jobs").iterdir())


def test_a_job_is_checked_as_on_the_command_line_and_remembered(service):
    job = add(service, layers=3, moves=20)
    said = JobSetUp(start_mm=START, needle="28g", bath="gelatin_support")
    found = service.preflight(job, said)
    assert not found.passed  # no printer is connected
    assert [one.check for one in found.checks if one.result == "failed"] == ["printer"]
    assert entry_of(service.core.workspace, job).layers == 3
    assert service.preflight(job, said).key == found.key
    json.dumps(found.model_dump(mode="json"), allow_nan=False)


def test_a_job_out_of_bounds_or_not_g_code_is_refused_with_its_reason(service):
    job = service.upload("wide.gcode", io.BytesIO(layered(1, 5) + b"G1 X500 F600\n")).id
    checks = service.preflight(job, JobSetUp(start_mm=START)).checks
    failed = [one for one in checks if one.result == "failed"]
    assert (failed[1].value, failed[1].limit, failed[1].unit) == (500.0, 200.0, "mm")
    bad = service.upload("relative.gcode", io.BytesIO(b"G91\nM83\nG1 X1 E1\n")).id
    checks = service.preflight(bad, JobSetUp()).checks
    failed = next(one for one in checks if one.kind == Kind.FORBIDDEN_COMMAND)
    assert (failed.result, failed.place) == ("failed", "line 1")
    assert "relative" in failed.remedy


@pytest.mark.slow
def test_a_needle_that_goes_up_and_down_without_a_map_is_a_row_of_the_list(service):
    rising = b"M302 P1\nG90\nM82\nG92 X50 Y50 Z10 E0\nG1 X60 Z12 E0.5 F300\nG1 X50 Z10 E1 F300\n"
    job = service.upload("rising.gcode", io.BytesIO(rising)).id
    found = service.preflight(job, JobSetUp(start_mm=START, needle="28g"))
    assert any("shaft" in one.check and one.result != "passed" for one in found.checks)


def test_profiles_outside_the_workspace_are_not_read(service):
    job = add(service)
    with pytest.raises(BadRequestError, match="outside the workspace"):
        service.preflight(job, JobSetUp(printer="/etc/passwd.yaml"))


def test_profiles_of_the_workspace_go_by_their_names(service):
    own = service.store.folder(Syringe) / "tiny.yaml"
    own.parent.mkdir(parents=True)
    own.write_text(shipped_text(Syringe, "hamilton_1ml"))
    job, said = add(service), JobSetUp(start_mm=START, syringe="tiny")
    assert service.preflight(job, said).sha256
    assert service.keep_set_up(job, said).syringe == str(own)
    ready = service.readiness(OPERATOR, job, said)
    assert "job and set-up" not in {one.what for one in ready.refusals}
    ready = service.readiness(OPERATOR, job, JobSetUp(syringe="none"))
    assert any("no syringe profile 'none'" in one.remedy for one in ready.refusals)


def test_the_record_keeps_every_change_with_who(service):
    job = add(service)
    service.write_down(OPERATOR, job, {"cells": "HUVEC", "passage": 4})
    service.write_down(OPERATOR, job, {"passage": 5})
    with pytest.raises(BadRequestError):
        service.write_down(OPERATOR, job, {"passage": -1})
    with pytest.raises(BadRequestError):
        service.write_down(OPERATOR, job, {"nonsense": 1})
    kept = service.records.load(service.records.current(job))
    assert [one["said"] for one in kept["changes"]] == [
        {"cells": "HUVEC", "passage": 4},
        {"passage": 5},
    ]
    assert {one["who"] for one in kept["changes"]} == {"Ada"}


def uploaded(data: bytes) -> UploadFile:
    return UploadFile(io.BytesIO(data))


def test_only_pictures_become_photos_and_are_written_anew(service):
    job = add(service)
    with pytest.raises(BadRequestError):
        service.after.add_photo(OPERATOR, job, uploaded(b"<script>alert(1)</script>"))
    out = io.BytesIO()
    Image.new("RGB", (64, 32), "red").save(out, "PNG")
    photos = service.after.add_photo(OPERATOR, job, uploaded(out.getvalue() + b"<script>"))
    kept = Path(service.after.photo(job, photos[0].name).path).read_bytes()
    assert kept[:2] == b"\xff\xd8"
    assert b"<script>" not in kept
    with pytest.raises(BadRequestError):
        service.after.photo(job, "../record.json")


def test_the_clock_of_the_cells_says_whether_the_print_will_be_in_time():
    budget = Budget(60.0, "our live/dead counts", "", True)
    mixed = PrintRecord(mixed_at=1000.0)
    assert viability(PrintRecord(), budget, 0.0, None).state == "unknown"
    assert viability(mixed, None, 1600.0, None).words.startswith("10 min since mixing")
    assert viability(mixed, budget, 1600.0, 60.0).state == "in time"
    assert viability(mixed, budget, 1600.0, 48 * 60.0).state == "close"
    late = viability(mixed, budget, 1600.0, 61 * 60.0)
    assert late.state == "late"
    assert "expected to end after 71 min" in late.words
    assert (
        viability(mixed.model_copy(update={"viability_min": 5.0}), budget, 1600.0, None).state
        == "late"
    )


# --- tip travel to a job's start, and its description in the set-up
PLACE = st.tuples(*[st.floats(0, 200)] * 3)


@given(PLACE, PLACE, st.none() | st.floats(0, 200))
def test_the_tip_goes_aside_only_above_all_that_is_known(tip, start, over):
    places = places_to(tip, start, over)
    assert places[-1] == start
    for before, after in zip([tip, *places], places, strict=False):
        if before[:2] != after[:2]:
            assert before[2] == after[2] >= max(tip[2], start[2], over or 0.0)


def test_a_job_that_declares_its_start_keeps_it_wherever_the_tip_stands():
    machine = Machine("generic_marlin", "simulated", tip_mm=(30.0, 30.0, 30.0))
    assert set_up_of(machine, JobSetUp(), (100.0, 100.0, 9.0)).start_mm == (100.0, 100.0, 9.0)
    assert set_up_of(machine, JobSetUp()).start_mm == (30.0, 30.0, 30.0)


def test_what_is_mounted_fills_a_set_up_in_and_replaces_none_that_was_kept():
    mounted = {"needle": "28g", "syringe": "bd_1ml", "ink": "", "bath": "", "dish": ""}
    machine = Machine("marlin_avr", "/dev/ttyUSB0", mounted=mounted)
    filled = set_up_of(machine, JobSetUp(needle="25g"))
    assert (filled.printer, filled.needle, filled.syringe) == ("marlin_avr", "28g", "bd_1ml")
    kept = set_up_of(machine, JobSetUp(needle="25g", syringe=""), kept=True)
    assert (kept.printer, kept.needle, kept.syringe) == ("generic_marlin", "25g", "bd_1ml")
    said = [one.sentence() for one in machine_refusals(machine, kept)]
    assert any("28g is mounted, and 25g was checked" in one for one in said)


# --- declared start position of a large job, found quickly
MOVES = b"".join(b"G1 X%d Y2 F600\n" % (k % 9) for k in range(5000))
PLACED = b"G21\nG92 X1 Y2 Z3 E0\n"


@pytest.mark.parametrize(
    ("data", "found"),
    [
        (PLACED + MOVES + b"G92 E0\n" + MOVES, (1.0, 2.0, 3.0)),
        (PLACED + MOVES + b"; G92 X9 Y9 Z9\n" + MOVES, (1.0, 2.0, 3.0)),
        (PLACED + MOVES + b"  G92 X9 Y9 Z9", (1.0, 2.0, 3.0)),
        (MOVES, None),
        (b"M105\n" * 3000 + PLACED + MOVES, (1.0, 2.0, 3.0)),
        (b"M105\n" * 3000 + MOVES + PLACED, None),
        (b"SET_KINEMATIC_POSITION X=1 Y=2 Z=3\n" + MOVES, (1.0, 2.0, 3.0)),
        (b"", None),
    ],
)
def test_the_start_is_that_of_the_whole_job(
    data: bytes, found: tuple[float, float, float] | None, tmp_path: Path
) -> None:
    path = tmp_path / "job.gcode"
    path.write_bytes(data)
    name = "klipper_bioprinter" if b"KINEMATIC" in data else "generic_marlin"
    assert read_declared(path, name) == found


def test_the_same_file_again_does_no_harm_another_one_is_refused(service):
    first = service.upload("a.gco", io.BytesIO(b"G1 X1\n"))
    assert service.upload("a.gcode", io.BytesIO(b"G1 X1\n")).sha256 == first.sha256
    with pytest.raises(ConflictError, match=r"another file a\.gcode"):
        service.upload("a.gcode", io.BytesIO(b"G1 X2\n"))


def test_warming_follows_its_rate_and_never_passes_the_target():
    warming = Warming(target_c=37.0)
    assert ramped_c(20.0, warming, 0.0) == 20.0
    assert ramped_c(20.0, warming, 90.0) == pytest.approx(21.5)
    assert ramped_c(20.0, warming, 1e6) == 37.0
    assert ramped_c(40.0, warming, 60.0) == 39.0


def test_warming_wants_a_heater_that_is_there(service):
    with pytest.raises(ConflictError, match="no heater 'bed'"):
        Ramp(service.printing, Warming(target_c=37.0))
