"""A local door beside a crowd: who comes in, who leaves, and that no file handle is needed."""

from __future__ import annotations

import json
import os
import socket
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

import pytest

from printctl.link.door import listen
from printctl.link.door_places import MOST_GUESTS
from printctl.link.server import Server, forget
from printctl.link.states import LinkState, Status
from tests.printctl.link.test_server import Spy, hear, say

resource = pytest.importorskip("resource")
pytestmark = pytest.mark.skipif(not hasattr(socket, "AF_UNIX"), reason="no Unix sockets here")


class CountingListener(socket.socket):
    """Counts how often it was asked for a connection."""

    asked = 0

    def accept(self) -> tuple[socket.socket, object]:
        self.asked += 1
        return super().accept()


@pytest.fixture
def open_door(tmp_path: Path) -> Iterator[tuple[Spy, Server, CountingListener, str]]:
    plain, address, token = listen(tmp_path)
    listener = CountingListener(fileno=plain.detach())
    spy = Spy()
    server = Server(listener, token, spy)  # type: ignore[arg-type]
    server.start()
    yield spy, server, listener, address.removeprefix("unix:")
    server.finish()
    forget(address)


def client(stack: ExitStack) -> socket.socket:
    one = stack.enter_context(socket.socket(socket.AF_UNIX))
    one.settimeout(5)
    return one


@contextmanager
def no_handle_left() -> Iterator[None]:
    """Let this process open no further file; what was open stays so."""
    soft, most = resource.getrlimit(resource.RLIMIT_NOFILE)
    with ExitStack() as stack:
        last = 0
        for _ in range(64):  # whatever was free below is taken
            last = os.open(os.devnull, os.O_RDONLY)
            stack.callback(os.close, last)
        resource.setrlimit(resource.RLIMIT_NOFILE, (last + 1, most))
        try:
            yield
        finally:
            resource.setrlimit(resource.RLIMIT_NOFILE, (soft, most))


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


def test_a_kill_gets_in_where_no_file_handle_is_left(open_door):
    spy, _, listener, path = open_door
    with ExitStack() as stack:
        clients = [client(stack) for _ in range(3)]
        with no_handle_left():
            clients[0].connect(path)
            say(clients[0], do="status")
            assert hear(clients[0])["asked"]
            before = listener.asked
            for one in clients[1:]:
                one.connect(path)
            say(clients[2], do="kill")
            assert spy.killed.wait(5)
        assert listener.asked - before < 50


def test_a_door_that_cant_accept_doesnt_spin(open_door):
    spy, server, listener, path = open_door
    with ExitStack() as stack:
        knocking = client(stack)
        with no_handle_left():
            server.reserve.close()
            stack.callback(os.close, os.open(os.devnull, os.O_RDONLY))
            knocking.connect(path)
            assert not spy.killed.wait(0.6)
            assert 0 < listener.asked < 20
        say(knocking, do="status")
        assert json.loads(knocking.makefile().readline())["asked"]
