"""Detached runs: started, found by a restarted server, cancelled, refused."""

from __future__ import annotations

import os
import signal
import time
from pathlib import Path

import pytest

from printctl.errors import UsageError
from printctl.web.core import Core
from printctl.web.design.run_processes import RunProgress
from printctl.web.design.service import DesignService
from printctl.web.errors import BadRequestError, ConflictError, NotFoundError
from printctl.web.settings import ServeSettings
from printctl.web.workspace import Workspace

_LIMIT_S = 60.0


@pytest.fixture
def workspace(tmp_path: Path) -> Workspace:
    return Workspace(tmp_path / "ws").make()


def _server(workspace: Workspace) -> DesignService:
    return DesignService(Core(ServeSettings(workspace.root), workspace))


@pytest.fixture
def service(workspace: Workspace) -> DesignService:
    made = _server(workspace)
    made.recipes.new("one")
    return made


def _until(service: DesignService, *states: str) -> RunProgress:
    deadline = time.monotonic() + _LIMIT_S
    while time.monotonic() < deadline:
        run = service.runs.progress("one")
        if run.state in states:
            return run
        time.sleep(0.05)
    raise AssertionError(f"never {states}: {service.runs.progress('one')}")


@pytest.mark.slow
def test_another_server_finds_a_run_and_cancels_it(
    service: DesignService, workspace: Workspace
) -> None:
    service.runs.start("one")
    pid = _until(service, "running").pid
    os.killpg(pid, signal.SIGSTOP)  # or it is done before it is cancelled, on a busy machine
    other = _server(workspace)
    found = other.runs.progress("one")
    assert found.going_on
    assert found.stages
    with pytest.raises(ConflictError, match="going on"):
        other.runs.start("one")
    other.runs.cancel("one")
    os.killpg(pid, signal.SIGCONT)
    assert _until(other, "interrupted").message
    with pytest.raises(ConflictError, match="isn't going on"):
        other.runs.cancel("one")
    assert _until(service, "interrupted") == other.runs.progress("one")


@pytest.mark.slow
def test_a_run_that_was_killed_is_told_so(service: DesignService, workspace: Workspace) -> None:
    service.runs.start("one")
    run = _until(service, "running")
    os.killpg(run.pid, signal.SIGKILL)
    found = _until(service, "interrupted")
    assert "process is gone" in found.message
    assert _until(_server(workspace), "interrupted").message == found.message


@pytest.mark.slow
def test_a_failed_stage_says_why(service: DesignService) -> None:
    service.recipes.take_file("n.csv", b"vessel,node0\n1,2\n")
    text = service.recipes.read("one")
    given = "{network: n.csv, unit: mm}\n"
    wrong = text.text.replace("\n  design: planar_four_vessel", f" {given}#")
    service.recipes.write("one", wrong, text.version)
    service.runs.start("one", "flow")
    run = _until(service, "failed")
    assert [stage.name for stage in run.stages if stage.state == "failed"] == ["vasculature"]
    assert run.message
    assert "Traceback" not in run.message


def test_what_prints_isnt_started_here(service: DesignService) -> None:
    with pytest.raises(BadRequestError, match="Job room"):
        service.runs.start("one", "print")
    with pytest.raises(UsageError, match="no stage"):
        service.runs.start("one", "--yes")
    with pytest.raises(ConflictError, match="no finished print"):
        service.runs.go_on("one")


def test_a_wrong_recipe_isnt_started(service: DesignService) -> None:
    text = service.recipes.read("one")
    service.recipes.write("one", text.text + "colour: red\n", text.version)
    with pytest.raises(BadRequestError, match="colour"):
        service.runs.start("one")
    with pytest.raises(NotFoundError):
        service.runs.start("two")
