"""Host death during a print on the simulated printer, and resumption."""

from __future__ import annotations

import os
import re
import time
from contextlib import closing
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from printctl.cli.machine.running_print import status_lines
from printctl.machine.errors import LinkError, NoLink, Refused
from printctl.machine.job.job import Job
from printctl.machine.job.moves import moves_ahead, surely_moved
from printctl.machine.job.retreat import Retreat
from printctl.machine.ports.clock import VirtualClock
from printctl.machine.prints.recovery import NoCheckpoint, plan_recovery
from printctl.machine.prints.state import assemble_state
from printctl.machine.process.clients.client import attach
from printctl.machine.process.outcome import read_outcome, resumable
from printctl.machine.records.journal import Journal, encode
from printctl.machine.records.record import JOURNAL, ContactRecord, load_record
from printctl.machine.records.replay import JournalledPrint, read_journal
from printctl.machine.records.states import LinkState, Status
from printctl.pipeline.past.past_print import entry_of
from sim.devices.families.marlin_printer import MarlinPrinter
from tests.printctl.cli.shell import Shell
from tests.printctl.machine.link.fake_marlin import FakeMarlin, pty_printer
from tests.printctl.machine.link.jobs import journal_in, parse_job
from tests.printctl.machine.link.layered import doomed, layered
from tests.printctl.machine.link.sim_transport import SimTransport
from tests.printctl.machine.link.simulated import (
    PRINTER,
    START,
    foreseen,
    gcode,
    printed,
    wired,
)
from tests.printctl.machine.link.simulated_transport import HostDiedError


class Silent(SimTransport):
    """A wire on which nothing comes back."""

    def read(self, timeout: float) -> bytes:
        super().read(timeout)
        return b""


def begin(folder: Path, job: Job) -> None:
    """Write the record of a link process that begins."""
    journal_in(folder).add("job", sha256=job.sha256, lines=len(job), started=time.time())


def known_made(job: Job, done: int) -> int:
    return surely_moved(job.lines, done, moves_ahead(PRINTER))


def resumed(data: bytes, folder: Path, transport: SimTransport) -> Status:
    return wired(transport, folder, data).run(read_journal(folder / "journal.log"))


@pytest.mark.parametrize("paused", [False, True])
def test_ink_that_stood_without_a_host_is_told_with_its_place(tmp_path, paused):
    data, printer, clock = gcode(60), MarlinPrinter(PRINTER, START), VirtualClock()

    def on_status(status: Status) -> None:
        if paused and status.state is LinkState.PAUSED:
            raise HostDiedError

    wire = SimTransport(printer, clock) if paused else doomed(printer, clock, 60, 1.0)
    asked = ("pause",) if paused else ()
    with pytest.raises(HostDiedError):
        printed(data, tmp_path, wire, *asked, on_status=on_status)
    journal = tmp_path / "journal.log"
    os.utime(journal, (time.time() - 20.0,) * 2)
    printer.advance(20.0)
    stood = printer.executed().end[-1]
    status = resumed(data, tmp_path, SimTransport(printer, clock))
    assert status.state is LinkState.DONE
    found = re.search(
        r"stopped while extruding, for ([\d.]+) s at line \d+ \(X([\d.]+) Y([\d.]+)", status.message
    )
    if paused:
        assert found is None
        return
    assert found is not None
    ahead_s = 3.0  # of the moves that the planner held
    assert 20.0 - ahead_s < float(found[1]) < 20.5
    assert [float(found[2]), float(found[3])] == pytest.approx(stood[:2], abs=0.02)


