"""The journal: what is in it is true, and a torn tail does no harm."""

from __future__ import annotations

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from printctl.link.errors import JournalError
from printctl.link.journal import Journal, decode, encode, read_journal
from printctl.link.states import LinkState


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


def test_control_lines_are_not_job_lines(tmp_path):
    history = read_journal(written(tmp_path / "j"))
    assert history.job_line(50) == 50
    assert history.job_line(51) == 50
    assert history.job_line(60) == 59


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
