"""Print journal: correct content, tolerant of a torn last record."""

from __future__ import annotations

import ast
import csv
import errno
import io
import json
import os
import sqlite3
import subprocess
import sys
import tempfile
from pathlib import Path
from types import SimpleNamespace

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from typer.testing import CliRunner

from firmware_profiles import Printer, load
from printctl.cli.main import app
from printctl.history.index import PrintHistory, remember
from printctl.history.query import HistoryQuery
from printctl.machine.control.printing.streamer import Streamer
from printctl.machine.errors import HistoryError, JournalError, LinkError, Refused
from printctl.machine.ports.clock import VirtualClock
from printctl.machine.ports.wire_log import RING_BYTES, LoggedTransport, WireLog
from printctl.machine.prints.progress import remaining_time
from printctl.machine.prints.recovery import beginning
from printctl.machine.process import one_print
from printctl.machine.process.clients.starting import start_print
from printctl.machine.process.orders import Order
from printctl.machine.process.outcome import resumable
from printctl.machine.records import folders
from printctl.machine.records.folders import (
    archive_journal,
    data_folder,
    journal_of,
    notes_path,
    read_notes,
    remember_folder,
)
from printctl.machine.records.journal import (
    RESERVE,
    Journal,
    decode,
    encode,
    profile_digest,
    read_records,
)
from printctl.machine.records.replay import JournalledPrint, JournalReader, read_journal, replay
from printctl.machine.records.states import LinkState, Status
from printctl.pipeline.past.past_print import INTERRUPTED, entry_of
from sim.devices.families.marlin_printer import MarlinPrinter
from tests.printctl.machine.link.fake_marlin import FakeMarlin, pty_printer, write_job
from tests.printctl.machine.link.scripted_transport import ScriptedTransport
from tests.printctl.machine.link.sim_transport import SimTransport
from tests.printctl.machine.link.simulated import PRINTER, START, gcode, printed
from tests.slower import examples


def written(path):
    journal = Journal(path)
    journal.add("job", name="a.gcode", sha256="0" * 64, lines=100)
    journal.add("state", state=LinkState.PRINTING, message="")
    for done in range(10, 60, 10):
        journal.add("ack", done=done)
    journal.add("control", n=51, command="M105")
    journal.add("alarm", text="µ and ✓ are escaped")
    journal.close()
    return path


def test_reads_what_was_written(tmp_path):
    history = read_journal(written(tmp_path / "j"))
    assert history.total == 100
    assert history.done == 50
    assert history.state is LinkState.PRINTING
    assert history.alarms == ["µ and ✓ are escaped"]
    assert history.end is None
    assert history.damaged == 0


@given(st.lists(st.integers(1, 60), max_size=20))
def test_reading_on_gives_what_reading_anew_gives(pieces):
    with tempfile.TemporaryDirectory() as folder:
        path, grown = Path(folder) / "j", Path(folder) / "grown"
        data = written(path).read_bytes()
        reader, at = JournalReader(grown), 0
        assert reader.read() == JournalledPrint()
        for size in pieces:
            with grown.open("ab") as handle:
                handle.write(data[at : at + size])
            at += size
            whole = data[:at].splitlines(keepends=True)
            known = [decode(line) for line in whole if line.endswith(b"\n")]
            assert reader.read() == replay(known)


def test_reader_begins_anew_with_the_journal_of_another_print(tmp_path):
    reader = JournalReader(written(tmp_path / "journal.log"))
    assert reader.read().done == 50
    archive_journal(tmp_path)
    before = reader.read()
    journal = Journal(tmp_path / "journal.log")
    for done in range(200):
        journal.add("ack", done=done)
    journal.close()
    assert reader.read().done == 199
    assert (before.done, before.total, reader.read().total) == (50, 100, 0)


def test_paces_of_a_long_print_are_few_and_span_it():
    records = [{"t": "state", "state": "printing", "at": 0.0}]
    records += [{"t": "ack", "done": k, "at": float(k)} for k in range(1, 10_000)]
    paces = replay(records).paces
    assert len(paces) <= 1000
    assert paces[0] == (1, 1.0, 1)
    assert paces[-1][0] > 9_900
    assert all(done == active_s for done, active_s, _ in paces)


