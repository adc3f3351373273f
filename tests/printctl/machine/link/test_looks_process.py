"""Looks of a link process over a real pseudo-terminal, killed by kill -9 with an insert taken."""

from __future__ import annotations

import os
import signal

import pytest

from benchmarks.observe.faults import one_print
from printctl.machine.link import LinkState, resume_print, start_print
from printctl.machine.link.care import Care
from printctl.machine.link.errors import Refused
from printctl.machine.link.journalled_print import read_journal
from printctl.machine.link.look_book import LookDecision
from printctl.machine.link.marks import MarkKind
from tests.printctl.machine.link.fake_marlin import FakeMarlin, pty_printer
from tests.printctl.machine.link.jobs import parse_job
from tests.printctl.machine.link.looking import layered, patch, patch_at

pytestmark = pytest.mark.skipif(not hasattr(os, "openpty"), reason="no pseudo-terminals here")


def look(client, number: int) -> dict:
    """Wait until the print is held for a look."""
    for status in client.events():
        if status.state is LinkState.LOOKING and status.look["number"] == number:
            return status.look
        assert not status.ended, status
    raise AssertionError(f"never held for look {number}")


def with_x(lines) -> list[str]:
    return [line for line in lines if " X" in line]


def test_insert_outlives_the_process_that_took_it(tmp_path, profile):
    data, job, run = layered(2, 6), tmp_path / "job.gcode", tmp_path / "run"
    job.write_bytes(data)
    care, lines = Care(checkpoint_s=None, look_after=MarkKind.LAYER), patch(data, 0)
    with pty_printer(FakeMarlin()) as served:
        client = start_print(job, profile, served.name, run, care=care)
        look(client, 1)
        with pytest.raises(Refused, match="G28 may not be inserted"):
            client.looks.insert(1, ["G28"])
        answer = client.looks.insert(1, lines, "a gap")
        os.kill(client.record.pid, signal.SIGKILL)
        client.wait(300)
        client = resume_print(run, served.name)
        held = look(client, 1)
        assert (held["inserted"], held["insert_sha256"]) == (11, answer["sha256"])
        assert client.looks.insert(1, lines, "a gap") == answer
        with pytest.raises(Refused, match="has an insert of 11 lines already"):
            client.looks.insert(1, lines[:3])
        client.looks.decide(1, LookDecision.GO_ON)
        look(client, 2)
        assert client.looks.decide(1, LookDecision.GO_ON)["decision"] == "go_on"
        client.looks.decide(2, LookDecision.GO_ON)
        assert client.wait(300).state is LinkState.DONE
    grown = parse_job(data, "a").grown_by(read_journal(run / "journal.log").inserts)
    assert with_x(served.printer.numbered) == with_x(line.decode() for line in grown.lines)


def test_a_stroke_held_within_and_killed_there_is_written_once(tmp_path, profile):
    lines = layered(2, 6, "PASS_END").splitlines()
    first = next(k for k, line in enumerate(lines) if b" X" in line and b" E" in line)
    data = b"\n".join([*lines[: first + 3], b";PART_END:0", *lines[first + 3 :]]) + b"\n"
    job, run = tmp_path / "job.gcode", tmp_path / "run"
    job.write_bytes(data)
    care = Care(checkpoint_s=None, look_after=MarkKind.VESSEL)
    done = parse_job(data, "a").marks.of(MarkKind.PART)[0].index
    with pty_printer(FakeMarlin()) as served:
        client = start_print(job, profile, served.name, run, care=care)
        held = look(client, 1)
        assert (held["mark"], held["done"]) == ("end of a part of vessel 0", done)
        inside = [line.replace("Z9.900", "Z10") for line in patch_at(data, done)]
        client.looks.insert(1, inside, "a gap")
        os.kill(client.record.pid, signal.SIGKILL)
        client.wait(300)
        client = resume_print(run, served.name)
        look(client, 1)
        for number in (1, 2, 3):
            client.looks.decide(number, LookDecision.GO_ON)
            if number < 3:
                look(client, number + 1)
        assert client.wait(300).state is LinkState.DONE
    grown = parse_job(data, "a").grown_by(read_journal(run / "journal.log").inserts)
    assert with_x(served.printer.numbered) == with_x(line.decode() for line in grown.lines)


def test_a_look_that_was_heard_before_is_told_again(tmp_path, profile):
    """`start_print` waits for the first lines, and may hear of the first look in doing so."""
    job, run = tmp_path / "job.gcode", tmp_path / "run"
    job.write_bytes(layered(1, 6))
    care = Care(checkpoint_s=None, look_after=MarkKind.LAYER, look_limit_s=5)
    with pty_printer(FakeMarlin()) as served:
        client = start_print(job, profile, served.name, run, care=care)
        look(client, 1)
        assert next(client.events()).state is LinkState.LOOKING  # paused by the link in 5 s
        client.stop()
        client.wait(300)


@pytest.mark.slow
@pytest.mark.parametrize("seed", [11, 12])
def test_simulated_printer_makes_each_stroke_of_the_grown_job_once(tmp_path, seed, monkeypatch):
    monkeypatch.setenv("PRINTCTL_DATA", str(tmp_path))
    run, state, found = one_print(seed, tmp_path, 6)
    assert state is LinkState.DONE
    assert found.exact, (found, run.killed)
