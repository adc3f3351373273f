"""The link process, its client and its journal, over a real pseudo-terminal."""

from __future__ import annotations

import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import pytest
from rich.console import Console

from benchmarks.observe.faults import one_print
from printctl.machine.control.look_book import LookDecision
from printctl.machine.errors import (
    AlreadyPrinting,
    LinkError,
    PortInUse,
    PortMissing,
    Refused,
)
from printctl.machine.job.care import Care
from printctl.machine.job.marks import MarkKind
from printctl.machine.prints import follow
from printctl.machine.process import contact
from printctl.machine.process.clients import launch, starting
from printctl.machine.process.clients.client import PrintClient, attach
from printctl.machine.process.clients.starting import resume_print, start_print
from printctl.machine.process.contact import alive
from printctl.machine.process.orders import Order
from printctl.machine.records.actor import ACTOR, this_user
from printctl.machine.records.journal import read_records
from printctl.machine.records.lab_key import lab_key
from printctl.machine.records.record import JOURNAL
from printctl.machine.records.replay import read_journal
from printctl.machine.records.sealing import Finding, check_journal_file
from printctl.machine.records.states import LinkState
from printctl.progress import StageBars
from tests.printctl.machine.link.fake_marlin import FakeMarlin, PtyPrinter, pty_printer, write_job
from tests.printctl.machine.link.jobs import parse_job
from tests.printctl.machine.link.layered import layered
from tests.printctl.machine.link.looking import patch
from tests.waiting import wait_for


def handshake_and(printer: FakeMarlin) -> list[str]:
    return printer.numbered[printer.numbered.index("M84 S0") + 1 :]


def assert_all_sent_once(sent: list[str], lines: list[str]) -> None:
    """In order; its modes are set again where a dead host is gone on from."""
    modes = ("G90", "M82")
    written = {line for line in lines if line not in modes}
    assert [line for line in sent if line in written] == [
        line for line in lines if line not in modes
    ]


def until(client, state: LinkState) -> None:
    for status in client.events():
        if status.state is state:
            return
    raise AssertionError(f"never {state}")


@contextmanager
def held_print(folder: Path, profile: str) -> Iterator[tuple[list[str], PtyPrinter, PrintClient]]:
    """A print whose printer holds its answers back from line 100 on, until its gate is set."""
    lines = write_job(folder / "job.gcode", 400)
    with pty_printer(FakeMarlin(), hold_at=100) as served:
        client = start_print(Order(folder / "job.gcode", profile, served.name, folder / "run"))
        assert served.held.wait(10)
        yield lines, served, client


def test_prints_a_whole_job_and_ends_by_itself(tmp_path, profile):
    lines = write_job(tmp_path / "job.gcode", 500)
    with pty_printer(FakeMarlin()) as served:
        client = start_print(Order(tmp_path / "job.gcode", profile, served.name, tmp_path / "run"))
        outcome = client.wait(300)
        assert outcome.state is LinkState.DONE
        assert outcome.lines_done == len(lines)
        assert handshake_and(served.printer)[: len(lines)] == lines
        assert attach(tmp_path / "run").wait().state is LinkState.DONE
        with pytest.raises(LinkError, match=r"has ended .*print it anew"):
            resume_print(tmp_path / "run")
    wait_for(lambda: not alive(tmp_path / "run"))
    assert not (tmp_path / "run" / "link.sock").exists()


def test_unplugged_port_fails_with_what_was_acknowledged_and_goes_on_when_it_is_back(
    tmp_path, profile
):
    lines, printer = write_job(tmp_path / "job.gcode", 500), FakeMarlin()
    with pty_printer(printer, unplug_at=200) as served:
        client = start_print(Order(tmp_path / "job.gcode", profile, served.name, tmp_path / "run"))
        outcome = client.wait(300)
    assert outcome.state is LinkState.FAILED
    assert outcome.error == "PortLost"
    assert not outcome.position_known
    assert 198 <= outcome.lines_done <= 200
    assert f"{outcome.lines_done} of {len(lines)} lines were acknowledged" in outcome.message
    assert "if powered, its motors execute the queued moves" in outcome.message
    assert "the needle wasn't lifted" in outcome.message
    with pty_printer(printer) as served:
        outcome = resume_print(tmp_path / "run", served.name).wait(300)
    assert outcome.state is LinkState.DONE
    assert_all_sent_once(handshake_and(printer), lines)


