"""Print journal: correct content, tolerant of a torn last record."""

from __future__ import annotations

import os

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from printctl.machine.link.errors import JournalError
from printctl.machine.link.journal import Journal, decode, encode
from printctl.machine.link.journalled_print import read_journal
from printctl.machine.link.states import LinkState


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
