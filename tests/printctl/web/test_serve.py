"""`printctl serve`: start-up and options."""

from __future__ import annotations

import contextlib
import errno
import json
import os
import signal
import socket
import stat
import subprocess
import sys
import urllib.error
import urllib.request
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import pytest

from printctl.cli import serve as cli_serve
from printctl.errors import UsageError
from printctl.machine.errors import LinkError
from printctl.machine.process.clients.client import attach_station
from printctl.web.serving.listening import bind
from printctl.web.serving.serve import Running, check, refuse_readable
from printctl.web.settings import ServeSettings, is_loopback
from printctl.web.worker import lower_priority, run_at_low_priority
from printctl.web.workspace import Workspace
from tests.printctl.web.serving import PAGE, ROOT, Process, Served, served, server_process
from tests.slower import first_of
from tests.waiting import wait_for


def refused(*options: str) -> tuple[int, str]:
    command = [sys.executable, "-m", "printctl", "serve", *options]
    ended = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=60)
    return ended.returncode, ended.stderr


def asked(url: str, method: str = "GET", token: str = "", **more: str) -> tuple[int, Any]:
    """Return the status and the JSON of an answer."""
    headers = more | ({"Authorization": f"Bearer {token}"} if token else {})
    request = urllib.request.Request(url, method=method, headers=headers)
    try:
        with urllib.request.urlopen(request, timeout=10) as answer:
            return answer.status, json.loads(answer.read())
    except urllib.error.HTTPError as refusal:
        with refusal:
            return refusal.code, json.loads(refusal.read())


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[Process, Path]]:
    workspace = tmp_path_factory.mktemp("serve") / "workspace"
    with server_process(workspace, "--verbose") as started:
        yield started, workspace


def test_only_the_loopback_is_listened_at(server: tuple[Process, Path]) -> None:
    started, _ = server
    port = int(started.url.rsplit(":", 1)[1])
    assert started.url.startswith("http://127.0.0.1:")
    with pytest.raises(OSError), socket.create_connection(("127.0.0.2", port), 5):  # noqa: PT011
        pass


@pytest.mark.parametrize(
    ("method", "path"), [("GET", "/nowhere"), ("POST", "/printer/console"), ("GET", "/stop")]
)
def test_what_the_api_doesn_t_have_is_refused_as_the_api_refuses(
    server: tuple[Process, Path], method: str, path: str
) -> None:
    """The pages take every address that is left: they answered by a page of their own."""
    status, told = asked(f"{server[0].url}/api/v1{path}", method, server[0].token)
    assert (status, told["error"]) == (404, "NotFoundError")
    assert f"{method} /api/v1{path}" in told["message"]


@pytest.mark.parametrize(
    ("path", "origin", "status"),
    [("events", b"http://evil.example", 403), ("events", b"", 401), ("nothing", b"", 403)],
)
def test_a_refused_websocket_is_a_line_in_the_log(
    server: tuple[Process, Path], path: str, origin: bytes, status: int
) -> None:
    started, workspace = server
    where = urlsplit(started.url)
    log, token = workspace.parent / "serve.log", started.token if path == "nothing" else ""
    before = log.read_text()
    with socket.create_connection((where.hostname, where.port), 10) as one:
        one.sendall(
            b"GET /api/v1/%b HTTP/1.1\r\nHost: %b\r\nOrigin: %b\r\n%bUpgrade: websocket\r\n"
            b"Connection: Upgrade\r\nSec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==\r\n"
            b"Sec-WebSocket-Version: 13\r\n\r\n"
            % (
                path.encode(),
                where.netloc.encode(),
                origin or started.url.encode(),
                f"Authorization: Bearer {token}\r\n".encode() if token else b"",
            )
        )
        assert one.makefile("rb").read().startswith(b"HTTP/1.1 %d " % status)
    wait_for(lambda: f'"WebSocket /api/v1/{path}" {status}' in log.read_text()[len(before) :])
    assert len(log.read_text()[len(before) :].splitlines()) == 1


def test_where_the_server_is_stands_in_a_file_of_its_owner(server: tuple[Process, Path]) -> None:
    started, workspace = server
    path = workspace / ".printctl" / "serve.json"
    assert stat.S_IMODE(path.stat().st_mode) == 0o600
    assert stat.S_IMODE(path.parent.stat().st_mode) == 0o700
    told = json.loads(path.read_text())
    status, state = asked(f"{told['url']}/api/v1/controls", "GET", told["token"])
    assert (status, state["holder"]) == (200, None)
    assert os.kill(told["pid"], 0) is None
    assert started.token == told["token"]


