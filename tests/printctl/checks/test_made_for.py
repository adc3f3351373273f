"""Record of a job's set-up: written into the job, compared with what is mounted."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
import trimesh
from typer.testing import CliRunner

from firmware_profiles import Bath, Dish, Ink, Needle, Printer, Syringe, load
from gcode.dry_run.run import dry_run
from printctl.checks.made_for import (
    header_lines,
    is_recorded,
    made_for,
    profile_hash,
    read_made_for,
)
from printctl.checks.preflight import file_checks
from printctl.checks.set_up import HeadLoading, SetUp
from printctl.cli.main import app

PRINTER = load(Printer, "generic_marlin")
INK = load(Ink, "collagen_fresh")
NEEDLE = load(Needle, "fresh_150um")
SYRINGE = load(Syringe, "hamilton_1ml")


@pytest.fixture(scope="module")
def job(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    folder = tmp_path_factory.mktemp("job")
    trimesh.creation.box((2, 2, 0.3)).export(folder / "plate.stl")
    out = folder / "plate.gcode"
    words = ["slice", str(folder / "plate.stl"), "--unit", "mm", "--out", str(out)]
    assert CliRunner().invoke(app, words).exit_code == 0
    return out.read_bytes()


def failed(gcode: bytes, setup: SetUp) -> list[str]:
    run = dry_run(gcode, setup.printer, (100.0, 100.0, 10.0))
    return [check.sentence() for check in file_checks(run, setup) if check.refuses]


def of_set_up(sentences: list[str]) -> list[str]:
    return [text for text in sentences if "that the job was made for: " in text]


def test_a_job_says_what_it_was_made_for(job: bytes) -> None:
    recorded = read_made_for(job)
    assert recorded == made_for(PRINTER, [HeadLoading(SYRINGE, INK, NEEDLE)])
    assert [one.name for one in recorded["syringe"]] == ["Hamilton 1 mL gastight"]


@pytest.mark.parametrize("end", [b"\r\n", b"\r"])
def test_any_line_end_keeps_the_record(job: bytes, end: bytes) -> None:
    other = SetUp(PRINTER, load(Syringe, "bd_1ml"), INK, NEEDLE)
    assert len(of_set_up(failed(job.replace(b"\n", end), other))) == 1


def test_the_same_set_up_is_accepted(job: bytes) -> None:
    assert failed(job, SetUp(PRINTER, SYRINGE, INK, NEEDLE)) == []


@pytest.mark.parametrize("name", ["bd_1ml", "bd_5ml", "hamilton_2_5ml"])
def test_another_syringe_is_refused_with_both_names(job: bytes, name: str) -> None:
    other = load(Syringe, name)
    sentences = of_set_up(failed(job, SetUp(PRINTER, other, INK, NEEDLE)))
    assert len(sentences) == 1
    assert "'Hamilton 1 mL gastight'" in sentences[0]
    assert repr(other.name) in sentences[0]


def test_another_needle_or_ink_or_printer_is_refused(job: bytes) -> None:
    others = [
        SetUp(PRINTER, SYRINGE, INK, load(Needle, "25g")),
        SetUp(PRINTER, SYRINGE, load(Ink, "alginate_fresh"), NEEDLE),
        SetUp(load(Printer, "lulzbot_taz6_replistruder4"), SYRINGE, INK, NEEDLE),
    ]
    assert [len(of_set_up(failed(job, one))) for one in others] == [1, 1, 1]


def test_a_profile_that_was_changed_since_is_refused(job: bytes) -> None:
    changed = INK.model_copy(update={"flow_factor": INK.flow_factor * 0.9})
    [sentence] = of_set_up(failed(job, SetUp(PRINTER, SYRINGE, changed, NEEDLE)))
    assert "was changed after the job was made" in sentence


def test_provenance_changes_no_hash() -> None:
    assert profile_hash(INK.model_copy(update={"source": "a notebook"})) == profile_hash(INK)
    assert profile_hash(INK) != profile_hash(INK.model_copy(update={"flow_factor": 1.25}))


def test_a_file_without_a_record_is_compared_with_nothing(job: bytes) -> None:
    bare = b"\n".join(line for line in job.split(b"\n") if not line.startswith(b"; printctl "))
    assert of_set_up(failed(bare, SetUp(PRINTER, load(Syringe, "bd_1ml"), INK, NEEDLE))) == []


def test_a_dish_is_recorded_where_it_is_known() -> None:
    dish = load(Dish, "petri_60mm")
    lines = header_lines(made_for(PRINTER, [HeadLoading(SYRINGE, INK, None)], dish=dish))
    assert [line.split(":")[0] for line in lines] == [
        "printctl printer", "printctl syringe", "printctl ink", "printctl dish",
    ]  # fmt: skip


def test_lines_for_a_narrower_syringe_are_refused_without_a_record(job: bytes) -> None:
    bare = b"\n".join(line for line in job.split(b"\n") if not line.startswith(b"; printctl "))
    sentences = failed(bare, SetUp(PRINTER, load(Syringe, "bd_5ml"), INK, NEEDLE))
    assert any("widest bead" in text for text in sentences)


HEAD = b"G21\nG90\nM82\nM302 P1\nG92 X100 Y100 Z10 E0\nG0 Z1\n"


@pytest.mark.parametrize(
    ("body", "words"),
    [
        (b"G1 X110 E1 F600\nG0 X100\nG1 X110 Y101 E1\nG0 Z10\n", "E word that extrude nothing"),
        (b"G1 X110 E0.1 F600\nG1 Y110 E0.2\nG1 X100 E0.", "truncated"),
        (b"G1 X110 E0 F600\nG1 Y110 E0\nG0 Z10\n", "never increases"),
        (b"G1 X110 E-0.1 F600\nG1 Y110 E-0.2\nG0 Z10\n", "never increases"),
        (b"T1\nG1 X110 E0.1 F600\nG0 Z10\n", "non-existent heads selected"),
        (b"G1 E1 F60\nG1 X110 F600\nG1 Y110\nG1 E0 F60\nG0 Z10\n", "whose E1 opens a valve"),
    ],
)
def test_a_file_that_isn_t_whole_is_refused(body: bytes, words: str) -> None:
    sentences = failed(HEAD + body, SetUp(PRINTER, SYRINGE, INK, load(Needle, "22g")))
    assert any(words in text for text in sentences)


def test_doses_at_a_standstill_are_no_fault() -> None:
    body = b"G1 E0.3 F30\nG0 X105\nG1 E0.6 F30\nG0 Z10\n"
    run = dry_run(HEAD + body, PRINTER, (100.0, 100.0, 10.0))
    assert {one.code for one in run.findings} <= {"speed_z"}


@pytest.mark.parametrize(("pushed_mm", "bath", "said"), [
    (10.0, "gelatin_support", True), (10.0, None, False), (1.0, "gelatin_support", False),
])  # fmt: skip
def test_a_large_drop_among_the_lines_is_refused(
    pushed_mm: float, bath: str | None, said: bool
) -> None:
    """Ten millimetres of 1 mL's plunger push 167 µL: a ball of 6.8 mm, 16.6 bores."""
    body = f"G1 X105 E0.04 F600\nG1 E{pushed_mm + 0.04} F30\nG1 X110 E{pushed_mm + 0.08} F600\n"
    setup = SetUp(
        PRINTER, SYRINGE, INK, load(Needle, "22g"), None if bath is None else load(Bath, bath)
    )
    found = [text for text in failed(HEAD + body.encode(), setup) if "largest drop" in text]
    assert len(found) == said
    assert all("6.83" in text and "167 µL" in text for text in found)


