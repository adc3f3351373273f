"""History of prints: index rebuilt from the journals."""

from __future__ import annotations

import csv
import io
import json
import os
import sqlite3
import subprocess
import sys
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from typer.testing import CliRunner

from firmware_profiles import Printer, load
from printctl.cli.main import app
from printctl.machine.link import LinkState, start_print
from printctl.machine.link.errors import HistoryError
from printctl.machine.link.history import PrintHistory, data_folder, remember
from printctl.machine.link.history_entry import INTERRUPTED, entry_of
from printctl.machine.link.history_query import HistoryQuery
from printctl.machine.link.journal import Journal, read_records
from printctl.machine.link.origin import profile_digest
from tests.printctl.machine.link.fake_marlin import FakeMarlin, pty_printer, write_job
from tests.slower import examples

REPO = Path(__file__).parents[4]


@pytest.fixture
def data(tmp_path, monkeypatch) -> Path:
    monkeypatch.setenv("PRINTCTL_DATA", str(tmp_path / "data"))
    return tmp_path / "data"


def printed(folder: Path, name: str = "a.gcode", started: float = 1e9, end: str = "done") -> Path:
    """A folder with a print's journal."""
    folder.mkdir(parents=True, exist_ok=True)
    journal = Journal(folder / "journal.log")
    told = {"name": name, "sha256": f"{name}-hash", "lines": 9, "profile": "duet", "port": "/dev/x"}
    journal.add("job", **told, path=f"/jobs/{name}", started=started, pid=1, who="ada", host="lab")
    journal.add("state", state="printing", message="")
    journal.add("ack", done=4)
    journal.add("alarm", text="the printer says 'cold'")
    journal.add("alarm", text="noise")
    if end:
        journal.add("end", state=end, message="over", done=9, error="", position_known=True)
    journal.close()
    return folder


def test_noting_again_changes_nothing_and_a_later_end_is_taken_in(data, tmp_path):
    folder = printed(tmp_path / "one", end="")
    history = PrintHistory()
    history.note(folder)
    history.note(folder)
    (entry,) = history.entries()
    assert (entry.state, entry.done) == (INTERRUPTED, 4)
    journal = Journal(folder / "journal.log")
    journal.add("end", state="killed", message="by hand", done=5, error="", position_known=False)
    journal.close()
    (entry,) = history.entries()  # nobody noted it: it is read again
    assert (entry.state, entry.message, len(entry.alarms)) == ("killed", "by hand", 2)


def test_print_keeps_its_identity_when_its_journal_is_put_aside(data, tmp_path):
    folder = printed(tmp_path / "one")
    history = PrintHistory()
    history.note(folder)
    (folder / "journal.log").rename(folder / "journal.1.log")
    printed(folder, "b.gcode", 2e9)
    history.note(folder)
    found = {entry.file: entry.journal.name for entry in history.entries()}
    assert found == {"b.gcode": "journal.log", "a.gcode": "journal.1.log"}


@pytest.mark.parametrize("damage", ["garbage", "torn", "other version", "missing table", "deleted"])
def test_damaged_index_is_put_aside_and_made_again(data, tmp_path, damage):
    for k in range(20):
        PrintHistory().note(printed(tmp_path / str(k), f"{k}.gcode", 1e9 + k))
    path = PrintHistory().path
    before = PrintHistory().entries()
    if damage == "garbage":
        path.write_bytes(os.urandom(5000))
    elif damage == "torn":
        path.write_bytes(path.read_bytes()[:1000])
    elif damage == "deleted":
        path.unlink()
    else:
        with sqlite3.connect(path) as index:
            told = "PRAGMA user_version = 99" if damage == "other version" else "DROP TABLE alarms"
            index.execute(told)
        index.close()
    if damage == "deleted":
        assert PrintHistory().rebuild() == 20
    assert PrintHistory().entries() == before
    assert bool(list(data.glob("history.damaged-1.db"))) == (damage != "deleted")


def test_rebuild_searches_folders_and_drops_none_that_is_gone(data, tmp_path):
    history = PrintHistory()
    history.note(printed(tmp_path / "known"))
    printed(tmp_path / "shelf" / "deep" / "two", "b.gcode", 2e9)
    assert history.rebuild() == 1
    assert history.rebuild([tmp_path / "shelf"]) == 2
    (tmp_path / "known" / "journal.log").unlink()
    assert history.rebuild() == 2
    assert {e.file for e in history.entries()} == {"a.gcode", "b.gcode"}