def test_second_print_in_the_folder_or_on_the_port_is_refused(tmp_path, profile, monkeypatch):
    monkeypatch.setattr(contact, "_ENDING_S", 0.1)
    with held_print(tmp_path, profile) as (_, served, client):
        client.pause()
        served.gate.set()
        until(client, LinkState.PAUSED)
        with pytest.raises(AlreadyPrinting, match="attach"):
            start_print(Order(tmp_path / "job.gcode", profile, served.name, tmp_path / "run"))
        with pytest.raises(PortInUse, match="held by printctl itself"):
            start_print(Order(tmp_path / "job.gcode", profile, served.name, tmp_path / "other"))
        assert client.command("M105")[0].startswith("ok T:")
        client.resume()
        assert client.wait(300).state is LinkState.DONE


def test_journal_says_who_asked_for_what_and_is_signed_at_the_end(tmp_path, profile):
    with held_print(tmp_path, profile) as (_, served, client):
        client.pause()
        served.gate.set()
        until(client, LinkState.PAUSED)
        by = ACTOR.set({"who": "Grace", "from": "page, Chrome at 192.168.1.7 (4f2)"})
        client.resume()
        client.stop()
        ACTOR.reset(by)
        client.wait(300)
    wait_for(lambda: not alive(client.folder))
    records = [one for one in read_records(client.folder / JOURNAL) if one["t"] == "action"]
    asked = [(one["do"], one["who"], one["from"]) for one in records]
    me, page = this_user()["who"], "page, Chrome at 192.168.1.7 (4f2)"
    assert [one[:2] for one in asked[:2]] == [("start", me), ("pause", me)]
    assert all(one[2].endswith(f" {os.getpid()}") for one in asked[:2])
    assert asked[2:] == [("resume", "Grace", page), ("stop", "Grace", page)]
    assert check_journal_file(client.folder / JOURNAL, [lab_key().public]).finding is Finding.SIGNED


def test_kill_halts_the_firmware_while_the_stream_is_blocked(tmp_path, profile):
    with held_print(tmp_path, profile) as (_, served, client):
        client.kill()
        time.sleep(0.05)
        served.gate.set()
        outcome = client.wait(300)
    assert served.printer.halted
    assert outcome.state is LinkState.KILLED
    assert "confirmed the halt" in outcome.message


def test_print_goes_on_when_its_client_is_killed(tmp_path, profile):
    lines = write_job(tmp_path / "job.gcode", 2000)
    script = (
        "import sys; from pathlib import Path\n"
        "from printctl.machine.process.clients.starting import start_print\n"
        "from printctl.machine.process.orders import Order\n"
        f"start_print(Order(Path({str(tmp_path / 'job.gcode')!r}), {profile!r}, sys.argv[1], "
        f"Path({str(tmp_path / 'run')!r})))\n"
        "print('up', flush=True)\n"
        "import time; time.sleep(60)\n"
    )
    with pty_printer(FakeMarlin()) as served:
        with subprocess.Popen(
            [sys.executable, "-c", script, served.name], stdout=subprocess.PIPE
        ) as client:
            assert client.stdout is not None
            assert client.stdout.readline() == b"up\n"
            client.send_signal(signal.SIGKILL)
        served.gate.set()
        outcome = attach(tmp_path / "run").wait(300)
        assert outcome.state is LinkState.DONE
        assert handshake_and(served.printer)[: len(lines)] == lines


def test_killed_link_process_leaves_a_journal_that_the_next_command_goes_on_from(tmp_path, profile):
    with held_print(tmp_path, profile) as (lines, served, client):
        for status in client.events():
            if status.lines_done > 50:
                break
        # The status that a new client is told first may be some tenths of a second ahead.
        journal = tmp_path / "run" / "journal.log"
        wait_for(lambda: read_journal(journal).done > 50)
        os.kill(client.record.pid, signal.SIGKILL)
        outcome = client.wait(10)
        assert outcome.state is LinkState.INTERRUPTED
        assert "unexpectedly" in outcome.message
        at_least = read_journal(journal).done
        assert 50 < at_least <= served.printer.last
        known = attach(tmp_path / "run").status
        with pytest.raises(PortMissing, match="doesn't exist"):
            resume_print(tmp_path / "run", "/dev/nowhere")
        told = attach(tmp_path / "run").status  # an attempt without a port erases nothing
        assert told == replace(known, message=told.message)
        assert told.message.startswith(known.message)
        assert "/dev/nowhere doesn't exist" in told.message
        assert attach(tmp_path / "run").record.port == served.name
        served.gate.set()
        again = start_print(
            Order(tmp_path / "job.gcode", profile, served.name, tmp_path / "run", resume=True)
        )
        assert again.wait(300).state is LinkState.DONE
        sent = handshake_and(served.printer)
    assert_all_sent_once(sent, lines)


