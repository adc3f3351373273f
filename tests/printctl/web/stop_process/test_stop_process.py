"""Emergency stop: reaches the printer whatever the server does."""

import asyncio
import json
import os
import signal
import socket
import subprocess
import sys
import time
import urllib.error
import urllib.request
from collections.abc import Callable, Iterator
from contextlib import ExitStack, suppress
from dataclasses import asdict
from email.message import Message
from pathlib import Path
from urllib.parse import urlsplit

import pytest

from firmware_profiles import Printer, load
from printctl.machine.control.board.halting import halting_of
from printctl.machine.process.socket_server import listen
from printctl.web.print_sockets import PATIENCE_S, PrintSockets
from printctl.web.security.access import LIFETIME_S, STOP_GRACE_S, Access, make_access
from printctl.web.settings import ServeSettings
from printctl.web.workspace import Workspace
from tests.printctl.web.printing import UnderWay, ended_by_kill, soon, under_way
from tests.printctl.web.serving import ROOT, Process, server_process, session_cookie

resource = pytest.importorskip("resource")
pytestmark = pytest.mark.skipif(not hasattr(os, "openpty"), reason="no pseudo-terminals here")


def ask(url: str, method: str = "POST", **headers: str) -> tuple[int, list[dict], Message]:
    request = urllib.request.Request(url, method=method, headers=headers, data=None)
    try:
        with urllib.request.urlopen(request, timeout=10) as answer:
            text, status, said = answer.read().decode(), answer.status, answer.headers
    except urllib.error.HTTPError as exc:
        text, status, said = exc.read().decode(), exc.code, exc.headers
    return status, [json.loads(line) for line in text.splitlines() if line], said


def by_token(server: Process) -> dict[str, str]:
    return {"Authorization": f"Bearer {server.token}"}


def by_cookie(server: Process, workspace: Path, age_s: float = 0.0) -> dict[str, str]:
    port = urlsplit(server.url).port
    access = make_access(ServeSettings(workspace), Workspace(workspace), port)
    return {**session_cookie(access, age_s), "Origin": server.url}


def connected(server: Process) -> int:
    _, said, _ = ask(server.stop.replace("/stop", "/alive"), "GET", **by_token(server))
    return int(said[0]["connected"])


@pytest.fixture(scope="module")
def served(tmp_path_factory: pytest.TempPathFactory) -> tuple[Process, Path]:
    workspace = tmp_path_factory.mktemp("serve") / "workspace"
    with server_process(workspace) as server:
        yield server, workspace


def test_a_stop_reaches_the_printer_while_the_server_hangs(served: tuple[Process, Path]) -> None:
    server, workspace = served
    with under_way(workspace, "hanging") as print_:
        assert soon(lambda: connected(server) == 1)
        server.halt()
        try:
            status, said, headers = ask(server.stop, **by_cookie(server, workspace))
        finally:
            server.go_on()
        assert status == 200
        assert headers["Access-Control-Allow-Origin"] == server.url
        assert [one["folder"] for one in said[0]["sent"]] == [str(print_.folder)]
        assert said[1]["outcome"][0]["state"] == "killed"
        assert "M112 left the host after" in said[1]["outcome"][0]["message"]
        journal = (print_.folder / "journal.log").read_text()
        [asked] = [line for line in journal.splitlines() if '"do":"kill"' in line]
        assert '"from":"page, the emergency stop at 127.0.0.1 (' in asked
        assert ended_by_kill(print_)


def test_a_halt_that_nobody_confirms_says_to_cut_the_power(served: tuple[Process, Path]) -> None:
    server, workspace = served
    with under_way(workspace, "suspended") as print_:
        assert soon(lambda: connected(server) == 1)
        process = json.loads((print_.folder / "link.json").read_text())["pid"]
        os.kill(process, signal.SIGSTOP)
        try:
            _, said, _ = ask(server.stop, **by_token(server))
        finally:
            os.kill(process, signal.SIGCONT)
        assert len(said[0]["sent"]) == 1  # to the process that speaks to the printer, which sleeps
        assert "CUT ITS POWER" in said[1]["outcome"][0]["message"]
        assert ended_by_kill(print_)


