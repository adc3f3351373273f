"""Checkers of the link benchmark: pass a sound print, detect planted faults."""

import numpy as np

from benchmarks.link.answerer import Answerer
from benchmarks.link.files import START_MM, STEPS_PER_MM, zigzag
from benchmarks.link.runs import BreakingTroubles, ends_of, facts, new_printer, run
from benchmarks.link.virtual import kill_rows
from gcode.dry_run.run import dry_run


def unmet(rows):
    return [row["measure"] for row in rows if row.get("met") is False]


def test_file_means_what_its_steps_say():
    file = zigzag(50)
    motion = dry_run(file.data, facts(), START_MM, cold_extrusion=True).executed
    assert np.array_equal(ends_of(motion), file.ends)
    assert len(set(file.lines)) == len(file.lines)
    assert STEPS_PER_MM.tolist() == list(facts().steps_per_mm.model_dump().values())


def test_noisy_print_is_found_sound(tmp_path):
    found = run(
        zigzag(300),
        tmp_path,
        3,
        BreakingTroubles(noise=0.001, drop_ok=0.003, delay=0.003, breaks=0.006),
    )
    assert found.faults == 0
    assert found.unreached <= found.order.slipped
    assert found.begun > 1


def test_line_that_the_printer_swallows_is_seen(tmp_path):
    ledger = new_printer()
    accept = ledger.printer.lines.accept

    def swallow(line):
        verdict = accept(line)
        return None if b"N100 " in line else verdict

    ledger.printer.lines.accept = swallow
    found = run(zigzag(200), tmp_path, ledger=ledger)
    assert found.unreached == 1


def test_kills_meet_their_goals():
    assert unmet(kill_rows(quick=True)) == []


def test_answering_peer_refuses_what_is_out_of_step():
    peer = Answerer()
    assert peer.receive(b"N0 M110 N0*125\n") == b"ok\n"
    assert peer.receive(b"N1 G1 X1*1\n") == b"ok\n"
    assert b"Last Line: 1\nResend: 2" in peer.receive(b"N99999999 M105*23\n")
    assert [text for _, text in peer.lines] == [b"N0 M110 N0*125", b"N1 G1 X1*1"]
