"""Repeat of a print: identical G-code or none; differences reported."""

from __future__ import annotations

from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from printctl.history.records.bundle import write_bundle
from printctl.history.records.errors import RecordsError
from printctl.history.records.keys import lab_key
from printctl.history.records.repeat import entry_of_bundle, make_job, plan_repeat
from printctl.history.records.table import safe_cell
from tests.printctl.history.records.prints import GCODE, printed, with_run


def test_profiles_that_differ_today_are_told_key_by_key(tmp_path):
    entry = printed(tmp_path / "run")
    with_run(tmp_path / "run")
    told = {one.what: (one.then, one.now) for one in plan_repeat(entry).differences}
    assert told["ink's profile collagen_fresh, name"][0] == "another"
    assert not any("printer's profile" in what for what in told)


def test_changed_gcode_is_refused_and_its_bundle_brings_it_back(tmp_path):
    entry = printed(tmp_path / "run")
    bundle = tmp_path / "out.zip"
    write_bundle(bundle, entry, lab_key())
    (tmp_path / "run" / "part.gcode").write_bytes(b"G28\n")
    with pytest.raises(RecordsError, match=r"changed since the print.*--bundle"):
        plan_repeat(entry)
    made = make_job(plan_repeat(entry, bundle), tmp_path / "jobs")
    assert made.read_bytes() == GCODE
    assert entry_of_bundle(bundle).id == entry.id


def test_damaged_or_foreign_bundle_is_refused(tmp_path):
    entry, bundle = printed(tmp_path / "run"), tmp_path / "out.zip"
    write_bundle(bundle, entry, lab_key())
    (tmp_path / "run" / "part.gcode").unlink()
    with pytest.raises(RecordsError, match="another G-code"):
        plan_repeat(replace(entry, sha256="0" * 64), bundle)
    data = bytearray(bundle.read_bytes())
    data[len(data) // 2] ^= 1
    bundle.write_bytes(data)
    with pytest.raises(RecordsError, match="isn't whole"):
        plan_repeat(entry, bundle)
    with pytest.raises(RecordsError, match="isn't whole"):
        entry_of_bundle(bundle)


def test_file_that_changes_between_check_and_copy_makes_no_job(tmp_path):
    plan = plan_repeat(printed(tmp_path / "run"))
    plan.gcode.write_bytes(b"G28\n")
    with pytest.raises(RecordsError, match="nothing was made"):
        make_job(plan, tmp_path / "jobs")
    assert not list((tmp_path / "jobs").glob("*"))


# --- history as CSV, and a print's timeline
CALCULATED = "=+-@"


@pytest.mark.parametrize(
    "text",
    [
        "=cmd|' /C calc'!A0",
        "+1",
        "-1",
        "@SUM(A1)",
        "\t=1",
        "\r=1",
        "\n=1",
        "  =1",
        "\ufeff=1",
        "＝1",
    ],
)
def test_cell_that_a_spreadsheet_would_calculate_begins_with_an_apostrophe(text):
    assert safe_cell(text) == f"'{text}"


@given(st.text())
def test_no_text_begins_as_a_formula_and_none_is_lost(text):
    cell = safe_cell(text)
    assert not cell.lstrip(" \ufeff\u00a0").startswith(tuple(CALCULATED))
    assert cell.removeprefix("'") == text.replace("\0", "").removeprefix("'")
