"""Job service without a printer: uploads, checks, records, steps after the print."""

from __future__ import annotations

import io
import json
import math
from pathlib import Path

import numpy as np
import pytest
from fastapi import UploadFile
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image

from firmware_profiles import Ink, Printer, Syringe, load
from printctl.checks.gcode_view import Pushing, read_job
from printctl.checks.preflight import Budget, HeadLoading, volumes
from printctl.machine.link.errors import LinkError
from printctl.machine.link.job_start import declared_start
from printctl.machine.printing.job_table import JobTable
from printctl.machine.printing.journal_facts import read_so_far
from printctl.machine.printing.progress import Filling, progress
from printctl.machine.printing.remaining import Estimate, Remaining
from printctl.web.errors import BadRequestError, ConflictError
from printctl.web.job.aftercare import Ramp, Warming, flush_limit, ramped_c, viability
from printctl.web.job.check import make_table
from printctl.web.job.jobs import all_jobs, entry_of
from printctl.web.job.machine import Machine, places_to, set_up_of
from printctl.web.job.record import PrintRecord
from printctl.web.job.set_up import JobSetUp, read_first_lines
from sim.gcode.dry_run.run import dry_run
from tests.printctl.machine.link.jobs import load_job, parse_job
from tests.printctl.machine.link.layered import layered
from tests.printctl.web.job.conftest import OPERATOR, START, add


@pytest.mark.parametrize("name", ["../up.gcode", "a b.gcode", ".gcode", "x/y.gcode", "job.exe"])
def test_names_that_leave_the_folder_are_refused(service, name):
    with pytest.raises(BadRequestError):
        service.upload(name, io.BytesIO(b"G1 X1\n"))
    assert all_jobs(service.core.workspace) == []


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
    for _ in range(2):  # the second time nobody looks again
        with pytest.raises(BadRequestError, match="line 1: G91: relative moves"):
            service.preflight(bad, JobSetUp())


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


def test_the_flush_limit_scales_poiseuille_flow_to_the_wall_shear_allowed(tmp_path):
    # One tube: wall shear 4 µ Q / (π r³), pressure drop 8 µ L Q / (π r⁴); their ratio is 2 L / r.
    r, length, mu, q = 0.25e-3, 10e-3, 1e-3, 1e-9
    shear = 4 * mu * q / (math.pi * r**3)
    drop = 8 * mu * length * q / (math.pi * r**4)
    table = tmp_path / "flow.csv"
    table.write_text(f"vessel,pressure_in_pa,pressure_out_pa,wall_shear_pa\n3,{drop},0,{shear}\n")
    found = flush_limit(table, 2.0)
    assert found is not None
    assert found.vessel == "3"
    assert found.pressure_pa == pytest.approx(2.0 * 2 * length / r)
    assert flush_limit(tmp_path / "none.csv", 2.0) is None


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


# --- declared start position of a large job, found quickly
MOVES = b"".join(b"G1 X%d Y2 F600\n" % (k % 9) for k in range(5000))
PLACED = b"G21\nG92 X1 Y2 Z3 E0\n"