def test_a_second_server_is_told_where_the_first_is(server: tuple[Process, Path]) -> None:
    started, workspace = server
    code, said = refused(str(workspace), "--port", "0")
    assert code == 1
    assert started.url in said
    assert str(started.pid) in said
    assert "Traceback" not in said


def test_a_port_in_use_is_said_with_a_remedy(server: tuple[Process, Path], tmp_path: Path) -> None:
    started, _ = server
    code, said = refused(str(tmp_path / "other"), "--port", started.url.rsplit(":", 1)[1])
    assert code == 2
    assert "is in use; choose another by --port" in said
    assert "Traceback" not in said


@pytest.mark.parametrize(
    "head",
    [
        b"Host: a\r\nHost: a\r\n\r\n",
        b"Host: a\r\n" + b"a:b\r\n" * 10_000 + b"\r\n",
        b"a: " + b"b" * 20_000,
    ],
)
def test_what_is_no_request_is_refused_in_json(server: tuple[Process, Path], head: bytes) -> None:
    where = urlsplit(server[0].url)
    with socket.create_connection((where.hostname, where.port), 10) as one:
        one.sendall(b"GET /printer HTTP/1.1\r\n" + head)
        said = one.makefile("rb").read()
    assert said.startswith(b"HTTP/1.1 400 ")
    assert "16 kB" in json.loads(said.partition(b"\r\n\r\n")[2])["message"]


def test_nothing_secret_is_written_to_the_log(server: tuple[Process, Path]) -> None:
    started, workspace = server
    assert asked(f"{started.url}/api/v1/controls?token={started.token}")[0] == 401
    log = workspace.parent / "serve.log"
    wait_for(lambda: "token=***" in log.read_text())
    assert started.token not in log.read_text()


def test_other_machines_need_a_password_or_the_token(tmp_path: Path) -> None:
    for host in ("0.0.0.0", "192.168.1.5", "::"):
        with pytest.raises(UsageError, match="--password"):
            check(ServeSettings(tmp_path, host))
        check(ServeSettings(tmp_path, host, password="bath and needle"))
        check(ServeSettings(tmp_path, host, token_link=True))


def test_a_password_that_can_be_tried_out_is_refused_where_others_reach_the_page(tmp_path):
    with pytest.raises(UsageError, match=r"has 1 characters.*give at least 12"):
        check(ServeSettings(tmp_path, "0.0.0.0", password="x"))
    with pytest.raises(UsageError, match="11 characters"):
        check(ServeSettings(tmp_path, "0.0.0.0", password="x" * 11))
    check(ServeSettings(tmp_path, "0.0.0.0", password="x" * 12))
    check(ServeSettings(tmp_path, "127.0.0.1", password="x"))


@pytest.mark.skipif(os.name != "posix", reason="modes of files")
def test_secrets_that_every_user_can_read_are_refused(tmp_path: Path) -> None:
    secret = tmp_path / "password"
    secret.write_text("bath and needle\n")
    secret.chmod(0o644)
    with pytest.raises(UsageError, match=rf"mode 0644\): `chmod 600 {secret}`"):
        cli_serve._password(False, secret)
    secret.chmod(0o600)
    assert cli_serve._password(False, secret) == "bath and needle"
    key = tmp_path / "key.pem"
    key.write_text("")
    key.chmod(0o604)
    with pytest.raises(UsageError, match=r"--tls-key .* every user of this machine"):
        refuse_readable(key, "--tls-key")


@pytest.mark.skipif(os.name != "posix", reason="modes of files")
def test_a_new_workspace_and_its_folders_are_their_users_alone(tmp_path: Path) -> None:
    root = tmp_path / "workspace"
    Workspace(root).make()
    assert root.stat().st_mode & 0o777 == 0o700


@pytest.mark.parametrize(
    ("host", "truth"),
    [("127.0.0.1", True), ("127.8.8.8", True), ("::1", True), ("localhost", True),
     ("0.0.0.0", False), ("::", False), ("10.0.0.1", False), ("printer.local", False)],
)  # fmt: skip
def test_what_is_loopback(host: str, truth: bool) -> None:
    assert is_loopback(host) is truth