def test_what_is_made_while_no_host_lives_is_no_pace():
    records = [{"t": "job", "id": "a"}, {"t": "state", "state": "printing", "at": 0.0}]
    records += [{"t": "ack", "done": k, "at": float(k)} for k in range(1, 11)]
    records += [{"t": "job", "id": "a"}, {"t": "state", "state": "printing", "at": 60.0}]
    records += [{"t": "ack", "done": 50 + k, "at": 60.0 + k} for k in range(11)]
    times = [(float(done), active_s, stretch) for done, active_s, stretch in replay(records).paces]
    assert remaining_time(100.0, times, 60.0).ratio == pytest.approx(1.0)


@pytest.mark.parametrize("missing", range(1, 40))
def test_torn_tail_is_dropped_and_never_claims_more(tmp_path, missing):
    path = written(tmp_path / "j")
    path.write_bytes(path.read_bytes()[:-missing])
    history = read_journal(path)
    assert history.damaged == 1
    assert history.done == 50
    assert history.alarms == []


def test_going_on_after_a_torn_tail_loses_only_the_torn_record(tmp_path):
    path = written(tmp_path / "j")
    path.write_bytes(path.read_bytes()[:-5])
    journal = Journal(path)
    journal.add("ack", done=70)
    journal.close()
    history = read_journal(path)
    assert history.done == 70
    assert history.damaged == 1


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], deadline=None)
@given(place=st.integers(0, 10_000), bit=st.integers(0, 7))
def test_any_flipped_bit_is_found(tmp_path, place, bit):
    (tmp_path / "j").unlink(missing_ok=True)
    path = written(tmp_path / "j")
    data = bytearray(path.read_bytes())
    data[place % len(data)] ^= 1 << bit
    path.write_bytes(data)
    history = read_journal(path)
    assert history.damaged >= 1
    assert history.done <= 50


@given(st.binary(max_size=200))
def test_garbage_is_never_a_record(data):
    assert decode(data) is None or encode(decode(data)).startswith(data[:8])


def test_closing_twice_does_no_harm_and_a_missing_one_is_named(tmp_path):
    journal = Journal(tmp_path / "j")
    journal.close()
    journal.close()
    with pytest.raises(JournalError, match="nowhere"):
        read_journal(tmp_path / "nowhere")
    with pytest.raises(JournalError, match="can't be opened"):
        Journal(tmp_path / "no" / "folder")


def test_disk_that_was_full_for_a_while_leaves_what_came_after_readable(tmp_path, monkeypatch):
    journal = Journal(tmp_path / "j")
    journal.add("ack", done=1)
    write = os.write
    monkeypatch.setattr(os, "write", lambda fd, data: write(fd, data[:7]))
    with pytest.raises(JournalError, match="disk full"):
        journal.add("ack", done=2)
    monkeypatch.setattr(os, "write", write)
    journal.add("end", state="failed", message="full", done=2)
    journal.close()
    history = read_journal(tmp_path / "j")
    assert (history.done, history.message, history.gaps) == (2, "full", 0)


def test_closing_on_a_broken_disk_changes_nothing(tmp_path, monkeypatch):
    journal = Journal(tmp_path / "j")

    def broken(fd: int) -> None:
        raise OSError("I/O error")

    monkeypatch.setattr(os, "fsync", broken)
    journal.close()
    journal.close()


def test_record_that_is_missing_in_the_middle_is_a_gap_and_a_torn_end_is_none(tmp_path):
    journal = Journal(tmp_path / "j")
    for number in range(3):
        journal.add("control", n=number + 1, command="M114")
    journal.close()
    lines = (tmp_path / "j").read_bytes().splitlines(keepends=True)
    whole = b"".join(lines)
    again = encode({"t": "job", "name": "a"}) + lines[0]
    (tmp_path / "j").write_bytes(whole[:-9] + b"\n" + again)
    assert (read_journal(tmp_path / "j").damaged, read_journal(tmp_path / "j").gaps) == (1, 0)
    (tmp_path / "j").write_bytes(lines[0] + lines[1][:5] + b"?" + lines[1][6:] + lines[2])
    assert (read_journal(tmp_path / "j").damaged, read_journal(tmp_path / "j").gaps) == (1, 1)


