"""Prints on a host through the print's own process, killed and run again; what is refused."""

from __future__ import annotations

import os
import signal
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import pytest

from firmware_profiles import Printer, load
from printctl.errors import PrintctlError
from printctl.machine.errors import LinkError, Refused
from printctl.machine.job.care import Care
from printctl.machine.network import http_client
from printctl.machine.network.hosts import refuse_unsupported
from printctl.machine.prints.give_up import give_up
from printctl.machine.prints.recovery_file import planned
from printctl.machine.prints.state import PrintAction, read_print, running_print
from printctl.machine.process import host_print
from printctl.machine.process.clients.client import attach
from printctl.machine.process.clients.starting import connect, find_or_start
from printctl.machine.process.orders import Order
from printctl.machine.records.record import load_record
from printctl.machine.records.states import LinkState
from tests.printctl.machine.network.boards import JOB, PROFILE, BoardServer


@pytest.fixture
def server(tmp_path: Path):
    board = BoardServer(tmp_path / "card", password="hush")
    yield board
    board.board.status = "halted"
    board.down()


@pytest.fixture
def order(tmp_path: Path, server: BoardServer, monkeypatch: pytest.MonkeyPatch) -> Order:
    monkeypatch.setenv("PRINTCTL_DATA", str(tmp_path / "data"))
    (tmp_path / "key").write_text("hush")
    monkeypatch.setenv("PRINTCTL_HOST_KEY_FILE", str(tmp_path / "key"))
    job = tmp_path / "job.gcode"
    job.write_text(JOB.replace("F1200", "F240").rstrip())
    return Order(job, PROFILE, server.port, tmp_path / "job.print", once=True)


def wait(condition: Callable[[], bool], within_s: float = 30.0) -> None:
    limit = time.monotonic() + within_s
    while not condition():
        assert time.monotonic() < limit
        time.sleep(0.02)


def test_killed_process_that_is_run_again_follows_the_same_print(
    order: Order, server: BoardServer, monkeypatch: pytest.MonkeyPatch
):
    client = find_or_start(order, lambda: order.port)
    wait(lambda: bool(server.strokes()))
    server.board.code("M25")  # somebody pauses it at the host
    os.kill(load_record(order.folder).pid, signal.SIGKILL)
    client.wait(20.0)
    truth = read_print(order.folder)
    assert truth.status.state is LinkState.INTERRUPTED
    assert "without starting anything twice" in truth.status.message
    assert truth.may(PrintAction.GO_ON).possible
    assert not truth.may(PrintAction.RECOVER).possible
    monkeypatch.delenv("PRINTCTL_HOST_KEY_FILE")  # the record has the file's name
    again = find_or_start(order, lambda: order.port)
    with pytest.raises(Refused, match="runs the file by itself"):
        again.reload()
    wait(lambda: again.status.state is LinkState.PAUSED)
    again.resume()
    assert again.wait(30.0).state is LinkState.DONE
    lines = server.board.run_lines
    assert lines.count("G92 X10 Y10 Z5") == 1
    (stored,) = server.folder.glob("printctl-*")
    assert stored.read_bytes().endswith(b"\n")  # Klipper leaves out a last line without it
    assert len(server.strokes()) == len(set(server.strokes())) == 4
    assert find_or_start(order, lambda: order.port).status.state is LinkState.DONE  # once
    kept = b"".join(path.read_bytes() for path in order.folder.iterdir() if path.is_file())
    assert b"hush" not in kept


def test_kill_reaches_the_host_when_the_process_is_gone(order: Order, server: BoardServer):
    with find_or_start(order, lambda: order.port):
        wait(lambda: bool(server.strokes()))
        os.kill(load_record(order.folder).pid, signal.SIGKILL)
    with attach(order.folder) as client:
        wait(lambda: client.status.ended)
        client.kill()
        status = client.status
    assert server.board.status == "halted"
    assert status.state is LinkState.KILLED
    with pytest.raises(PrintctlError, match="ran the file by itself"):
        planned(order.folder)


def interrupted(order: Order, server: BoardServer, ready: Callable[[], bool]) -> None:
    """Kill a print's process once something has happened; the host prints no more."""
    with find_or_start(order, lambda: order.port) as client:
        wait(ready)
        os.kill(load_record(order.folder).pid, signal.SIGKILL)
        assert client.wait(20.0).state is LinkState.INTERRUPTED


def other_print(server: BoardServer) -> None:
    """Have another client's file printed, once ours is over."""
    server.reset()
    (server.folder / "other.gcode").write_text("G1 X99 F6\n")
    server.board.code('M32 "other.gcode"')


