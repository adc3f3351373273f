"""Stop process alone: its places for connections, and whom a kill goes to."""

from __future__ import annotations

import asyncio
import json
import socket
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from dataclasses import asdict
from pathlib import Path

import pytest

from printctl.machine.link.command_socket import listen
from printctl.web.print_sockets import PrintSockets
from printctl.web.security.access import Access, make_access
from printctl.web.settings import ServeSettings
from printctl.web.workspace import Workspace
from tests.printctl.web.serving import ROOT

resource = pytest.importorskip("resource")
FILES = 64
Connect = Callable[[str], socket.socket]


@pytest.fixture
def alone(tmp_path: Path) -> Iterator[tuple[Connect, Access]]:
    """Give what connects to a stop process of few files from an address."""
    access = make_access(ServeSettings(tmp_path), Workspace(tmp_path).make(), 8080)
    order = {"root": str(tmp_path), "host": "127.0.0.1", "port": 0, "cert": "", "key": ""}
    with (
        subprocess.Popen(
            [sys.executable, "-m", "printctl.web.stop_process"],
            cwd=ROOT,
            text=True,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_NOFILE, (FILES, FILES)),
        ) as process,
        ExitStack() as opened,
    ):
        assert process.stdin
        assert process.stdout
        process.stdin.write(json.dumps({**order, "access": asdict(access)}) + "\n")
        process.stdin.flush()
        port = json.loads(process.stdout.readline())["port"]

        def came(address: str = "127.0.0.1") -> socket.socket:
            one = socket.create_connection(("127.0.0.1", port), 5, (address, 0))
            return opened.enter_context(one)

        yield came, access
        process.kill()


def answered(one: socket.socket, token: str) -> bool:
    head = f"GET /alive HTTP/1.1\r\nHost: 127.0.0.1\r\nAuthorization: Bearer {token}\r\n\r\n"
    one.sendall(head.encode())
    heard = b""
    while not heard.endswith(b"0\r\n\r\n"):  # the last chunk
        heard += (data := one.recv(4096))
        if not data:
            return False
    return b'"ready"' in heard


def is_closed(one: socket.socket) -> bool:
    one.settimeout(0.5)
    try:
        return one.recv(1) == b""
    except TimeoutError:
        return False
    except ConnectionError:
        return True


def test_the_greediest_address_makes_room_and_who_has_shown_a_token_never(
    alone: tuple[Connect, Access],
) -> None:
    came, access = alone
    mine, other = came("127.0.0.1"), came("127.0.0.2")
    assert answered(mine, access.token)
    crowd = [came("127.0.0.1") for _ in range(2 * FILES)]
    assert answered(came("127.0.0.1"), access.token)
    assert answered(mine, access.token)
    assert is_closed(crowd[0])
    assert not is_closed(crowd[-1])
    assert not is_closed(other)


def _recorded(path: Path, pid: int) -> socket.socket:
    path.parent.mkdir(parents=True)
    listener, address, token = listen(path.parent, "x.sock")
    path.write_text(json.dumps({"pid": pid, "address": address, "token": token}))
    return listener


def test_station_and_its_print_count_as_one_process(tmp_path: Path) -> None:
    kept = [
        _recorded(tmp_path / "station" / "station.json", 7),
        _recorded(tmp_path / "jobs" / "a.print" / "link.json", 7),
        _recorded(tmp_path / "runs" / "b" / "print" / "link.json", 8),
    ]

    async def killed() -> list[int]:
        prints = PrintSockets(tmp_path)
        sent = await prints.kill(0.0)
        follow = asyncio.create_task(prints.follow())
        await asyncio.sleep(0)
        follow.cancel()
        await asyncio.gather(follow, return_exceptions=True)
        return sorted(one.process for one in sent)

    assert asyncio.run(killed()) == [7, 7, 8]
    for one in kept:
        one.close()