@pytest.mark.parametrize("last", ["reset", "another"])
def test_failed_attempts_to_go_on_leave_what_was_known(tmp_path, last):
    """Silent, killed before the printer answers, silent again, then a board not as it was."""
    data, printer, clock = gcode(60), MarlinPrinter(PRINTER, START), VirtualClock()
    job = parse_job(data, "test.gcode", PRINTER)
    begin(tmp_path, job)
    with pytest.raises(HostDiedError):
        printed(data, tmp_path, doomed(printer, clock, 66, 1.0))
    before = read_journal(tmp_path / "journal.log")
    with pytest.raises(NoCheckpoint) as first:
        plan_recovery(job, data, before, PRINTER, Retreat())
    assert before.done > 30
    assert first.value.line > 0
    for attempt in ("silent", "killed", "silent", last):
        known = read_journal(tmp_path / "journal.log")
        resumable(tmp_path, job.sha256)
        begin(tmp_path, job)
        if attempt == "killed":
            with pytest.raises(HostDiedError):
                resumed(data, tmp_path, doomed(printer, clock, 1, 0.0))
            assert read_journal(tmp_path / "journal.log").state is known.state
        else:
            if attempt == "another":  # at a later line, and elsewhere
                printer = MarlinPrinter(PRINTER, (60.0, 50.0, 10.0))
                number = before.done + len(before.controls) + 5
                printer.exchange(b"M302 P1\nM110 N%d\n" % number)
            if attempt == "reset":
                printer.reset()
                printer.settle()
                printer.take_output()
            kind = Silent if attempt == "silent" else SimTransport
            status = resumed(data, tmp_path, kind(printer, clock))
            assert status.lines_done == before.done
            assert status.lines_executed == known_made(job, before.done)
            assert not status.position_known
        after = read_journal(tmp_path / "journal.log")
        assert (after.done, after.print_id) == (before.done, before.print_id)
        with pytest.raises(NoCheckpoint) as again:
            plan_recovery(job, data, after, PRINTER, Retreat())
        assert again.value.line == first.value.line
        entry = entry_of(tmp_path / "journal.log")
        assert entry is not None
        assert (entry.done, entry.total) == (before.done, before.total)
    assert status.state is LinkState.POSITION_UNKNOWN
    with pytest.raises(Refused, match=r"printctl recover"):
        resumable(tmp_path, job.sha256)


@pytest.mark.parametrize("other", [b"G91\n", b"M83\n", b"M221 S50\n", b"M140 S60\n"])
def test_what_another_program_set_while_the_host_was_dead_is_taken_back(tmp_path, other):
    data, printer, clock = gcode(60), MarlinPrinter(PRINTER, START), VirtualClock()
    with pytest.raises(HostDiedError):
        printed(data, tmp_path, doomed(printer, clock, 60, 1.0))
    printer.receive(other)
    printer.settle()
    printer.take_output()
    status = resumed(data, tmp_path, SimTransport(printer, clock))
    assert status.state is LinkState.DONE, status
    motion = printer.executed()
    expected = foreseen(data)
    assert np.array_equal(motion.end[-1], expected.end[-1])
    assert motion.plunger_end[-1] == pytest.approx(expected.plunger_end[-1])
    assert printer.machine.heat.bed.target_c == 0


# --- message about a print whose link process was killed: the printer's behaviour, by family
def killed(folder, profile: str, state: LinkState, done: int = 60, port: str = "/dev/printer"):
    job = folder / "job of mine.gcode"
    job.write_bytes(layered(4, 60))
    ContactRecord(1, "", "", str(job), profile, port, 1.0).save(folder)
    with closing(Journal(folder / JOURNAL)) as journal:
        sha256 = parse_job(layered(4, 60), job.name).sha256
        journal.add("job", name=job.name, sha256=sha256, lines=300, started=1.0, pid=1)
        journal.add("state", state=LinkState.PRINTING, message="")
        journal.add("ack", done=done)
        if state is not LinkState.PRINTING:
            message = "cancelled by the user" if state is LinkState.STOPPING else ""
            journal.add("state", state=state, message=message)
    return read_outcome(folder)


