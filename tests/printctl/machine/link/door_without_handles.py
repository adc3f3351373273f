"""Command socket without free file handles: run in a process with a lowered limit.

``python -m tests.printctl.machine.link.door_without_handles NAME FOLDER`` runs one of the functions
below.
"""

from __future__ import annotations

import json
import os
import resource
import sys
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

from tests.printctl.machine.link.test_server import client, crowded_door, hear, say


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


def a_kill_gets_in(folder: Path) -> None:
    with ExitStack() as stack:
        spy, _, listener, path = stack.enter_context(crowded_door(folder))
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


def a_door_that_cant_accept_doesnt_spin(folder: Path) -> None:
    with ExitStack() as stack:
        spy, server, listener, path = stack.enter_context(crowded_door(folder))
        knocking = client(stack)
        with no_handle_left():
            server.reserve.close()
            stack.callback(os.close, os.open(os.devnull, os.O_RDONLY))
            knocking.connect(path)
            assert not spy.killed.wait(0.6)
            assert 0 < listener.asked < 20
        say(knocking, do="status")
        assert json.loads(knocking.makefile().readline())["asked"]


if __name__ == "__main__":
    globals()[sys.argv[1]](Path(sys.argv[2]))
