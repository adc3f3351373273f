"""Operating system errors: answered with a remedy, never a bare 500."""

from __future__ import annotations

import contextlib
import errno
import os
import subprocess
import sys
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from printctl.machine.link import LinkError
from printctl.machine.station import attach
from printctl.web.low_priority import lower_priority, run_at_low_priority
from tests.printctl.web.serving import PAGE, Served, served
from tests.slower import first_of

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

    monkeypatch.setattr("printctl.web.job.service.list_jobs", broken)
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
        attach(workspace / "station").close()


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