def test_an_outcome_is_waited_for_beyond_the_latest_halt() -> None:
    printer = load(Printer, "marlin_avr").model_copy(update={"lines_in_flight": 2})
    first = halting_of(printer, b"M112\n", emergency_parser=True).first
    assert sum(wait_s for _, wait_s in first) + 0.5 < PATIENCE_S


def test_rest_says_it_too(served: tuple[Process, Path]) -> None:
    server, workspace = served
    with under_way(workspace, "asleep") as print_:
        process = json.loads((print_.folder / "link.json").read_text())["pid"]
        os.kill(process, signal.SIGSTOP)
        try:
            _, said, _ = ask(f"{server.url}/api/v1/stop", **by_token(server))
        finally:
            os.kill(process, signal.SIGCONT)
        assert "CUT ITS POWER" in said[0]["message"]
        assert ended_by_kill(print_)


def test_the_server_stops_too_and_finds_a_print_that_just_began(
    served: tuple[Process, Path],
) -> None:
    server, workspace = served
    with under_way(workspace, "fresh") as print_:
        status, said, _ = ask(f"{server.url}/api/v1/stop", **by_token(server))
        assert status == 200
        assert len(said[0]["sent"]) == 1
        assert "CUT" not in said[0]["message"]
        assert ended_by_kill(print_)


def test_with_nothing_to_stop_the_answer_says_so(served: tuple[Process, Path]) -> None:
    server, _ = served
    assert soon(lambda: connected(server) == 0)
    status, said, _ = ask(server.stop, **by_token(server))
    assert (status, said) == (200, [{"sent": []}, {"outcome": []}])


def test_who_may_not_stop_is_refused(served: tuple[Process, Path]) -> None:
    server, workspace = served
    mine = by_cookie(server, workspace)
    assert ask(server.stop)[0] == 401
    assert ask(server.stop, Origin=server.url)[0] == 401
    assert ask(server.stop, Authorization="Bearer no")[0] == 401
    assert ask(server.stop, Cookie=mine["Cookie"])[0] == 401  # no page of ours said so
    for origin in ("http://evil.example", "null", server.url + "0", server.stop[:-5]):
        status, _, headers = ask(server.stop, **{**mine, "Origin": origin})
        assert status == 403
        assert "Access-Control-Allow-Origin" not in headers
    assert ask(server.stop, **{**mine, "Host": "evil.example"})[0] == 421
    old = by_cookie(server, workspace, LIFETIME_S + STOP_GRACE_S + 60)
    assert ask(server.stop, **old)[0] == 401
    assert ask(server.stop.replace("/stop", "/other"), **mine)[0] == 404
    forged = {**mine, "Cookie": mine["Cookie"][:-4] + "0000"}
    assert ask(server.stop, **forged)[0] == 401


def test_a_session_that_just_ended_may_still_stop(served: tuple[Process, Path]) -> None:
    server, workspace = served
    assert ask(server.stop, **by_cookie(server, workspace, LIFETIME_S + 60))[0] == 200


def test_a_crowd_of_idle_connections_and_wrong_tokens_keeps_no_stop_out(
    served: tuple[Process, Path],
) -> None:
    server, workspace = served
    door = urlsplit(server.stop)
    alive = server.stop.replace("/stop", "/alive")
    crowd = []
    try:
        for n in range(400):  # of many addresses and of one; 200 once shut the door
            origin = f"127.0.{1 + n % 3}.{1 + n // 3 % 250}" if n % 2 else "127.0.0.1"
            crowd.append(socket.create_connection((door.hostname, door.port), 10, (origin, 0)))
        for _ in range(20):
            assert ask(alive, "GET", Authorization="Bearer no")[0] == 401
        with under_way(workspace, "crowded") as print_:
            assert soon(lambda: connected(server) == 1)
            server.halt()
            try:
                assert ask(server.stop, **by_cookie(server, workspace))[0] == 200
            finally:
                server.go_on()
            assert ended_by_kill(print_)
        assert soon(lambda: all(is_closed(one) for one in crowd))  # none has shown a session
    finally:
        for one in crowd:
            one.close()


def is_closed(one: socket.socket) -> bool:
    one.settimeout(0.01)
    try:
        return one.recv(1) == b""
    except TimeoutError:
        return False
    except OSError:
        return True