def test_without_tls_what_that_means_is_said_and_the_password_isnt(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    settings = ServeSettings(tmp_path, "0.0.0.0", password="bath and needle")
    cli_serve._tell(settings, Running("http://0.0.0.0:80", 1, "token", "", 0.0))
    said = capsys.readouterr().err
    assert "no TLS" in said
    assert "bath and needle" not in said


@pytest.mark.slow
def test_from_another_address_everything_that_changes_is_refused(tmp_path: Path) -> None:
    secret = tmp_path / "password"
    secret.write_text("bath and needle\n")
    secret.chmod(0o600)
    options = ("--host", "0.0.0.0", "--password-file", str(secret))
    with server_process(tmp_path / "workspace", *options) as started:
        port = started.url.rsplit(":", 1)[1]
        there = f"http://127.0.0.2:{port}"
        for url in (f"{there}/api/v1/stop", f"{there}/api/v1/controls", started.stop):
            assert asked(url, "POST", Origin=there)[0] in (401, 403)
        with urllib.request.urlopen(f"{there}/printer", timeout=10) as log_in:
            assert b'type="password"' in log_in.read()
        assert asked(f"{there}/api/v1/stop", "POST", started.token)[0] == 200
    said = (tmp_path / "serve.log").read_text()
    assert "no TLS" in said
    assert "bath and needle" not in said


def test_a_stop_process_at_another_port_is_said(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for stop in ("http://127.0.0.1:8081/stop", "http://127.0.0.1:9000/stop"):
        running = Running("http://127.0.0.1:8080", 1, "token", stop, 0.0)
        cli_serve._tell(ServeSettings(tmp_path), running)
        assert ("stop process listens at 9000" in capsys.readouterr().err) == ("9000" in stop)


def test_without_the_extra_it_is_named(tmp_path: Path) -> None:
    hidden = (
        "import importlib.util as u, sys; real = u.find_spec\n"
        "u.find_spec = lambda n, *a: None if n == 'fastapi' else real(n, *a)\n"
        "sys.argv = ['printctl', 'serve']\n"
        "from printctl.cli.main import main; main()\n"
    )
    ended = subprocess.run(
        [sys.executable, "-c", hidden], cwd=ROOT, capture_output=True, text=True, timeout=60
    )
    assert ended.returncode == 2
    assert 'pip install "printctl[web]"' in ended.stderr


def test_an_address_of_another_machine_is_said() -> None:
    with pytest.raises(UsageError, match="no address of this machine"):
        bind("192.0.2.1", 0)
    with pytest.raises(UsageError, match="--host"):
        bind("no such name.invalid", 0)


def test_ctrl_c_ends_the_server_and_its_door_in_order(server: tuple[Process, Path]) -> None:
    """The last test here: it ends the server of the others."""
    started, workspace = server
    started.process.send_signal(signal.SIGINT)
    assert started.process.wait(20) == 0
    with pytest.raises(OSError):  # noqa: PT011
        urllib.request.urlopen(started.stop, timeout=5)
    assert not (workspace / ".printctl" / "serve.json").exists()
    assert "a print that runs goes on" in (workspace.parent / "serve.log").read_text()


# --- operating system errors: answered with a remedy, never a bare 500
OURS = {"Origin": PAGE}
GCODE = b"G21\nG90\nG1 X1 Y1 F600\n"


def upload(here: Served, data: bytes = GCODE) -> tuple[int, dict]:
    client = here.client()
    client.get("/printer")
    answer = client.post("/api/v1/jobs", files={"file": ("part.gcode", data)}, headers=OURS)
    return answer.status_code, answer.json()


@pytest.fixture(scope="module")
def one(tmp_path_factory: pytest.TempPathFactory) -> Served:
    """A server for all uploads that fail."""
    return served(tmp_path_factory.mktemp("one"))


@pytest.mark.parametrize(
    ("number", "status", "kind", "remedy"),
    [
        (errno.ENOSPC, 507, "DiskFullError", "free some space"),
        (errno.EDQUOT, 507, "DiskFullError", "free some space"),
        (errno.EFBIG, 507, "FileTooLargeError", "ulimit -f"),
        (errno.EACCES, 503, "NoRightsError", "choose another folder"),
        (errno.EROFS, 503, "NoRightsError", "choose another folder"),
        (errno.EMFILE, 503, "TooManyFilesError", "close other pages"),
        (errno.EIO, 503, "SystemTroubleError", "see to the disk"),
    ],
)
def test_what_the_system_refuses_is_told_with_a_remedy(
    one: Served, monkeypatch: pytest.MonkeyPatch, number: int, status: int, kind: str, remedy: str
) -> None:
    def refused(*asked: object, **more: object) -> None:
        raise OSError(number, os.strerror(number), "/workspace/jobs/part.gcode")

    monkeypatch.setattr("printctl.web.job.jobs.save_name", refused)
    got, said = upload(one)
    assert (got, said["error"]) == (status, kind)
    assert remedy in said["message"]
    assert kind == "TooManyFilesError" or "part.gcode" in said["message"]


@pytest.fixture
def small_disk(tmp_path: Path) -> Iterator[Path]:
    """A disk of 256 kB; skips where nobody may mount one."""
    place = tmp_path / "small"
    place.mkdir()
    mount = ["mount", "-t", "tmpfs", "-o", "size=256k", "none", str(place)]
    if os.geteuid() != 0 or subprocess.run(mount, check=False, capture_output=True).returncode:
        pytest.skip("a small disk can't be mounted here")
    try:
        yield place
    finally:
        subprocess.run(["umount", "-l", str(place)], check=True)


def test_a_full_disk_is_told_and_leaves_nothing_behind(small_disk: Path) -> None:
    here = served(small_disk)
    status, said = upload(here, GCODE * 40_000)
    assert (status, said["error"]) == (507, "DiskFullError")
    assert list((small_disk / "jobs").iterdir()) == []
    assert upload(here)[0] == 200


def test_a_fault_of_our_own_is_told_without_its_inside(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    here = served(tmp_path)

    def broken(*asked: object) -> None:
        raise KeyError("secret")

    monkeypatch.setattr("printctl.web.job.routes.all_jobs", broken)
    client = here.client()
    client._transport.raise_server_exceptions = False  # type: ignore[attr-defined]
    client.get("/printer")
    answer = client.get("/api/v1/jobs")
    assert answer.status_code == 500
    assert answer.json()["error"] == "ServerError"
    assert "secret" not in answer.text


# --- work beside a print
@pytest.mark.skipif(sys.platform != "linux", reason="elsewhere a process is behind as a whole")
def test_what_is_done_behind_a_print_leaves_the_rest_in_front() -> None:
    here = os.nice(0)

    def twice() -> int:
        lower_priority()
        lower_priority()
        return os.nice(0)

    assert run_at_low_priority(twice) == max(10, here)
    assert os.nice(0) == here
    assert run_at_low_priority(lambda: 3) == 3


def test_what_fails_behind_a_print_fails_in_front() -> None:
    with pytest.raises(ZeroDivisionError):
        run_at_low_priority(lambda: 1 // 0)


# --- fuzzing of the REST API by its own description: no server errors
@pytest.fixture(scope="module")
def shared(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Served]:
    """The app behind its guard, in this process: a server's costs as much as all requests."""
    workspace = tmp_path_factory.mktemp("api") / "workspace"
    yield served(workspace, sim_speed=0.0)
    with contextlib.suppress(LinkError):  # what was sent may have connected the simulated printer
        attach_station(workspace / "station").close()


def by_token(shared: Served) -> dict[str, str]:
    return {"Authorization": f"Bearer {shared.access.token}"}


@pytest.mark.parametrize("examples", first_of([1, 30]))
def test_no_request_by_the_description_is_a_server_error(shared: Served, examples: int) -> None:
    schemathesis = pytest.importorskip("schemathesis")
    hypothesis = pytest.importorskip("hypothesis")
    schema = schemathesis.openapi.from_dict(shared.app.openapi())
    failed: list[str] = []
    answered: Counter[int] = Counter()
    operations = [found.ok() for found in schema.get_all_operations()]
    assert len(operations) > 5

    def tried(operation: Any) -> None:
        @hypothesis.settings(
            max_examples=examples,
            deadline=None,
            derandomize=True,
            database=None,
            suppress_health_check=list(hypothesis.HealthCheck),
        )
        @hypothesis.given(case=operation.as_strategy())
        def send(case: Any) -> None:
            answer = case.call(base_url=PAGE, headers=by_token(shared), app=shared.guard)
            answered[answer.status_code] += 1
            if answer.status_code >= 500:
                failed.append(f"{operation.method} {case.path} {case.body!r}: {answer.text[:200]}")

        send()

    for operation in operations:
        tried(operation)
    assert failed == []
    assert answered[200] > 0
    assert answered[401] == 0


def test_the_description_is_whole(shared: Served) -> None:
    """Each route has a summary, an answer for refusals, and no name twice."""
    described = shared.client().get("/api/v1/openapi.json", headers=by_token(shared)).json()
    operations = [
        (f"{method} {path}", one)
        for path, item in described["paths"].items()
        for method, one in item.items()
    ]
    assert [name for name, one in operations if not one.get("summary")] == []
    assert [name for name, one in operations if "401" not in one["responses"]] == []
    ids = Counter(one["operationId"] for _, one in operations)
    assert [name for name, count in ids.items() if count > 1] == []
