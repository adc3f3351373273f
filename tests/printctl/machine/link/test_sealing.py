"""Journals: each line chained to those before, signed at the print's end; changes are found."""

from __future__ import annotations

from pathlib import Path

import pytest

from printctl.machine.errors import JournalError
from printctl.machine.records import journal as journal_module
from printctl.machine.records import lab_key as keys
from printctl.machine.records.folders import data_folder
from printctl.machine.records.journal import BEGIN, Journal, decode, encode, link, shown
from printctl.machine.records.lab_key import lab_key
from printctl.machine.records.replay import read_journal
from printctl.machine.records.sealing import (
    Finding,
    JournalCheck,
    check_journal_file,
    sign_journal,
)

END = {"state": "done", "message": "", "done": 3, "error": "", "position_known": True}


@pytest.fixture(autouse=True)
def data(tmp_path, monkeypatch) -> Path:
    monkeypatch.setenv("PRINTCTL_DATA", str(tmp_path / "data"))
    return tmp_path / "data"


def begun(path: Path) -> Journal:
    journal = Journal(path, sign=sign_journal)
    journal.add("job", name="a.gcode", id="a-print", sha256="0" * 64, lines=3)
    journal.add("state", state="printing", message="")
    return journal


def ended(path: Path) -> Path:
    journal = begun(path)
    journal.add("ack", done=3)
    journal.add("end", **END)
    journal.close()
    return path


def checked(path: Path) -> JournalCheck:
    return check_journal_file(path, [lab_key().public])


def test_a_print_that_has_ended_is_signed_by_the_key(tmp_path):
    found = checked(ended(tmp_path / "j"))
    assert found.finding is Finding.SIGNED
    assert found.words.startswith("5 lines, chained and signed at the print's end by the trusted")
    assert found.fingerprint == lab_key().public.fingerprint
    assert check_journal_file(tmp_path / "j", []).finding is Finding.UNKNOWN_KEY


def test_a_line_that_was_rewritten_with_its_checksum_is_named(tmp_path):
    path = ended(tmp_path / "j")
    lines = path.read_bytes().splitlines(keepends=True)
    record = decode(lines[2], chained=True)
    lines[2] = encode({**record, "done": 2})
    path.write_bytes(b"".join(lines))
    found = checked(path)
    assert found.finding is Finding.CHANGED
    assert found.words == "the journal was changed after line 2: line 4 doesn't follow"
    assert read_journal(path).done == 3  # the end's; what can be read is read


def test_all_lines_hashed_again_are_betrayed_by_the_signature(tmp_path):
    path = ended(tmp_path / "j")
    head, lines = BEGIN, []
    for line in path.read_bytes().splitlines():
        record = decode(line)
        if record["t"] == "ack":
            record["done"] = 2
        if record["t"] == "seal":
            record = {"t": "seal", "at": record["at"], "chain": shown(head), **record}
        else:
            record["chain"] = shown(head)
        lines.append(encode(record))
        head = link(head, lines[-1][:-1])
    path.write_bytes(b"".join(lines))
    assert (
        checked(path).words
        == "the journal was changed before line 5: it isn't what was signed there"
    )


def test_a_print_broken_off_isnt_signed_and_is_once_it_was_given_up(tmp_path):
    path = tmp_path / "j"
    begun(path).close()
    assert checked(path).words.startswith("not signed: the print ended without a last line")
    path.write_bytes(path.read_bytes()[:-7])  # power went away within a line
    assert checked(path).finding is Finding.UNSIGNED
    journal = Journal(path, sign=sign_journal)
    journal.add("end", **END)
    journal.close()
    found = checked(path)
    assert found.finding is Finding.SIGNED
    assert "; 1 torn, as a loss of power leaves them" in found.words


def test_an_alarm_after_the_end_is_signed_when_the_journal_is_closed(tmp_path):
    path = tmp_path / "j"
    journal = begun(path)
    journal.add("end", **END)
    journal.add("alarm", text="the log's disk is full")
    assert checked(path).words == "not signed: 1 line follows the last signature, which is line 4"
    journal.close()
    assert checked(path).finding is Finding.SIGNED


def test_journal_of_a_version_without_a_chain_is_read_and_its_lines_are_covered_from_then_on(
    tmp_path,
):
    path = tmp_path / "j"
    path.write_bytes(encode({"t": "job", "lines": 3}) + encode({"t": "ack", "done": 2}))
    assert read_journal(path).done == 2
    assert checked(path).finding is Finding.UNCHAINED
    journal = Journal(path, sign=sign_journal)
    journal.add("end", **END)
    journal.close()
    assert "; the first 2 are of a version without a chain" in checked(path).words
    path.write_bytes(path.read_bytes().replace(b'"lines":3', b'"lines":4'))
    assert checked(path).finding is Finding.CHANGED


def test_a_journal_cut_back_to_an_earlier_signature_is_found_where_it_was_signed(tmp_path, data):
    path = ended(tmp_path / "j")
    before = path.read_bytes()
    ended(path)  # was continued
    assert checked(path).finding is Finding.SIGNED
    path.write_bytes(before)
    assert checked(path).words == (
        "the journal was changed after line 5: this machine has signed it with other lines there"
    )
    (data / "seals.txt").unlink()
    assert checked(path).finding is Finding.SIGNED  # as on another machine: docs/records.md says so


@pytest.mark.parametrize("why", ["signatures need cryptography", "no random numbers"])
def test_without_a_key_the_end_is_there_and_says_why_it_isnt_signed(tmp_path, monkeypatch, why):
    with monkeypatch.context() as patch:
        if why.startswith("signatures"):
            patch.setattr(keys, "signing_missing", lambda: why)
        else:
            patch.setattr(keys, "_make", lambda path: (_ for _ in ()).throw(RuntimeError(why)))
        ended(tmp_path / "j")
    assert read_journal(tmp_path / "j").end["state"] == "done"
    assert "not signed: " in checked(tmp_path / "j").words
    assert why in checked(tmp_path / "j").words


def test_lines_written_after_a_full_disk_stay_in_the_chain(tmp_path, monkeypatch):
    journal = begun(tmp_path / "j")
    write = journal_module.os.write
    for size in (7, 0, 3):
        monkeypatch.setattr(
            journal_module.os, "write", lambda fd, data, n=size: write(fd, data[:n])
        )
        with pytest.raises(JournalError):
            journal.add("ack", done=1)
    monkeypatch.undo()
    monkeypatch.setenv("PRINTCTL_DATA", str(tmp_path / "data"))
    journal.add("end", **END)
    journal.close()
    assert checked(tmp_path / "j").finding is Finding.SIGNED


def test_key_and_list_of_signatures_are_in_the_users_folder(tmp_path, data):
    ended(tmp_path / "j")
    assert data_folder() == data
    assert {"records_key.pem", "seals.txt"} <= {one.name for one in data.iterdir()}
