"""Rehearsals that are stopped at each of their moments, by real processes."""

from __future__ import annotations

import contextlib
import json
import os
import shutil
import signal
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import httpx
import pytest
from starlette.testclient import TestClient

from printctl.machine.records.record import REHEARSAL
from printctl.machine.records.states import ENDED
from printctl.web.app import build_app
from printctl.web.core import Core
from printctl.web.design.recipes import EXAMPLES
from printctl.web.settings import ServeSettings
from printctl.web.workspace import Workspace
from tests.printctl.web.serving import server_process
from tests.waiting import wait_for

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="looks for processes in /proc")

API, NAME = "/api/v1", "p"
SLOWLY = 0.1
"""Times real time: the print would last two minutes."""


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Workspace:
    """A workspace with a small design that can be printed."""
    workspace = Workspace(tmp_path_factory.mktemp("made") / "ws").make()
    text = (EXAMPLES / "planar_tree.yaml").read_text().replace("terminals: 30", "terminals: 4")
    with _client(workspace) as client:
        workspace.recipe(NAME).write_text(text)
        assert client.post(f"{API}/runs/{NAME}/start", json={}).status_code == 200
        wait_for(lambda: _project(client)["run"]["state"] == "done", 300, lambda: _project(client))
    return workspace


@pytest.fixture
def workspace(made: Workspace, tmp_path: Path) -> Iterator[Workspace]:
    shutil.copytree(made.root, tmp_path / "ws")
    workspace = Workspace(tmp_path / "ws").make()
    yield workspace
    for pid in processes(workspace.root):
        os.kill(pid, signal.SIGKILL)


def _client(workspace: Workspace) -> TestClient:
    return TestClient(build_app(Core(ServeSettings(workspace.root), workspace), pages=False))


def _project(client: TestClient) -> dict[str, Any]:
    found: dict[str, Any] = client.get(f"{API}/projects/{NAME}").json()
    return found


def processes(folder: Path, program: str = "") -> list[int]:
    """Processes other than this one that were given a path in a folder, of a program."""
    found = []
    for pid in (int(name) for name in os.listdir("/proc") if name.isdecimal()):
        try:
            words = Path(f"/proc/{pid}/cmdline").read_text(errors="replace")
        except OSError:
            continue
        if str(folder) in words and program in words and pid != os.getpid():
            found.append(pid)
    return found


def link_record(folder: Path) -> dict[str, Any]:
    try:
        found: dict[str, Any] = json.loads((folder / "print" / "link.json").read_text())
    except (OSError, ValueError):
        return {}
    return found


def begun(folder: Path) -> bool:
    return True


def with_a_simulator(folder: Path) -> bool:
    return (folder / "print" / "sim.address").exists()


def with_a_link_that_does_not_listen_yet(folder: Path) -> bool:
    """Whether the link process is there; it is held up, so that it begins behind the stop."""
    for pid in processes(folder / "print", "printctl.machine.process"):
        with contextlib.suppress(ProcessLookupError):  # the one that starts it ends at once
            if os.getsid(pid) == pid:
                os.kill(pid, signal.SIGSTOP)
                return True
    return False


def printing(folder: Path) -> bool:
    return bool(link_record(folder).get("address"))


@pytest.mark.parametrize("by", ["stop", f"runs/{NAME}{REHEARSAL}/cancel"])
@pytest.mark.parametrize(
    "moment", [begun, with_a_simulator, with_a_link_that_does_not_listen_yet, printing]
)
def test_a_stopped_rehearsal_leaves_no_process_and_no_verdict(
    workspace: Workspace, moment: Callable[[Path], bool], by: str
) -> None:
    """Neither its own nor that of the rehearsal before."""
    folder = workspace.run(NAME + REHEARSAL)
    shutil.copytree(workspace.run(NAME), folder)
    (folder / "report.json").write_text('{"verdict": {"passed": true, "reasons": []}}')
    with _client(workspace) as client:
        assert _project(client)["judged"] == NAME + REHEARSAL
        answer = client.post(f"{API}/projects/{NAME}/rehearse", json={"speed": SLOWLY})
        assert answer.status_code == 200, answer.text
        assert not _project(client)["has_report"], "it is of the rehearsal before"
        wait_for(lambda: moment(folder), 60, lambda: _project(client)["run"])
        assert client.post(f"{API}/{by}").status_code == 200
        for pid in processes(folder / "print"):
            os.kill(pid, signal.SIGCONT)
        wait_for(lambda: not processes(workspace.root), 60, lambda: processes(workspace.root))
        # a process that ends has no command any more a moment before its parent is told
        wait_for(lambda: _project(client)["rehearsal_broken"], 20, lambda: _project(client)["run"])
        assert not _project(client)["has_report"]
        state = client.get(f"{API}/runs/{folder.name}/progress").json()["print_state"]
        assert state in {"", *(str(one.value) for one in ENDED)} - {"done"}


@pytest.mark.parametrize("moment", [begun, with_a_simulator])
def test_the_stop_process_ends_a_rehearsal_while_the_server_hangs(
    workspace: Workspace, moment: Callable[[Path], bool]
) -> None:
    folder = workspace.run(NAME + REHEARSAL)
    with server_process(workspace.root) as server:
        access = {"Authorization": f"Bearer {server.token}"}
        with httpx.Client(headers=access, timeout=60) as client:
            address = f"{server.url}{API}/projects/{NAME}/rehearse"
            answer = client.post(address, json={"speed": SLOWLY})
            assert answer.status_code == 200, answer.text
            wait_for(lambda: moment(folder), 60)
            server.halt()
            try:
                stopped = client.post(server.stop)
                wait_for(lambda: not processes(folder), 60, lambda: processes(folder))
            finally:
                server.go_on()
        assert [json.loads(line) for line in stopped.text.splitlines()] == [
            {"sent": []},
            {"outcome": []},
            {"rehearsals_ended": 1},
        ]