@pytest.mark.parametrize(
    ("profile", "held"),
    [
        ("generic_marlin", "up to 20 moves"),
        ("klipper_bioprinter", "some seconds of moves"),
        ("makergear_m2_duet2", "moves (last"),
    ],
)
def test_motors_may_run_out_what_the_printer_has_taken(tmp_path, profile, held):
    message = killed(tmp_path, profile, LinkState.PRINTING).message
    assert "nothing has stopped its motors" in message
    assert held in message
    assert "heaters stay as set" in message


@pytest.mark.parametrize(
    ("profile", "motors"),
    [
        ("generic_marlin", "its motors were told to stop (M410)"),
        ("klipper_bioprinter", "its motors execute the queued moves"),
    ],
)
def test_what_is_known_of_a_print_whose_process_died_in_a_stop(tmp_path, profile, motors):
    message = killed(tmp_path, profile, LinkState.STOPPING).message
    assert f"it was being ended (cancelled by the user): {motors}" in message
    assert "needle may be up or still down, and heaters may be on" in message
    assert "nothing has stopped its motors" not in message


@pytest.mark.parametrize("journal", ["gone", "a folder", "damaged"])
def test_unreadable_journal_says_nothing_of_the_motors(tmp_path, journal):
    killed(tmp_path, "generic_marlin", LinkState.PRINTING)
    record, path = load_record(tmp_path), tmp_path / JOURNAL
    replace(record, address="unix:/nowhere").save(tmp_path)
    if journal == "damaged":
        path.write_bytes(b"\0" * path.stat().st_size)
    else:
        path.unlink()
    if journal == "a folder":
        path.mkdir()
    outcome = read_outcome(tmp_path)
    assert outcome.state is LinkState.INTERRUPTED
    assert "its progress is unknown" in outcome.message
    assert "motors may be moving" in outcome.message
    assert "had not started" not in outcome.message


def test_print_without_journal_or_address_had_not_begun(tmp_path):
    killed(tmp_path, "generic_marlin", LinkState.PRINTING)
    (tmp_path / JOURNAL).unlink()
    assert "had not started, so its motors were at rest" in read_outcome(tmp_path).message


def test_a_paused_printer_stands(tmp_path):
    assert "its motors were at rest" in killed(tmp_path, "generic_marlin", LinkState.PAUSED).message


def test_command_that_recovers_can_be_copied(tmp_path):
    status = killed(tmp_path, "generic_marlin", LinkState.PRINTING)
    (line,) = [
        line
        for line in status_lines(assemble_state(tmp_path, status, JournalledPrint()), "my run")
        if line.startswith("recover:")
    ]
    assert "printctl recover 'my run' --from-line " in line
    assert line.split("--from-line ")[1].split()[0].isdigit()


def interrupted(folder, *records: dict) -> None:
    journal = Journal(folder / JOURNAL)
    journal.add("job", name="a.gcode", sha256="0", lines=100)
    journal.add("state", state=LinkState.PRINTING, message="")
    journal.add("ack", done=20)
    for record in records:
        journal.add(**record)
    journal.close()


def test_print_that_was_being_ended_is_not_gone_on_with(tmp_path):
    interrupted(tmp_path)
    assert resumable(tmp_path, "0").done == 20
    stopping = {"sort": "state", "state": LinkState.STOPPING, "message": "cancelled by the user"}
    interrupted(tmp_path, stopping)
    with pytest.raises(Refused, match=r"was being ended .*heaters may be off"):
        resumable(tmp_path, "0")


def test_print_whose_journal_misses_records_is_not_gone_on_with(tmp_path):
    interrupted(tmp_path)
    with (tmp_path / JOURNAL).open("ab") as handle:
        lost = encode({"t": "control", "n": 21, "command": "M114"}).replace(b"21", b"22")
        handle.write(lost + encode({"t": "ack", "done": 30}))
    with pytest.raises(Refused, match=r"damaged in 1 places.*printctl recover"):
        resumable(tmp_path, "0")


