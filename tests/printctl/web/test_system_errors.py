"""Operating system errors: answered with a remedy, never a bare 500."""

from __future__ import annotations

import errno
import os
import subprocess
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.printctl.web.serving import PAGE, Served, served

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