@pytest.mark.parametrize(
    ("signs", "state"),
    [([signal.SIGTERM], LinkState.STOPPED), ([signal.SIGINT, signal.SIGHUP], LinkState.DONE)],
)
def test_shutdown_of_the_system_is_a_controlled_stop_and_hang_ups_are_nothing(
    tmp_path, profile, signs, state
):
    with held_print(tmp_path, profile) as (_, served, client):
        for sign in signs:
            os.kill(client.record.pid, sign)
        served.gate.set()
        outcome = client.wait(300)
        assert outcome.state is state
        assert state is LinkState.DONE or "cancelled by the system" in outcome.message
        assert state is LinkState.DONE or served.printer.numbered[-1] == "M400"


# --- Ctrl-C before the first lines: before the process listens, and while the printer is silent
@pytest.fixture(params=["spawned", "connecting"])
def ctrl_c(request, monkeypatch):
    """Ctrl-C at a moment of `start_print`."""
    name = "spawn" if request.param == "spawned" else "wait_for_first_lines"
    real, pressed = getattr(starting, name), []

    def press(*given):
        found = real(*given) if name == "spawn" else None
        if not pressed:
            pressed.append(True)
            signal.raise_signal(signal.SIGINT)
        return found or real(*given)

    monkeypatch.setattr(starting, name, press)
    before = signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell's "&" ignores it
    yield pressed
    signal.signal(signal.SIGINT, before)


def test_print_whose_start_is_interrupted_is_stopped_before_its_first_line(
    tmp_path, profile, ctrl_c
):
    write_job(tmp_path / "job.gcode", 50)
    printer = FakeMarlin()
    printer.mute = True
    with pty_printer(printer) as served:
        with pytest.raises(KeyboardInterrupt):
            start_print(Order(tmp_path / "job.gcode", profile, served.name, tmp_path / "run"))
        outcome = attach(tmp_path / "run").wait(60)
    assert ctrl_c
    assert outcome.state is LinkState.STOPPED
    assert "before the first line" in outcome.message
    assert not printer.numbered


@pytest.mark.parametrize(
    ("word", "state"), [("s", LinkState.STOPPED), ("k", LinkState.KILLED), ("", LinkState.DONE)]
)
def test_ctrl_c_before_the_first_lines_asks(tmp_path, profile, ctrl_c, monkeypatch, word, state):
    write_job(tmp_path / "job.gcode", 50)
    printer = FakeMarlin()
    printer.mute = bool(word)
    monkeypatch.setattr(sys.stdin, "isatty", lambda: True)
    monkeypatch.setattr(follow, "_ask", lambda bars: word)
    with pty_printer(printer) as served:
        client = start_print(
            Order(tmp_path / "job.gcode", profile, served.name, tmp_path / "run"),
            on_interrupt=follow.interrupted(StageBars(Console(quiet=True))),
        )
        outcome = client.wait(60)
    assert ctrl_c
    assert outcome.state is state


def test_client_that_never_reads_holds_nobody_up(tmp_path, profile):
    # Subscribed by `attach`; reads nothing.
    with held_print(tmp_path, profile) as (_, served, client), attach(tmp_path / "run"):
        served.gate.set()
        assert client.wait(300).state is LinkState.DONE


def test_folder_with_a_long_path_still_has_its_socket(tmp_path, profile):
    folder = tmp_path / ("deep" * 20) / ("deeper" * 10)
    write_job(tmp_path / "job.gcode", 20)
    with pty_printer(FakeMarlin()) as served:
        client = start_print(Order(tmp_path / "job.gcode", profile, served.name, folder))
        assert client.wait(300).state is LinkState.DONE
        assert attach(folder).status.state is LinkState.DONE


def test_client_whose_connection_broke_finds_the_print_again(tmp_path, profile):
    with held_print(tmp_path, profile) as (_, served, client):
        client._stream.socket.shutdown(socket.SHUT_RDWR)
        client.stop()
        served.gate.set()
        assert client.wait(300).state is LinkState.STOPPED