# --- `printctl emergency-stop` where the print's link process is gone and the motors may run on


def test_kill_opens_the_port_and_halts(tmp_path, monkeypatch, capsys):
    shell = Shell(monkeypatch, capsys)
    with pty_printer(FakeMarlin()) as served:
        killed(tmp_path, "generic_marlin", LinkState.PRINTING, port=served.name)
        code, _, err = shell("stop", str(tmp_path))
        assert (code, served.printer.halted) == (1, False)
        assert "printctl emergency-stop" in err
        code, out, _ = shell("emergency-stop", str(tmp_path))
        assert (code, served.printer.halted) == (0, True)
    assert out.startswith("halted: ")
    assert read_outcome(tmp_path).state is LinkState.KILLED
    assert read_journal(tmp_path / JOURNAL).state is LinkState.KILLED


REQUESTS = ["pause", "resume", "reload", "alive"]


@pytest.mark.parametrize("do", ["stop", *REQUESTS])
def test_client_of_an_interrupted_print_is_told_that_nobody_speaks_to_its_printer(tmp_path, do):
    killed(tmp_path, "generic_marlin", LinkState.PRINTING)
    with pytest.raises(NoLink, match=r"nobody speaks .*`printctl emergency-stop` halts it"):
        getattr(attach(tmp_path), do)()


def test_client_kills_an_interrupted_print(tmp_path):
    with pty_printer(FakeMarlin()) as served:
        killed(tmp_path, "generic_marlin", LinkState.PRINTING, port=served.name)
        client = attach(tmp_path)
        client.kill()
        assert served.printer.halted
        assert client.wait(0).state is LinkState.KILLED


def test_kill_goes_by_what_the_firmware_had_reported_before_its_host_died(tmp_path):
    """Its profile says EMERGENCY_PARSER; without, M410 would hold M112 up."""
    with pty_printer(HearsAll()) as served:
        killed(tmp_path, "generic_marlin", LinkState.PRINTING, port=served.name)
        with closing(Journal(tmp_path / JOURNAL)) as journal:
            journal.add("firmware", capabilities={"EMERGENCY_PARSER": False})
        attach(tmp_path).kill()
        assert served.printer.halted
        assert b"M410" not in served.printer.heard


class HearsAll(FakeMarlin):
    heard = b""

    def receive(self, data: bytes) -> bytes:
        self.heard += data
        return super().receive(data)


def test_client_that_cant_kill_an_interrupted_print_says_so(tmp_path):
    killed(tmp_path, "generic_marlin", LinkState.PRINTING, port="/dev/nowhere")
    with pytest.raises(LinkError, match="not halted, cut the printer's power"):
        attach(tmp_path).kill()


def test_client_of_a_print_that_has_ended_is_told_how(tmp_path):
    killed(tmp_path, "generic_marlin", LinkState.PRINTING)
    ended = Status(LinkState.STOPPED, message="cancelled by the user")
    replace(load_record(tmp_path), status=ended.to_dict()).save(tmp_path)
    client = attach(tmp_path)
    for do in REQUESTS:
        with pytest.raises(Refused, match=r"has ended \(cancelled: cancelled by the user\)"):
            getattr(client, do)()
    client.stop()
    client.kill()
    assert client.status == ended


@pytest.mark.parametrize("mute", [False, True])
def test_kill_that_halts_nothing_says_so(tmp_path, monkeypatch, capsys, mute):
    printer = FakeMarlin()
    printer.mute = mute
    with pty_printer(printer) as served:
        port = served.name if mute else "/dev/nowhere"
        killed(tmp_path, "generic_marlin", LinkState.PRINTING, port=port)
        code, _, err = Shell(monkeypatch, capsys)("emergency-stop", str(tmp_path))
    assert code != 0
    assert "cut" in err
    assert "power" in err
    assert read_outcome(tmp_path).state is LinkState.INTERRUPTED  # it may be killed again
