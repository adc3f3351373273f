"""Addresses, keys, requests and what hosts report, over real sockets."""

from __future__ import annotations

import hashlib
import json
import shutil
import socket
import ssl
import subprocess
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, closing, suppress
from functools import partial
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any

import pytest

from printctl.machine.errors import HostRefused, HostSilent, PortError
from printctl.machine.network.duet import Duet
from printctl.machine.network.host import (
    HostAddress,
    HostReport,
    HostRequest,
    HostState,
    parse_address,
    read_key,
)
from printctl.machine.network.http_client import HttpClient, ReadyConnection
from printctl.machine.network.moonraker import Moonraker, read_state
from printctl.machine.network.octoprint import OctoPrint, read_job
from tests.printctl.machine.network.boards import BoardServer

Answer = Callable[[str, str, bytes], tuple[int, Any]]


class Scripted:
    """A host that answers by a function of method, path and body."""

    def __init__(self) -> None:
        self.answer: Answer = lambda method, path, body: (200, {})
        self.asked: list[tuple[str, str, bytes, dict[str, str]]] = []
        scripted = self

        class Own(BaseHTTPRequestHandler):
            protocol_version = "HTTP/1.1"

            def log_message(self, *about: Any) -> None:
                """Say nothing."""

            def do_GET(self) -> None:
                body = self.rfile.read(int(self.headers.get("Content-Length") or 0))
                scripted.asked.append((self.command, self.path, body, dict(self.headers)))
                status, value = scripted.answer(self.command, self.path, body)
                data = value if isinstance(value, bytes) else json.dumps(value).encode()
                self.send_response(status)
                self.send_header("Content-Length", str(len(data)))
                self.end_headers()
                self.wfile.write(data)

            def do_POST(self) -> None:
                self.do_GET()

        self.server = ThreadingHTTPServer(("127.0.0.1", 0), Own)
        self.server.daemon_threads = True
        threading.Thread(target=self.server.serve_forever, args=(0.01,), daemon=True).start()

    def at(self, kind: str) -> Any:
        return parse_address(f"{kind}://127.0.0.1:{self.server.server_address[1]}")


@pytest.fixture
def scripted() -> Iterator[Scripted]:
    host = Scripted()
    yield host
    host.server.shutdown()
    host.server.server_close()


Opened = Callable[[Any], Any]


@pytest.fixture
def opened() -> Iterator[Opened]:
    with ExitStack() as parting:
        yield lambda one: parting.enter_context(closing(one))


def test_addresses():
    assert parse_address("moonraker://lab") == ("moonraker", "lab", 7125, False)
    assert parse_address("octoprint+https://10.0.0.2/") == ("octoprint", "10.0.0.2", 443, True)
    assert parse_address("duet://[::1]:8080") == ("duet", "::1", 8080, False)
    for given in ("octoprint+https://a:443", "duet://[::1]:80"):
        assert str(parse_address(given)) == given
    for wrong in (
        "duet://",
        "duet+https+https://a",
        "duet://a:99999",
        "moonraker://a/b",
        "http://a",
        "duet://a..b",
        f"duet://{'a' * 64}",
    ):
        with pytest.raises(PortError):
            parse_address(wrong)


def test_key_in_a_port_is_refused_and_not_repeated():
    with pytest.raises(PortError) as refused:
        parse_address("octoprint://me:hush@host")
    assert "hush" not in str(refused.value)


def test_key_comes_from_environment_or_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    file = tmp_path / "key"
    file.write_text("abc\n")
    assert read_key() == ""
    assert read_key(str(file)) == "abc"
    monkeypatch.setenv("PRINTCTL_HOST_KEY", "def")
    assert read_key(str(file)) == "def"
    monkeypatch.delenv("PRINTCTL_HOST_KEY")
    file.write_text("abc def")
    with pytest.raises(PortError) as refused:
        read_key(str(file))
    assert "abc" not in str(refused.value)