def test_link_process_that_dies_at_once_is_told_with_its_last_words(tmp_path, profile):
    write_job(tmp_path / "job.gcode", 20)
    (tmp_path / "run" / "link.json").mkdir(parents=True)
    with pytest.raises(LinkError, match=r"ended at once: .*can't be written to: Is a directory"):
        start_print(Order(tmp_path / "job.gcode", profile, "/dev/nowhere", tmp_path / "run"))


def test_process_that_dies_on_a_full_disk_names_the_disk(tmp_path, monkeypatch):
    """Its log has the words of an earlier one."""
    log = tmp_path / "link.log"
    log.write_text("of yesterday\n")
    monkeypatch.setattr(launch.shutil, "disk_usage", lambda path: SimpleNamespace(free=0))
    gone = subprocess.run([sys.executable, "-c", "import os; print(os.getpid())"], capture_output=1)
    with pytest.raises(LinkError, match=f"the disk of {tmp_path} is full; free space"):
        launch.await_process(int(gone.stdout), "link process", lambda: None, log, 10.0)


# --- looks of a link process over a real pseudo-terminal, killed by kill -9 with an insert taken
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
        client = start_print(Order(job, profile, served.name, run, care=care))
        look(client, 1)
        with pytest.raises(Refused, match="G28 can't be injected"):
            client.insert(1, ["G28"])
        answer = client.insert(1, lines, "a gap")
        os.kill(client.record.pid, signal.SIGKILL)
        client.wait(300)
        client = resume_print(run, served.name)
        held = look(client, 1)
        assert (held["inserted"], held["insert_sha256"]) == (11, answer["sha256"])
        assert client.insert(1, lines, "a gap") == answer
        with pytest.raises(Refused, match="has injected G-code of 11 lines already"):
            client.insert(1, lines[:3])
        client.decide(1, LookDecision.GO_ON)
        look(client, 2)
        assert client.decide(1, LookDecision.GO_ON)["decision"] == "go_on"
        client.decide(2, LookDecision.GO_ON)
        assert client.wait(300).state is LinkState.DONE
    grown = parse_job(data, "a").grown_by(read_journal(run / "journal.log").inserts)
    assert with_x(served.printer.numbered) == with_x(line.decode() for line in grown.lines)


def test_a_look_that_was_heard_before_is_told_again(tmp_path, profile):
    """`start_print` waits for the first lines, and may hear of the first look in doing so."""
    job, run = tmp_path / "job.gcode", tmp_path / "run"
    job.write_bytes(layered(1, 6))
    care = Care(checkpoint_s=None, look_after=MarkKind.LAYER, look_limit_s=5)
    with pty_printer(FakeMarlin()) as served:
        client = start_print(Order(job, profile, served.name, run, care=care))
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


# --- another program that has the printer's serial port open, over a real pseudo-terminal
THIEF = """
import os, sys
port = os.open(sys.argv[1], os.O_RDWR | os.O_NOCTTY)
print("open", flush=True)
sys.stdin.readline()
taken = 0
while taken < 3:
    taken += bool(os.read(port, 4096))
sys.stdin.readline()
"""


@contextmanager
def thief(port: str) -> Iterator[subprocess.Popen[str]]:
    """Open the port in another process; it takes three answers once told to."""
    command = [sys.executable, "-c", THIEF, port]
    pipe = subprocess.PIPE
    with subprocess.Popen(command, stdin=pipe, stdout=pipe, text=True) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == "open\n"
        yield process
        process.kill()


def tell(process: subprocess.Popen[str]) -> None:
    assert process.stdin is not None
    process.stdin.write("\n")
    process.stdin.flush()


@pytest.mark.skipif(sys.platform != "linux", reason="programs are looked for on Linux")
def test_program_that_reads_the_port_is_named_and_the_print_paused_once(tmp_path, profile):
    write_job(tmp_path / "job.gcode", 140)
    with pty_printer(FakeMarlin(), pace_s=0.02) as served, thief(served.name) as process:
        run = tmp_path / "run"
        client = start_print(Order(tmp_path / "job.gcode", profile, served.name, run))
        pauses: list[str] = []
        told = False
        for status in client.events():
            if status.lines_done > 50 and not told:
                told = True
                tell(process)
            if status.state is LinkState.PAUSED:
                pauses.append(status.message)
                client.resume()
        outcome = client.wait(300)
    name = f"pid {process.pid}) has this port open"
    assert outcome.state is LinkState.DONE
    assert len(pauses) == 1
    assert name in pauses[0]
    assert any(name in text for text in read_journal(run / "journal.log").alarms)
