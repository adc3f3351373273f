"""Tampering with journals and bundles: nothing passes without the station's key."""

from __future__ import annotations

import random

from benchmarks.evidence import Filed, edited, make_print, passes, records_of, rehashed, unnoticed
from printctl.machine.records.lab_key import lab_key


def test_nothing_passes_that_was_changed_without_the_key(tmp_path, monkeypatch):
    monkeypatch.setenv("PRINTCTL_DATA", str(tmp_path / "data"))
    tried, passed = unnoticed(250, 2, tmp_path / "prints")
    assert not passed
    assert len(tried) == 21  # each way


def test_with_the_key_a_changed_journal_passes_but_not_where_it_was_signed(tmp_path, monkeypatch):
    monkeypatch.setenv("PRINTCTL_DATA", str(tmp_path / "data"))
    rng, key = random.Random(3), lab_key()
    entry = make_print(tmp_path / "run" / "print", 1, rng)
    one = Filed(entry, entry.journal.read_bytes(), b"")
    records = records_of(one.journal)
    next(record for record in records if record["t"] == "alarm")["text"] = "all was well"
    forged = rehashed(records, key)
    assert not passes(one, forged, key, tmp_path / "out.zip")
    (tmp_path / "data" / "seals.txt").unlink()
    assert passes(one, forged, key, tmp_path / "out.zip")
    assert edited(records, rng) != records