@pytest.mark.parametrize(
    ("data", "found"),
    [
        (PLACED + MOVES, (1.0, 2.0, 3.0)),
        (PLACED + MOVES + b"G92 E0\n" + MOVES, (1.0, 2.0, 3.0)),
        (PLACED + MOVES + b"; G92 X9 Y9 Z9\n" + MOVES, (1.0, 2.0, 3.0)),
        (PLACED + MOVES + b"  G92 X9 Y9 Z9", (1.0, 2.0, 3.0)),
        (MOVES + PLACED + MOVES, None),
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
    assert read_first_lines(path, name)[0] == found
    try:
        job = load_job(path, load(Printer, name))
        assert declared_start(job) == found
    except LinkError:
        assert found is None


# --- job table, progress and remaining time, against slow oracles
PRINTER, SYRINGE = load(Printer, "generic_marlin"), load(Syringe, "hamilton_1ml")
INK = load(Ink, "collagen_fresh")
START_ESTIMATING = (50.0, 50.0, 10.0)


def table_of(data: bytes) -> JobTable:
    run = dry_run(data, PRINTER, START_ESTIMATING)
    view = read_job(
        data, "job.gcode", Pushing(PRINTER, None, "", SYRINGE.inner_mm, SYRINGE.name), None
    )
    volume = volumes(run, PRINTER, [HeadLoading(SYRINGE, INK, None)])
    return make_table(parse_job(data, "job.gcode"), run, volume, view)


def naive(data: bytes) -> tuple[list[float], list[int]]:
    """µL and file line after each command, read line by line."""
    area = math.pi / 4 * SYRINGE.inner_mm**2 * INK.flow_factor
    ink, line = [0.0], [0]
    done = 0.0
    for number, text in enumerate(data.decode().splitlines(), start=1):
        if text.startswith(";"):
            continue
        words = {word[0]: float(word[1:]) for word in text.split()[1:] if word[1:]}
        if text.startswith("G1") and "E" in words:
            done = max(done, words["E"] * area)  # what was taken back comes out again
        ink.append(done)
        line.append(number)
    return ink, line


def test_the_table_tells_ink_line_and_layer_of_every_command():
    data = layered(4, 12)
    table = table_of(data)
    ink, line = naive(data)
    assert len(table) == len(line) - 1
    np.testing.assert_allclose(table.ink_ul, ink, atol=1e-9)
    assert table.file_line.tolist() == line
    assert table.layer_count == 4
    assert table.layers_done[-1] == 4
    assert (np.diff(table.time_s) >= 0).all()
    assert table.time_s[-1] == dry_run(data, PRINTER, START_ESTIMATING).duration_s
    lines = data.decode().splitlines()
    written = [k for k, text in enumerate(lines, 1) if text.startswith("G1 X") and "E" in text]
    for layer in range(4):
        moves = written[layer * 12 : (layer + 1) * 12]
        rows = np.flatnonzero(np.isin(table.file_line, moves))
        assert set(table.layer[rows].tolist()) == {layer}
        assert table.layers_done[rows[-1]] == layer + 1
        assert table.layers_done[rows[-2]] == layer


def test_ink_left_counts_from_the_syringe_that_was_put_in():
    table = table_of(layered(4, 12))
    area = math.pi / 4 * SYRINGE.inner_mm**2
    half = len(table) // 2
    filling = Filling(half, 5.0, area)
    told = progress(table, len(table), 0.0, 0.0, Estimate(0.0, None, 1.0), filling)
    used = (table.plunger_mm[-1] - table.plunger_mm[half]) * area
    assert told.ink_left_ul == pytest.approx(5.0 * area - used)
    assert progress(table, 3, 0.0, 0.0, Estimate(1.0, None, 1.0)).ink_left_ul is None


def test_the_error_told_covers_19_of_20_prints():
    rng, inside = np.random.default_rng(5), 0
    for _ in range(300):
        real = np.concatenate([[0.0], np.cumsum(10.0 * rng.normal(1.1, 0.2, 100))])
        remaining = Remaining(1000.0)
        for k in range(31):
            remaining.saw(10.0 * k, float(real[k]))
        told = remaining.estimate(300.0)
        assert told.error_s is not None
        inside += abs(real[100] - real[30] - told.remaining_s) <= told.error_s
    assert 0.90 <= inside / 300 <= 0.99


def test_pauses_are_left_out_of_the_time_at_work():
    state = {"t": "state"}
    records = [
        {"t": "job", "sha256": "a", "started": 100.0, "at": 100.0},
        {**state, "state": "printing", "at": 110.0},
        {**state, "state": "pausing", "at": 150.0},
        {**state, "state": "paused", "at": 155.0},
        {"t": "syringe", "done": 42, "plunger_mm": 1.5, "at": 300.0},
        {**state, "state": "resuming", "at": 400.0},
        {**state, "state": "printing", "at": 410.0},
    ]
    found = read_so_far(records)
    assert found.started == 100.0
    assert found.active_until(425.0) == pytest.approx(55.0)
    assert found.filled == (42, 1.5, 0.0)
    ended = read_so_far([*records, {"t": "end", "state": "done", "at": 420.0}])
    assert ended.active_until(999.0) == pytest.approx(50.0)
    assert read_so_far([*records, {**records[0], "at": 500.0}]).active_s == pytest.approx(40.0)


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
