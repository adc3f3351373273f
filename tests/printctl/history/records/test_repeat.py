"""Repeat of a print: identical G-code or none; differences reported."""

from __future__ import annotations

import json
from dataclasses import replace

import pytest

from firmware_profiles import Printer, load
from printctl.history.bundle import write_bundle
from printctl.history.repeat import entry_of_bundle, make_job, plan_repeat
from printctl.history.signing import RecordsError, lab_key
from printctl.machine.link.origin import digest_of, origin, profile_digest
from tests.printctl.history.records.prints import GCODE, printed, with_run


def test_unchanged_print_is_made_ready_under_a_new_name_and_nothing_differs(tmp_path):
    entry = printed(tmp_path / "run", name="he<art>.gcode")
    plan = plan_repeat(entry)
    assert plan.differences == ()
    first, second = make_job(plan, tmp_path / "jobs"), make_job(plan, tmp_path / "jobs")
    assert (first.name, second.name) == ("he_art__again_1.gcode", "he_art__again_2.gcode")
    assert first.read_bytes() == GCODE
    told = json.loads((tmp_path / "jobs" / f"{first.name}.repeat.json").read_text())
    assert told["repeats"] == entry.id


def test_profiles_that_differ_today_are_told_key_by_key(tmp_path):
    entry = printed(tmp_path / "run")
    with_run(tmp_path / "run")
    told = {one.what: (one.then, one.now) for one in plan_repeat(entry).differences}
    assert told["ink's profile collagen_fresh, name"][0] == "another"
    assert not any("printer's profile" in what for what in told)


def test_profile_that_is_gone_is_told(tmp_path):
    entry = replace(printed(tmp_path / "run"), profile="sold_last_year")
    (told,) = plan_repeat(entry).differences
    assert (told.what, told.then) == ("printer's profile", "sold_last_year")


def test_port_that_is_gone_is_told(tmp_path):
    entry = replace(printed(tmp_path / "run"), port="/dev/ttyUSB77")
    assert [d.line() for d in plan_repeat(entry).differences] == [
        "port: was /dev/ttyUSB77, is not there"
    ]


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


def test_a_bundle_from_another_machine_tells_its_profiles_and_set_up(tmp_path):
    entry = printed(tmp_path / "run")
    with_run(tmp_path / "run")
    bundle = tmp_path / "away" / "out.zip"
    bundle.parent.mkdir()
    write_bundle(bundle, entry, lab_key())
    here = plan_repeat(entry)
    away = plan_repeat(entry_of_bundle(bundle), bundle)
    assert away.bundle
    assert away.unknown == () == here.unknown
    assert away.differences == here.differences
    assert away.set_up == here.set_up


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


def test_digest_of_a_profile_is_of_its_values():
    printer = load(Printer, "generic_marlin")
    told = json.loads(json.dumps(origin(printer)))
    assert digest_of(dict(reversed(told["printer"].items()))) == profile_digest(printer)
    other = load(Printer, "marlin_avr")
    assert profile_digest(other) != digest_of(told["printer"])