def test_silence_says_whether_the_request_may_have_arrived(scripted: Scripted):
    with socket.create_server(("127.0.0.1", 0)) as listener:
        address = parse_address(f"duet://127.0.0.1:{listener.getsockname()[1]}")
        threading.Thread(target=lambda: listener.accept()[0].close(), daemon=True).start()
        with pytest.raises(HostSilent) as silent:
            HttpClient(address).post("/start")
        assert silent.value.sent
    with pytest.raises(HostSilent) as silent:
        HttpClient(address).post("/start")
    assert not silent.value.sent


def test_refusals_have_the_hosts_words_and_no_query(scripted: Scripted, opened: Opened):
    scripted.answer = lambda method, path, body: (400, {"error": {"message": "SD busy"}})
    with pytest.raises(HostRefused, match="SD busy") as refused:
        opened(HttpClient(scripted.at("duet"))).get("/rr_connect?password=hush")
    assert "hush" not in str(refused.value)
    assert refused.value.status == 400
    scripted.answer = lambda method, path, body: (403, {"error": "no"})
    with pytest.raises(HostRefused, match="PRINTCTL_HOST_KEY"):
        opened(HttpClient(scripted.at("duet"))).get("/x")
    scripted.answer = lambda method, path, body: (301, f"Moved to https:/{path}".encode())
    with pytest.raises(HostRefused, match="can't be read") as refused:
        opened(Duet(scripted.at("duet"), "hush")).identify()
    assert "hush" not in str(refused.value)


ODD = ({}, [], None, "x", 7, {"result": None}, {"result": {"status": {"webhooks": []}}})
KINDS = {"moonraker": Moonraker, "octoprint": OctoPrint, "duet": Duet}


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("odd", ODD, ids=repr)
def test_an_odd_answer_is_a_refusal(scripted: Scripted, opened: Opened, kind: str, odd: Any):
    login = {"sessionKey": "s"}
    scripted.answer = lambda method, path, body: (200, login if "connect" in path else odd)
    host = opened(KINDS[kind](scripted.at(kind)))
    found = []
    for ask in (host.identify, lambda: host.state("a"), lambda: host.ended("a")):
        with suppress(HostRefused):
            found.append(ask())
    states = [one.state for one in found if isinstance(one, HostReport)]
    assert all(state is HostState.OFFLINE for state in states)


def test_an_odd_number_is_a_refusal(scripted: Scripted, opened: Opened):
    progress: dict[str, Any] = {}
    job = {"state": "Printing", "job": {"file": {"path": "a"}}, "progress": progress}
    scripted.answer = lambda method, path, body: (200, job)
    host = opened(OctoPrint(scripted.at("octoprint")))
    for key, wrong in (("filepos", "many"), ("filepos", ""), ("filepos", [1]), ("completion", {})):
        progress.clear()
        progress[key] = wrong
        with pytest.raises(HostRefused, match="can't be read"):
            host.state("a")
    nowhere = HostReport(HostState.PRINTING, place=(0.0, float("nan"), 0.0), progress=7.0)
    assert nowhere.without_nonsense(5) == HostReport(HostState.PRINTING)


@pytest.mark.parametrize("status", [200, 409])
def test_a_key_that_the_host_repeats_is_in_no_message(
    scripted: Scripted, opened: Opened, status: int
):
    words: list[str] = []
    answers: list[Any] = [
        {"text": "OctoPrint hush"},
        {"state": "Error: hush", "error": "no hush"},
        {"prints": {"last": {"success": False}, "success": "hush"}},
        ["hush"],
    ]
    for answer in answers:
        scripted.answer = lambda method, path, body, answer=answer: (status, answer)
        host = opened(OctoPrint(scripted.at("octoprint"), "hush"))
        for ask in (host.identify, partial(host.state, "a"), partial(host.ended, "a")):
            try:
                words.append(repr(ask()))
            except HostRefused as exc:
                words.append(str(exc))
    assert any("***" in one for one in words)
    assert not [one for one in words if "hush" in one]


