"""Command socket under load: admission, eviction, no free file handle."""

from __future__ import annotations

import socket
import subprocess
import sys
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

import pytest

from printctl.machine.link.command_socket import listen
from printctl.machine.link.server import Server, forget
from printctl.machine.link.socket_clients import MOST_GUESTS
from printctl.machine.link.states import LinkState, Status
from tests.printctl.machine.link.test_server import Spy, hear, say

ROOT = Path(__file__).parents[4]
pytestmark = pytest.mark.skipif(not hasattr(socket, "AF_UNIX"), reason="no Unix sockets here")


class CountingListener(socket.socket):
    """Counts how often it was asked for a connection."""

    asked = 0

    def accept(self) -> tuple[socket.socket, object]:
        self.asked += 1
        return super().accept()


@contextmanager
def crowded_door(folder: Path) -> Iterator[tuple[Spy, Server, CountingListener, str]]:
    plain, address, token = listen(folder)
    listener = CountingListener(fileno=plain.detach())
    spy = Spy()
    server = Server(listener, token, spy)  # type: ignore[arg-type]
    server.start()
    try:
        yield spy, server, listener, address.removeprefix("unix:")
    finally:
        server.finish()
        forget(address)


@pytest.fixture
def open_door(tmp_path: Path) -> Iterator[tuple[Spy, Server, CountingListener, str]]:
    with crowded_door(tmp_path) as opened:
        yield opened


def client(stack: ExitStack) -> socket.socket:
    one = stack.enter_context(socket.socket(socket.AF_UNIX))
    one.settimeout(5)
    return one


def test_a_crowd_that_says_nothing_makes_room_and_who_has_spoken_stays(open_door):
    spy, server, _, path = open_door
    with ExitStack() as stack:
        watching, silent = client(stack), client(stack)
        for one in (watching, silent):
            one.connect(path)
        say(watching, do="subscribe")
        assert hear(watching)["state"] == "printing"
        for _ in range(MOST_GUESTS):
            client(stack).connect(path)
        last = client(stack)
        last.connect(path)
        say(last, do="status")
        assert hear(last)["asked"]
        assert silent.recv(1) == b""  # it was the oldest that had said nothing
        server.publish(Status(LinkState.PAUSED))
        assert hear(watching)["state"] == "paused"
        say(last, do="kill")
        assert spy.killed.wait(5)


def test_a_crowd_of_subscribers_doesnt_keep_a_kill_out(open_door):
    spy, _, _, path = open_door
    with ExitStack() as stack:
        for _ in range(MOST_GUESTS):
            one = client(stack)
            one.connect(path)
            say(one, do="subscribe")
            hear(one)
        last = client(stack)
        last.connect(path)
        say(last, do="kill")
        assert spy.killed.wait(5)


@pytest.mark.parametrize("name", ["a_kill_gets_in", "a_door_that_cant_accept_doesnt_spin"])
def test_a_door_without_file_handles(name: str, tmp_path: Path) -> None:
    pytest.importorskip("resource")
    module = "tests.printctl.machine.link.door_without_handles"
    command = [sys.executable, "-m", module, name, str(tmp_path)]
    ended = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert ended.returncode == 0, ended.stderr