# --- disk full during a print: the journal keeps reserved space for final records
class SmallDisk:
    """Stands for ``os.write`` on a disk that takes so many bytes; each write takes what fits."""

    def __init__(self, folder: Path, size: int) -> None:
        self._write, self._folder, self._size = os.write, folder, size
        self.others = 0

    def __call__(self, fd: int, data: bytes) -> int:
        used = sum(file.stat().st_size for file in self._folder.iterdir())
        left = self._size - used - self.others
        if left <= 0:
            raise OSError(errno.ENOSPC, "No space left on device")
        return self._write(fd, data[:left])


def print_on(disk: SmallDisk, journal: Journal, monkeypatch) -> tuple[Status, Streamer]:
    transport = SimTransport(MarlinPrinter(PRINTER, START), VirtualClock())
    monkeypatch.setattr(os, "write", disk)
    keep: list[Streamer] = []

    def give_up(status: Status) -> None:
        if status.state is LinkState.PAUSED:
            keep[0].stop()

    found = printed(
        gcode(300), journal.path.parent, transport, journal=journal, on_status=give_up, keep=keep
    )
    monkeypatch.undo()
    journal.close()
    return found


@pytest.mark.parametrize("room", range(2035, 2088, 7))  # at 2028 two lines pass there
def test_end_of_a_print_on_a_full_disk_is_in_its_journal(tmp_path, monkeypatch, room):
    journal = Journal(tmp_path / "journal.log", reserve=True)
    status, streamer = print_on(SmallDisk(tmp_path, room + 65_536), journal, monkeypatch)
    assert status.state is LinkState.STOPPED
    history = read_journal(journal.path)
    assert history.end["message"] == status.message
    assert history.damaged == 0
    begin = beginning(streamer.job, history, PRINTER, None)
    assert begin.index == status.lines_executed
    assert "nothing is written twice" in begin.stood
    assert not (tmp_path / RESERVE).exists()


def test_print_whose_end_didnt_fit_isnt_gone_on_with(tmp_path, monkeypatch):
    """Somebody else takes the room that was kept back."""
    journal = Journal(tmp_path / "journal.log", reserve=True)
    disk = SmallDisk(tmp_path, 68_000)

    def greedy(self: Journal) -> bool:
        disk.others = 1_000_000
        return used(self)

    used = Journal.use_reserve
    monkeypatch.setattr(Journal, "use_reserve", greedy)
    _, streamer = print_on(disk, journal, monkeypatch)
    history = read_journal(journal.path)
    assert history.end is None
    with pytest.raises(Refused, match="the disk was full"):
        resumable(tmp_path, streamer.job.sha256)


def test_room_that_was_kept_back_is_free_after_a_print(tmp_path):
    journal = Journal(tmp_path / "journal.log", reserve=True)
    assert (tmp_path / RESERVE).stat().st_size > 60_000
    journal.add("end", state="done", message="", done=1)
    journal.close()
    assert not (tmp_path / RESERVE).exists()


def test_reserve_stays_for_a_print_that_is_gone_on_with(tmp_path):
    Journal(tmp_path / "journal.log", reserve=True).close()
    assert (tmp_path / RESERVE).stat().st_size > 60_000
    assert not read_journal(tmp_path / "journal.log").cut_short


# --- operator's notes stay with their print when its folder is reused
def begun(folder: Path, started: float) -> Path:
    """A print's journal in a folder, those before put aside."""
    path = archive_journal(folder)
    journal = Journal(path)
    journal.add("job", name=f"{started:g}.gcode", sha256="h", lines=1, started=started)
    journal.add("end", state="done", done=1)
    journal.close()
    return path


def test_a_journal_is_found_by_when_its_print_began(tmp_path: Path) -> None:
    for started in (1e9, 2e9, 3e9):
        begun(tmp_path, started)
    found = [journal_of(tmp_path, "", at).name for at in (0.5e9, 1e9, 2.5e9, 9e9)]
    assert found == ["journal.log", "journal.1.log", "journal.2.log", "journal.log"]


def test_what_cannot_be_read_counts_as_nothing(tmp_path: Path) -> None:
    journal = begun(tmp_path, 1e9)
    assert read_notes(journal) == {}
    for text in ("[1]", '{"values": ', "[" * 100_000):
        notes_path(journal).write_text(text)
        assert read_notes(journal) == {}
    (tmp_path / "journal.7.log").write_bytes(b"torn")
    assert journal_of(tmp_path, "", 2e9) == journal