def test_https_to_a_port_without_it_says_what_to_do(scripted: Scripted):
    with pytest.raises(HostSilent, match=r"name it moonraker://, without \+https"):
        HttpClient(scripted.at("moonraker+https")).get("/a")


def test_ready_connection_is_opened_anew_when_the_host_closes_it():
    request = HostRequest("POST", "/stop")
    with socket.create_server(("127.0.0.1", 0)) as listener:
        address = parse_address(f"duet://127.0.0.1:{listener.getsockname()[1]}")
        with closing(ReadyConnection(address)) as ready:
            ready.hold(True)
            listener.accept()[0].close()
            end = listener.accept()[0]

            def answer() -> None:
                assert end.recv(4096).startswith(b"POST /stop")
                end.sendall(b"HTTP/1.1 204 No Content\r\n\r\n")

            time.sleep(0.1)
            thread = threading.Thread(target=answer)
            thread.start()
            assert ready.send(request) == 204
            thread.join()
            end.close()


@pytest.fixture
def encrypted(scripted: Scripted, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> HostAddress:
    """A host behind TLS, whose certificate is its own CA, for the name localhost."""
    if shutil.which("openssl") is None:
        pytest.skip("needs openssl")
    made = (
        "openssl req -x509 -newkey ec -pkeyopt ec_paramgen_curve:P-256 -nodes -days 2 -subj /CN=h"
    )
    files = ["-addext", "subjectAltName=DNS:localhost", "-keyout", "key.pem", "-out", "ca.pem"]
    subprocess.run([*made.split(), *files], cwd=tmp_path, check=True, capture_output=True)
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    context.load_cert_chain(tmp_path / "ca.pem", tmp_path / "key.pem")
    scripted.server.socket = context.wrap_socket(scripted.server.socket, server_side=True)
    monkeypatch.setenv("SSL_CERT_FILE", str(tmp_path / "ca.pem"))
    return parse_address(f"moonraker+https://localhost:{scripted.server.server_address[1]}")


def test_tls_keeps_one_connection_and_halts_by_another(
    encrypted: HostAddress, scripted: Scripted, opened: Opened
):
    client, ready = opened(HttpClient(encrypted)), opened(ReadyConnection(encrypted))
    client.get("/a")
    first = client._connection
    time.sleep(0.1)  # the server's tickets are there by now
    client.get("/b")
    assert client._connection is first
    ready.hold(True)
    time.sleep(0.3)
    kept = ready._socket
    time.sleep(0.2)
    assert kept is ready._socket is not None
    assert ready.send(HostRequest("POST", "/stop")) == 200
    assert [path for _, path, *_ in scripted.asked] == ["/a", "/b", "/stop"]


def test_tls_refuses_a_certificate_that_nobody_vouches_for(
    encrypted: HostAddress, scripted: Scripted, monkeypatch: pytest.MonkeyPatch
):
    other_name = encrypted._replace(host="127.0.0.1")
    with pytest.raises(HostRefused, match="IP address mismatch"):
        HttpClient(other_name).get("/a")
    monkeypatch.delenv("SSL_CERT_FILE")
    with pytest.raises(HostRefused, match="self-signed"):
        HttpClient(encrypted).get("/a")
    with closing(ReadyConnection(encrypted)) as ready, pytest.raises(HostSilent):
        ready.send(HostRequest("POST", "/stop"))
    assert not scripted.asked


def test_no_connection_is_left_open_to_a_host_that_does_not_answer():
    with socket.create_server(("127.0.0.1", 0)) as listener:
        address = parse_address(f"octoprint://127.0.0.1:{listener.getsockname()[1]}")
        with closing(ReadyConnection(address)) as ready:
            ready.hold(True)
            end = listener.accept()[0]
            ready.hold(False)
            end.settimeout(5.0)
            assert end.recv(1) == b""
            end.close()


def test_ready_connection_that_is_dead_is_replaced(
    scripted: Scripted, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr("printctl.machine.network.http_client.READY_ANSWER_S", 0.1)
    with closing(ReadyConnection(scripted.at("duet"))) as ready:
        dead, far = socket.socketpair()
        time.sleep(0.1)
        ready._swap(dead)
        assert ready.send(HostRequest("POST", "/stop")) == 200
        far.close()
    assert [path for _, path, *_ in scripted.asked] == ["/stop"]


READY = {"webhooks": {"state": "ready"}, "toolhead": {"print_time": 1.0, "estimated_print_time": 2}}
MOVING = {**READY, "toolhead": {"print_time": 3.0, "estimated_print_time": 2.0}}
CARD = {"file_path": "/x/a.gcode", "file_position": 5, "file_size": 10, "progress": 0.5}


@pytest.mark.parametrize(
    ("found", "state"),
    [
        ({**READY, "print_stats": {"state": "standby", "filename": ""}}, HostState.IDLE),
        (
            {**READY, "print_stats": {"state": "standby", "filename": "a"}, "virtual_sdcard": CARD},
            HostState.READY,
        ),
        ({**MOVING, "print_stats": {"state": "printing", "filename": "a"}}, HostState.PRINTING),
        ({**MOVING, "print_stats": {"state": "complete", "filename": "a"}}, HostState.FINISHING),
        ({**READY, "print_stats": {"state": "complete", "filename": "a"}}, HostState.COMPLETE),
        ({**MOVING, "print_stats": {"state": "paused", "filename": "a"}}, HostState.PAUSING),
        ({**READY, "print_stats": {"state": "cancelled", "filename": "a"}}, HostState.CANCELLED),
        ({"webhooks": {"state": "shutdown", "state_message": "hot"}}, HostState.HALTED),
        ({"webhooks": {"state": "startup"}}, HostState.OFFLINE),
    ],
)
def test_moonraker_states(found: dict[str, Any], state: HostState):
    assert read_state(found).state is state


def test_moonraker_reports_when_the_file_was_begun(scripted: Scripted, opened: Opened):
    stats = {"state": "printing", "filename": "a", "total_duration": 40.0}
    result = {"eventtime": 100.0, "status": {**MOVING, "print_stats": stats}}
    scripted.answer = lambda method, path, body: (200, {"result": result})
    host = opened(Moonraker(scripted.at("moonraker")))
    assert host.state("a").begun_s == 60.0
    stats["state"] = "complete"
    assert host.state("a").begun_s is None


def test_moonraker_upload_history_and_halt(scripted: Scripted, opened: Opened):
    data = b"G1 X1\n"

    def answer(method: str, path: str, body: bytes) -> tuple[int, Any]:
        if path.startswith("/server/files/gcodes/"):
            return 200, data
        jobs = [
            {"filename": "b", "status": "in_progress", "start_time": 9.0},
            {"filename": "b", "status": "completed", "start_time": 5.0},
            {"filename": "a", "status": "interrupted", "start_time": 1.0},
        ]
        return 200, {"result": {"jobs": jobs, "components": ["history"]}}

    scripted.answer = answer
    host = opened(Moonraker(scripted.at("moonraker"), "k"))
    host.identify()
    host.upload("a.gcode", data, lambda share: None)
    _, path, body, headers = scripted.asked[-1]
    assert path == "/server/files/upload"
    assert data in body
    assert hashlib.sha256(data).hexdigest().encode() in body
    assert headers["X-Api-Key"] == "k"
    assert host.stored("a.gcode", data).sha256 == hashlib.sha256(data).hexdigest()
    assert host.ended("none") is None
    ended = host.ended("a"), host.ended("b")
    assert [(one.state, one.ends) for one in ended] == [(None, 0), (HostState.COMPLETE, 1)]
    assert host.halt_request().path == "/printer/emergency_stop"


def test_moonraker_without_history_is_refused(scripted: Scripted, opened: Opened):
    scripted.answer = lambda method, path, body: (200, {"result": {"components": []}})
    with pytest.raises(HostRefused, match="history"):
        opened(Moonraker(scripted.at("moonraker"))).identify()


@pytest.mark.parametrize(
    ("text", "state"),
    [
        ("Operational", HostState.IDLE),
        ("Printing", HostState.PRINTING),
        ("Starting", HostState.PRINTING),
        ("Paused", HostState.PAUSED),
        ("Offline after error", HostState.OFFLINE),
        ("Error", HostState.OFFLINE),
    ],
)
def test_octoprint_states(text: str, state: HostState):
    assert read_job({"state": text}).state is state


def test_octoprint_tells_selected_from_printed_by_its_record(scripted: Scripted, opened: Opened):
    record: dict[str, Any] = {"size": 3}
    job = {"state": "Operational", "job": {"file": {"path": "a"}}, "progress": {}}
    scripted.answer = lambda method, path, body: (200, job if path == "/api/job" else record)
    host = opened(OctoPrint(scripted.at("octoprint"), "k"))
    assert host.state("a").state is HostState.READY
    assert host.state("b").state is HostState.IDLE
    record["prints"] = {"last": {"success": True}}
    assert host.state("a").state is HostState.COMPLETE
    record["prints"] = {"last": {"success": False}}
    assert host.state("a").state is HostState.FAILED
    assert b"M112" in host.halt_request().body


def test_duet_logs_in_again_after_a_reset(tmp_path: Path, opened: Opened):
    for sbc in (False, True):
        server = BoardServer(tmp_path / str(sbc), sbc, "hush")
        host = opened(Duet(parse_address(server.port), "hush"))
        assert ("SBC" in host.identify()) is sbc
        host.upload("a.gcode", b"G1 X1\n", lambda share: None)
        server.reset()
        assert host.stored("a.gcode", b"").size == 6
        host.select("a.gcode")
        assert host.state("a.gcode").state is HostState.READY
        with pytest.raises(HostRefused) as refused:
            opened(Duet(parse_address(server.port), "wrong")).identify()
        assert "wrong" not in str(refused.value)
        server.down()


def test_duet_that_is_busy_pauses_or_simulates(tmp_path: Path, opened: Opened):
    server = BoardServer(tmp_path)
    host, board = opened(Duet(parse_address(server.port))), server.board
    assert "standalone" in host.identify()  # though its web page answers every other path
    host.upload("a.gcode", b"G1 X1\n", lambda share: None)
    host.select("a.gcode")
    assert host.state("a.gcode").state is HostState.READY
    board.status = "busy"  # by a macro, behind which a start would wait
    assert host.state("a.gcode").active_file == "another file"
    for status in ("pausing", "resuming"):
        board.status = status
        with pytest.raises(HostRefused, match=status):
            host.cancel("a.gcode")
    board.status, host.begun = "simulating", True
    assert "nothing moves" in host.state("a.gcode").message
    board.status, board.last = "idle", {"lastDuration": 5}
    end = host.ended("a.gcode")
    assert end is not None
    assert end.state is HostState.FAILED
    server.down()


@pytest.mark.parametrize(
    ("then", "said"),
    [(lambda end: None, "nothing whole within 0.2 s"), (socket.socket.close, "Remote end closed")],
    ids=["holds", "drops"],
)
def test_a_port_that_takes_calls_and_gives_no_answer_is_named(then: Any, said: str) -> None:
    kept = []
    with socket.create_server(("127.0.0.1", 0)) as listening:

        def take() -> None:
            kept.append(listening.accept()[0])
            kept[0].recv(4096)
            then(kept[0])

        threading.Thread(target=take, daemon=True).start()
        client = HttpClient(parse_address(f"moonraker://127.0.0.1:{listening.getsockname()[1]}"))
        with pytest.raises(HostSilent, match=rf"GET /server/info: no answer \({said}"):
            client.send(HostRequest("GET", "/server/info"), 0.2)
    for end in kept:
        end.close()