def test_journal_with_damaged_lines_or_without_a_job_is_no_obstacle(data, tmp_path):
    folder = printed(tmp_path / "one")
    with (folder / "journal.log").open("ab") as handle:
        handle.write(b"00000000 {}\nhalf a li")
    PrintHistory().note(folder)
    (tmp_path / "empty").mkdir()
    (tmp_path / "empty" / "journal.log").write_bytes(b"")
    PrintHistory().note(tmp_path / "empty")
    assert [e.state for e in PrintHistory().entries()] == ["done"]
    assert entry_of(tmp_path / "empty" / "journal.log") is None


def test_many_processes_may_write_at_once(data, tmp_path):
    code = (
        "import sys; from pathlib import Path\n"
        "from printctl.machine.link.history import PrintHistory\n"
        "for k in range(10): PrintHistory().note(Path(sys.argv[1]) / f'{sys.argv[2]}-{k}')\n"
    )
    for who in range(2):
        for k in range(10):
            printed(tmp_path / f"{who}-{k}", f"{who}-{k}.gcode", 1e9 + 100 * who + k)
    started = [
        subprocess.Popen([sys.executable, "-c", code, str(tmp_path), str(who)], cwd=REPO)
        for who in range(2)
    ]
    assert [process.wait(300) for process in started] == [0, 0]
    assert len(PrintHistory().entries()) == 20


def test_history_that_can_not_be_written_is_told_but_disturbs_no_print(tmp_path, monkeypatch):
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("PRINTCTL_DATA", str(tmp_path / "file" / "below"))
    with pytest.raises(HistoryError, match=r"journals are untouched.*PRINTCTL_DATA"):
        PrintHistory()
    remember(printed(tmp_path / "one"))


@pytest.mark.skipif(not hasattr(os, "openpty"), reason="no pseudo-terminals here")
@pytest.mark.parametrize("writable", [True, False])
def test_link_process_adds_its_print(data, tmp_path, writable):
    if not writable:
        data.write_text("a file where the folder should be")
    write_job(tmp_path / "job.gcode", 50)
    with pty_printer(FakeMarlin()) as served:
        job, run = tmp_path / "job.gcode", tmp_path / "run"
        client = start_print(job, "generic_marlin", served.name, run)
        assert client.wait(300).state is LinkState.DONE
    if writable:
        for _ in range(100):
            (entry,) = PrintHistory().entries()
            if entry.state == "done":
                break
        assert (entry.file, entry.state, entry.profile) == ("job.gcode", "done", "generic_marlin")
        (job_record, *_) = read_records(run / "journal.log")
        printer = load(Printer, "generic_marlin")
        assert job_record["profile_sha256"] == profile_digest(printer)
        assert job_record["printer"] == printer.model_dump(mode="json")


# --- the command
def test_command_lists_searches_and_writes_csv(data, tmp_path):
    remember(printed(tmp_path / "one", "heart.gcode"))
    remember(printed(tmp_path / "two", "liver.gcode", 2e9, end="killed"))
    run = CliRunner().invoke
    told = run(app, ["history"]).stdout
    assert told.index("liver.gcode") < told.index("heart.gcode")
    assert "! the printer says 'cold'" in told
    found = json.loads(run(app, ["history", "--search", "heart", "--json"]).stdout)
    assert [entry["file"] for entry in found["prints"]] == ["heart.gcode"]
    rows = list(csv.DictReader(io.StringIO(run(app, ["history", "--csv"]).stdout)))
    assert [row["state"] for row in rows] == ["killed", "done"]
    assert rows[0]["alarms"] == "the printer says 'cold'; noise"
    assert rows[0]["sha256"] == "liver.gcode-hash"


# --- asked for a part of it
@given(
    words=st.text(max_size=30),
    who=st.text(max_size=10),
    states=st.lists(st.text(max_size=5), max_size=3),
    offset=st.integers(-5, 2**62),
)
@settings(suppress_health_check=list(HealthCheck), deadline=None, max_examples=examples(60))
def test_no_question_breaks_the_index(data, tmp_path, words, who, states, offset):
    asked = HistoryQuery(words, tuple(states), who=who, offset=offset, limit=10)
    assert PrintHistory().find(asked).total == 0


def test_data_folder_is_the_users(monkeypatch, tmp_path):
    monkeypatch.delenv("PRINTCTL_DATA")
    monkeypatch.setattr(sys, "platform", "linux")
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path))
    assert data_folder() == tmp_path / "printctl"