def test_kill_of_an_old_run_leaves_another_print_alone(order: Order, server: BoardServer):
    interrupted(order, server, lambda: bool(server.strokes()))
    other_print(server)
    with attach(order.folder) as client, pytest.raises(Refused, match=r"runs other\.gcode"):
        client.kill()
    assert server.board.status == "processing"
    server.board.status, server.board.begun_s = "idle", 0.0
    with attach(order.folder) as client:
        client.kill()
    assert server.board.status == "halted"


def test_kill_of_a_run_whose_host_says_nothing_goes_out(
    order: Order, server: BoardServer, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr(host_print, "ASK_S", 0.1)
    monkeypatch.setattr(http_client, "ANSWER_S", 0.2)
    interrupted(order, server, lambda: bool(server.strokes()))
    server.faults.hang = "rr_model"
    with attach(order.folder) as client:
        threading.Timer(1.0, lambda: setattr(server.faults, "hang", "")).start()
        with suppress(LinkError):
            client.kill()
    assert server.board.status == "halted"


def test_kill_of_an_ended_run_halts_its_own_file_alone(order: Order, server: BoardServer):
    with find_or_start(order, lambda: order.port) as client:
        assert client.wait(30.0).state is LinkState.DONE
    wait(lambda: bool(load_record(order.folder).status))
    with attach(order.folder) as client, pytest.raises(Refused, match="the print is done"):
        client.kill()
    assert server.board.status == "idle"
    (stored,) = server.folder.glob("printctl-*")
    server.board.code(f'M32 "{stored.name}"')
    with attach(order.folder) as client:
        client.kill()
    assert server.board.status == "halted"


def test_stop_of_an_interrupted_run_names_the_way(order: Order, server: BoardServer):
    interrupted(order, server, lambda: bool(server.strokes()))
    with pytest.raises(PrintctlError, match=r"`printctl resume .*job\.print` takes it up again"):
        running_print(order.folder)


@pytest.mark.parametrize("end", ["kill", "give_up"])
@pytest.mark.parametrize("selected", [True, False])
def test_an_end_from_outside_voids_a_start_that_may_come(
    order: Order, server: BoardServer, end: str, selected: bool
):
    server.faults.drop = "M32"

    def begin() -> None:
        with suppress(LinkError):
            find_or_start(order, lambda: order.port)

    beginning = threading.Thread(target=begin)
    beginning.start()
    wait(lambda: server.count("M32") > 0)
    os.kill(load_record(order.folder).pid, signal.SIGKILL)
    beginning.join()
    (stored,) = server.folder.glob("printctl-*")
    if not selected:
        server.reset()
    if end == "kill":
        with attach(order.folder) as client:
            client.kill()
            status = client.status
    else:
        status = give_up(order.folder, "me")
    words = f"a start of {stored.name} may still come; delete it on the host"
    assert (words in status.message) is selected  # the board deletes no selected file
    assert stored.exists() is selected


def test_what_a_host_cant_do_is_refused_before_anything_is_sent(order: Order, server: BoardServer):
    care = Care(reload_at=(3,), deadman_s=60.0, look_every_s=5.0)
    with pytest.raises(Refused) as refused:
        find_or_start(replace(order, care=care), lambda: order.port)
    for what in ("inspection", "syringe", "dead-man"):
        assert what in str(refused.value)
    assert not server.faults.asked
    with pytest.raises(Refused, match="check the port"):
        refuse_unsupported("moonraker", load(Printer, PROFILE), Care(), None, 0.0)


def test_a_station_behind_a_host_is_refused(order: Order, tmp_path: Path):
    with pytest.raises(Refused, match="no station"):
        connect(PROFILE, order.port, tmp_path / "station")


def test_wrong_key_is_said(order: Order, tmp_path: Path):
    (tmp_path / "key").write_text("wrong")
    with pytest.raises(LinkError, match="password") as refused:
        find_or_start(order, lambda: order.port)
    assert "wrong" not in str(refused.value)


def test_kill_asks_a_slow_host_once_and_leaves_another_print_alone(
    order: Order, server: BoardServer, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr(host_print, "ASK_S", 1.0)
    interrupted(order, server, lambda: bool(server.strokes()))
    other_print(server)
    server.faults.meanwhile = lambda path: time.sleep(0.6)  # two logins and a question
    with attach(order.folder) as client, pytest.raises(Refused, match=r"runs other\.gcode"):
        client.kill()
    assert server.board.status == "processing"