# --- wire log: bounded, ordered, kept after a failure
def traffic(text: str) -> list[tuple[str, bytes]]:
    return [
        (line.split()[1], ast.literal_eval(line.split(None, 2)[2]))
        for line in text.splitlines()
        if " # " not in line
    ]


def test_both_directions_and_the_urgent_are_kept_in_order_with_times(tmp_path):
    log = WireLog(tmp_path)
    wire = LoggedTransport(ScriptedTransport(lambda data: b"ok\n", VirtualClock()), log)
    wire.write(b"N1 M105*36\n")
    assert wire.read(1.0) == b"ok\n"
    wire.write_halt(b"\nM112\n")
    log.keep(tmp_path / "kept.log")
    log.close()
    kept = (tmp_path / "kept.log").read_text()
    assert traffic(kept) == [(">", b"N1 M105*36\n"), ("<", b"ok\n"), ("!", b"\nM112\n")]
    assert (tmp_path / "wire.log").read_text() == kept
    times = [float(line.split()[0]) for line in kept.splitlines()]
    assert times == sorted(times)


def test_only_the_last_traffic_is_held_in_memory(tmp_path):
    log = WireLog()
    for k in range(20_000):
        log.add(">", b"N%d G1 X1.000 Y2.000 E0.01000*77\n" % k)
    log.keep(tmp_path / "kept.log")
    lines = traffic((tmp_path / "kept.log").read_text())
    assert sum(len(data) for _, data in lines) < RING_BYTES
    assert lines[-1][1].startswith(b"N19999 ")


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no /dev/full here")
def test_full_disk_ends_the_log_and_nothing_else():
    """An error in there would end the link process, or a kill before its M112 is repeated."""
    log = WireLog(Path("/dev/full"))
    wire = LoggedTransport(ScriptedTransport(lambda data: b"ok\n", VirtualClock()), log)
    wire.write_urgent(b"\nM112\n")
    wire.write(b"N1 M105*36\n")
    assert wire.read(1.0) == b"ok\nok\n"
    log.close()
    assert "No space left" in log.lost


# --- history of prints: index rebuilt from the journals
REPO = Path(__file__).parents[4]


@pytest.fixture
def data(tmp_path, monkeypatch) -> Path:
    monkeypatch.setenv("PRINTCTL_DATA", str(tmp_path / "data"))
    return tmp_path / "data"


def print_in(folder: Path, name: str = "a.gcode", started: float = 1e9, end: str = "done") -> Path:
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
    folder = print_in(tmp_path / "one", end="")
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


def test_print_that_only_lists_its_folder_is_taken_in_when_the_history_is_read(data, tmp_path):
    remember_folder(print_in(tmp_path / "one")).join()
    remember_folder(print_in(tmp_path / "two", "b.gcode", 2e9, end="")).join()
    remember_folder(tmp_path / "two").join()
    assert (data / "journals.txt").read_bytes().count(b"\n") == 2
    assert [entry.state for entry in PrintHistory().entries()] == [INTERRUPTED, "done"]
    (tmp_path / "one" / "journal.log").rename(tmp_path / "one" / "journal.1.log")
    print_in(tmp_path / "one", "c.gcode", 3e9, end="killed")
    assert PrintHistory().known("state") == ["done", INTERRUPTED, "killed"]
    assert [entry.file for entry in PrintHistory().entries()] == ["c.gcode", "b.gcode", "a.gcode"]


def test_print_keeps_its_identity_when_its_journal_is_put_aside(data, tmp_path):
    folder = print_in(tmp_path / "one")
    history = PrintHistory()
    history.note(folder)
    (folder / "journal.log").rename(folder / "journal.1.log")
    print_in(folder, "b.gcode", 2e9)
    history.note(folder)
    found = {entry.file: entry.journal.name for entry in history.entries()}
    assert found == {"b.gcode": "journal.log", "a.gcode": "journal.1.log"}


@pytest.mark.parametrize("damage", ["garbage", "torn", "other version", "missing table", "deleted"])
def test_damaged_index_is_put_aside_and_made_again(data, tmp_path, damage):
    for k in range(20):
        PrintHistory().note(print_in(tmp_path / str(k), f"{k}.gcode", 1e9 + k))
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
    history.note(print_in(tmp_path / "known"))
    print_in(tmp_path / "shelf" / "deep" / "two", "b.gcode", 2e9)
    assert history.rebuild() == 1
    assert history.rebuild([tmp_path / "shelf"]) == 2
    (tmp_path / "known" / "journal.log").unlink()
    assert history.rebuild() == 2
    assert {e.file for e in history.entries()} == {"a.gcode", "b.gcode"}