@pytest.mark.parametrize(
    ("sent", "status"),
    [
        (b"hello\r\n\r\n", b"400"),
        (b"POST /stop HTTP/1.1\r\nContent-Length: -1\r\n\r\n", b"400"),
        (b"POST /stop HTTP/1.1\r\nHost: 127.0.0.1\r\nContent-Length: 99999\r\n\r\n", b"401"),
        (b"POST /stop HTTP/1.1\r\nHost\r\n\r\n", b"400"),
        (b"GET / HTTP/1.1\r\n" + b"a: " + b"b" * 20_000 + b"\r\n\r\n", b"400"),
    ],
)
def test_what_isnt_a_request_is_refused_and_the_connection_closed(
    served: tuple[Process, Path], sent: bytes, status: bytes
) -> None:
    door = urlsplit(served[0].stop)
    with socket.create_connection((door.hostname, door.port), 10) as one:
        one.sendall(sent)
        said = b""
        while data := one.recv(4096):
            said += data
    assert said.split(b" ")[1] == status


def test_a_door_that_ends_is_opened_again_where_pages_know_it(
    served: tuple[Process, Path],
) -> None:
    server, _ = served
    door = next(pid for pid in children(server.pid) if "stop_process" in command_of(pid))
    os.kill(door, signal.SIGKILL)
    stranger = socket.socket()
    stranger.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    with stranger:
        assert soon(lambda: took(stranger, urlsplit(server.stop).port or 0))
        stranger.listen()
        time.sleep(1.5)  # as long as the new one takes to begin
    assert soon(lambda: answers(server))


def took(one: socket.socket, port: int) -> bool:
    with suppress(OSError):
        one.bind(("127.0.0.1", port))
        return True
    return False


def test_a_server_behind_one_that_died_has_its_stop_at_the_same_port(tmp_path: Path) -> None:
    workspace = tmp_path / "workspace"
    with server_process(workspace) as first, under_way(workspace) as print_:
        assert soon(lambda: connected(first) == 1)
        first.process.kill()
        first.process.wait()
        assert answers(first)  # for the print's sake
        port = str(urlsplit(first.url).port)
        with server_process(workspace, "--port", port) as second:
            assert second.stop == first.stop
            assert soon(lambda: connected(second) == 1)
            assert ask(second.stop, **by_token(second))[0] == 200
            assert ended_by_kill(print_)


def test_a_server_that_is_told_to_end_or_killed_leaves_the_print_alone(
    served: tuple[Process, Path],
) -> None:
    """The last test here: it ends the server of the others."""
    server, workspace = served
    with under_way(workspace) as print_:
        before = print_.client.status.lines_done
        server.process.send_signal(signal.SIGINT)
        assert server.process.wait(10) == 0
        assert not answers(server)
        assert not (workspace / ".printctl" / "serve.json").exists()
        assert soon(lambda: print_.client.status.lines_done > before)
        with server_process(workspace) as again:
            assert soon(lambda: connected(again) == 1)
            _killed_leaves_its_door(again, print_)


def _killed_leaves_its_door(server: Process, print_: UnderWay) -> None:
    server.process.kill()
    server.process.wait()
    assert not print_.client.status.ended
    assert ask(server.stop, **by_token(server))[0] == 200
    assert ended_by_kill(print_)
    assert soon(lambda: not answers(server))


def answers(server: Process) -> bool:
    try:
        return ask(server.stop.replace("/stop", "/alive"), "GET", **by_token(server))[0] == 200
    except OSError:
        return False


def children(pid: int) -> list[int]:
    return [int(one) for one in Path(f"/proc/{pid}/task/{pid}/children").read_text().split()]


def command_of(pid: int) -> str:
    return Path(f"/proc/{pid}/cmdline").read_text()


FILES = 64
Connect = Callable[[str], socket.socket]


@pytest.fixture
def alone(tmp_path: Path) -> Iterator[tuple[Connect, Access]]:
    """Start a stop process of few files; give what connects to it from an address."""
    access = make_access(ServeSettings(tmp_path), Workspace(tmp_path).make(), 8080)
    order = {"root": str(tmp_path), "host": "127.0.0.1", "port": 0, "cert": "", "key": ""}
    with (
        subprocess.Popen(
            [sys.executable, "-m", "printctl.web.serving.stop_process"],
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
    while not heard.endswith(b"}"):
        heard += (data := one.recv(4096))
        if not data:
            return False
    return b'"ready"' in heard


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