def test_a_named_bath_is_recorded(tmp_path: Path) -> None:
    trimesh.creation.box((2, 2, 0.3)).export(tmp_path / "plate.stl")
    out = tmp_path / "plate.gcode"
    words = ["slice", str(tmp_path / "plate.stl"), "--unit", "mm", "--out", str(out)]
    assert CliRunner().invoke(app, [*words, "--bath", "gelatin_calcium"]).exit_code == 0
    [bath] = read_made_for(out.read_bytes())["bath"]
    other = SetUp(PRINTER, SYRINGE, INK, NEEDLE, load(Bath, "gelatin_support"))
    [sentence] = of_set_up(failed(out.read_bytes(), other))
    assert bath.name in sentence
    assert other.bath is not None
    assert repr(other.bath.name) in sentence


@pytest.mark.parametrize("kept", [b"printer", b"syringe"])
def test_a_cut_record_is_none(job: bytes, kept: bytes) -> None:
    lines = job.split(b"\n")
    cut = [line for line in lines if not line.startswith(b"; printctl ") or kept in line[:20]]
    assert is_recorded(read_made_for(job), PRINTER)
    assert not is_recorded(read_made_for(b"\n".join(cut)), PRINTER)


def test_a_tip_left_in_the_print_is_refused_and_the_remedy_works() -> None:
    body = HEAD + b"G1 X110 E0.05 F600\n"
    run = dry_run(body, PRINTER, (100.0, 100.0, 10.0))
    [check] = [one for one in file_checks(run, SetUp(PRINTER, SYRINGE, INK, NEEDLE))
               if "tip in the print" in one.check]  # fmt: skip
    assert check.refuses
    lift = re.search(r"add a lift at the end \(such as (.+?)\)", check.remedy)
    assert lift is not None
    lifted = dry_run(body + lift[1].encode() + b"\n", PRINTER, (100.0, 100.0, 10.0))
    left = [(one.line, one.code) for one in run.findings if one.code != "left_down"]
    assert [(one.line, one.code) for one in lifted.findings] == left


def test_rounded_e_words_are_no_fault() -> None:
    body = b"G1 X110 E0.05 F600\nG1 X110.01 E0.05\nG1 X120 E0.1\nG0 Z10\n"
    run = dry_run(HEAD + body, PRINTER, (100.0, 100.0, 10.0))
    assert {one.code for one in run.findings} == {"speed_z"}


def path_of(name: str) -> Path:
    return Path(__file__).parents[3].parent / "shared" / "cases" / name


@pytest.mark.parametrize("name", ["dry_doses/open_close.gcode", "cut_off/trunc2.gcode"])
def test_cases_from_the_field_are_refused(name: str) -> None:
    if not path_of(name).is_file():
        pytest.skip("the folder shared/ isn't here")
    assert failed(path_of(name).read_bytes(), SetUp(PRINTER, SYRINGE, INK, load(Needle, "22g")))