def test_journal_with_damaged_lines_or_without_a_job_is_no_obstacle(data, tmp_path):
    folder = print_in(tmp_path / "one")
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
        "from printctl.history.index import PrintHistory\n"
        "for k in range(10): PrintHistory().note(Path(sys.argv[1]) / f'{sys.argv[2]}-{k}')\n"
    )
    for who in range(2):
        for k in range(10):
            print_in(tmp_path / f"{who}-{k}", f"{who}-{k}.gcode", 1e9 + 100 * who + k)
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
    remember(print_in(tmp_path / "one"))
    remember_folder(tmp_path / "one").join(0.5)


@pytest.mark.skipif(not hasattr(os, "openpty"), reason="no pseudo-terminals here")
@pytest.mark.parametrize("writable", [True, False])
def test_link_process_adds_its_print(data, tmp_path, writable):
    if not writable:
        data.write_text("a file where the folder should be")
    write_job(tmp_path / "job.gcode", 50)
    with pty_printer(FakeMarlin()) as served:
        job, run = tmp_path / "job.gcode", tmp_path / "run"
        client = start_print(Order(job, "generic_marlin", served.name, run))
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
    remember(print_in(tmp_path / "one", "heart.gcode"))
    remember(print_in(tmp_path / "two", "liver.gcode", 2e9, end="killed"))
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


def test_print_that_broke_off_on_its_way_back_has_no_end_of_an_earlier_attempt(tmp_path):
    journal = Journal(tmp_path / "journal.log")
    for state in ("printing", "connecting", "resuming"):
        journal.add("job", id="1", name="a", sha256="s")
        journal.add("state", state=state, message="")
        if state == "connecting":
            journal.add("end", state="failed", message="", error="", position_known=False)
    journal.close()
    history = resumable(tmp_path, "s")
    assert (history.end, history.state) == (None, LinkState.RESUMING)


def test_attempt_to_go_on_whose_disk_was_full_isnt_gone_on_with_again(tmp_path):
    """Its commands are missing in the journal, so that the printer's count tells no line."""
    journal = Journal(tmp_path / "journal.log", reserve=True)
    journal.add("job", id="1", name="a", sha256="s")
    journal.add("state", state="printing", message="")
    end = {"state": "failed", "message": "", "done": 6, "error": "PortLost"}
    journal.add("end", **end, position_known=False)
    assert not read_journal(journal.path).cut_short
    journal.add("job", id="1", name="a", sha256="s")
    journal.use_reserve()
    assert read_journal(journal.path).cut_short
    with pytest.raises(Refused, match="the disk was full"):
        resumable(tmp_path, "s")
    journal.add("end", **end, position_known=False, lost=True)
    assert read_journal(journal.path).cut_short
    journal.close()


def test_history_lists_a_print_once_its_data_folder_can_be_written_again(tmp_path, monkeypatch):
    monkeypatch.setenv("PRINTCTL_DATA", str(tmp_path / "data"))
    monkeypatch.setattr(folders, "AGAIN_S", 0.01)
    real, fails, told = folders.add_folder, [1, 2, 3], list[str]()

    def add(folder: Path, data: Path) -> None:
        if fails:
            fails.pop()
            raise OSError(errno.EROFS, os.strerror(errno.EROFS))
        real(folder, data)

    monkeypatch.setattr(folders, "add_folder", add)
    folders.remember_folder(tmp_path / "a.print", told.append).join(5.0)
    assert folders.known_folders(tmp_path / "data") == [tmp_path / "a.print"]
    [text] = told
    assert "isn't in the history yet" in text
    assert "(Read-only file system)" in text
    assert f"`printctl history rebuild {tmp_path / 'a.print'}`" in text


def test_a_print_isnt_begun_on_a_disk_that_is_nearly_full(tmp_path, monkeypatch):
    free = SimpleNamespace(free=2**20)
    monkeypatch.setattr(one_print.shutil, "disk_usage", lambda path: free)
    with pytest.raises(LinkError, match=r"1\.0 MiB are free on the disk of .*needs 16 MiB"):
        one_print._refuse_full_disk(tmp_path)
