"""`printctl history`: list, show, csv, bundle, verify, key, repeat."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from printctl.history.signing import lab_key
from tests.printctl.cli.shell import Shell
from tests.printctl.history.records.prints import GCODE, printed, with_run


@pytest.fixture
def run(monkeypatch, capsys, tmp_path) -> Shell:
    monkeypatch.setenv("PRINTCTL_DATA", str(tmp_path / "data"))
    monkeypatch.chdir(tmp_path)
    return Shell(monkeypatch, capsys, "history")


@pytest.fixture
def entry(run, tmp_path):
    return printed(tmp_path / "run", who="=ada")


def test_list_narrows_and_refuses_what_there_is_not(run, entry, tmp_path):
    printed(tmp_path / "two", "liver.gcode", started=1.5e9, end="killed")
    code, out, _ = run("list", "--state", "killed", "--since", "2017-01-01")
    assert code == 0
    assert "liver.gcode" in out
    assert "part.gcode" not in out
    code, out, _ = run("list", "--until", "2002-01-01", "--json")
    assert [one["file"] for one in json.loads(out)["prints"]] == ["part.gcode"]
    assert run("list", "--state", "fine")[0] == 2
    code, _, err = run("list", "--since", "yesterday")
    assert code == 2
    assert "2026-11-21" in err


def test_csv_is_safe_to_open_by_both_ways(run, entry):
    for command in (("--csv",), ("csv",), ("list", "--csv")):
        code, out, _ = run(*command)
        assert code == 0
        assert "'=ada" in out


def test_show_tells_what_happened_and_what_there_is(run, entry, tmp_path):
    with_run(tmp_path / "run")
    code, out, _ = run("show", entry.id[:12])
    assert code == 0
    assert "verdict  pass" in out
    assert "alarm      the printer says 'cold'" in out
    told = json.loads(run("show", entry.id, "--json")[1])
    assert told["verdict"]["passed"] is True
    assert run("show", "nobody")[0] == 1


def test_bundle_is_made_verified_and_found_out_when_changed(run, entry, tmp_path):
    assert run("bundle", entry.id, "--out", "a.zip")[0] == 0
    code, out, _ = run("verify", "a.zip")
    assert code == 0
    assert "WHOLE" in out
    assert "trusted key" in out
    assert run("key", "--out", "lab.pem")[0] == 0
    assert run("verify", "a.zip", "--key", "lab.pem")[0] == 0
    (tmp_path / "other.pem").write_bytes(lab_key(tmp_path / "other").public.pem())
    code, out, _ = run("verify", "a.zip", "--key", "other.pem")
    assert (code, "ISN'T KNOWN" in out) == (1, True)
    data = bytearray(Path("a.zip").read_bytes())
    data[data.index(b"a comment")] ^= 1
    Path("a.zip").write_bytes(data)
    code, out, _ = run("verify", "a.zip")
    assert code == 1
    assert "job.gcode: changed" in out


def test_verify_of_what_is_no_bundle_or_is_not_there_is_one_message(run, tmp_path):
    (tmp_path / "no.zip").write_bytes(b"no")
    code, out, _ = run("verify", "no.zip", "--json")
    assert (code, json.loads(out)["whole"]) == (1, False)
    code, _, err = run("verify", "absent.zip")
    assert (code, "check the path" in err) == (1, True)


def test_repeat_makes_a_job_or_only_looks(run, entry, tmp_path):
    code, out, _ = run("repeat", entry.id, "--check")
    assert code == 0
    assert "nothing known differs" in out
    assert not (tmp_path / "jobs").exists()
    code, out, _ = run("repeat", entry.id)
    assert (tmp_path / "jobs" / "part_again_1.gcode").read_bytes() == GCODE
    assert "nothing was started" in out


def test_repeat_of_a_bundle_that_another_machine_made(run, entry, tmp_path, monkeypatch):
    assert run("bundle", entry.id, "--out", "a.zip")[0] == 0
    monkeypatch.setenv("PRINTCTL_DATA", str(tmp_path / "elsewhere"))
    (tmp_path / "run" / "part.gcode").unlink()
    code, out, _ = run("repeat", "--bundle", "a.zip", "--json")
    assert code == 0
    assert Path(json.loads(out)["job"]).read_bytes() == GCODE
    assert run("repeat")[0] == 2
