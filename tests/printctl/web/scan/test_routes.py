"""REST routes of scans."""

from __future__ import annotations

import io
import zipfile
from pathlib import Path

import numpy as np
import pytest
import tifffile
from PIL import Image
from starlette.testclient import TestClient

from printctl.web.app import build_app
from printctl.web.core import Core
from printctl.web.settings import ServeSettings
from printctl.web.workspace import Workspace

VOLUME = np.random.default_rng(3).integers(0, 200, (4, 6, 8), dtype=np.uint8)
SAID = {
    "voxel_um": [10, 20, 30],
    "modality": "microct",
    "scale": "linear",
    "depth_down": False,
    "refractive_index": 1.0,
    "optical_depth": False,
    "axes": "zyx",
    "mirrored": False,
}


def _workspace(tmp_path: Path) -> Workspace:
    (tmp_path / "secret.txt").write_text("secret")
    made = Workspace(tmp_path / "ws").make()
    made.run("one").mkdir()
    (made.run("one") / "secret.key").write_text("secret")
    return made


def _client(workspace: Workspace) -> TestClient:
    core = Core(ServeSettings(workspace.root, upload_mb=1.0), workspace)
    return TestClient(build_app(core, pages=False), raise_server_exceptions=True)


@pytest.fixture
def workspace(tmp_path: Path) -> Workspace:
    return _workspace(tmp_path)


@pytest.fixture
def client(workspace: Workspace) -> TestClient:
    return _client(workspace)


@pytest.fixture(scope="module")
def known(tmp_path_factory: pytest.TempPathFactory) -> tuple[TestClient, str]:
    """A client and a scan of which all is said, for all tests that are refused."""
    client = _client(_workspace(tmp_path_factory.mktemp("known")))
    scan = _added(client)
    client.put(f"/api/v1/scans/{scan}/said", json=SAID)
    return client, scan


def _added(client: TestClient) -> str:
    out = io.BytesIO()
    tifffile.imwrite(out, VOLUME, photometric="minisblack")
    answer = client.post("/api/v1/scans", files={"file": ("my scan.tif", out.getvalue())})
    assert answer.status_code == 201, answer.text
    return str(answer.json()["scan"])


def test_what_a_file_doesnt_say_is_asked_and_then_known(client: TestClient) -> None:
    scan = _added(client)
    refused = client.get(f"/api/v1/scans/{scan}")
    assert refused.status_code == 422
    assert "voxel" in refused.json()["message"]
    assert "/" not in refused.json()["message"].split(":")[0]
    known = client.put(f"/api/v1/scans/{scan}/said", json=SAID).json()
    assert known["shape"] == [8, 6, 4]
    assert known["voxel_um"] == pytest.approx([10, 20, 30])
    assert client.get(f"/api/v1/scans/{scan}").json() == known


def test_a_slice_is_that_of_the_file(client: TestClient) -> None:
    scan = _added(client)
    client.put(f"/api/v1/scans/{scan}/said", json=SAID)
    answer = client.get(f"/api/v1/scans/{scan}/slices/z/2?low=0&high=255")
    assert answer.headers["content-type"] == "image/png"
    seen = np.asarray(Image.open(io.BytesIO(answer.content)))
    np.testing.assert_array_equal(seen[..., 1], VOLUME[2])


@pytest.mark.parametrize("voxel", [[0, 0, 0], [-1, 1, 1], ["inf", 1, 1], [1e300, 1, 1], [1, 2]])
def test_a_voxel_that_cant_be_is_refused(
    known: tuple[TestClient, str], voxel: list[object]
) -> None:
    client, scan = known
    answer = client.put(f"/api/v1/scans/{scan}/said", json={**SAID, "voxel_um": voxel})
    assert answer.status_code == 422
    client.put(f"/api/v1/scans/{scan}/said", json=SAID)
    assert client.get(f"/api/v1/scans/{scan}").status_code == 200


@pytest.mark.parametrize(
    "slices", ["z/9", "z/-1", "w/1", "z/1?low=5", "z/1?low=5&high=5", "z/1?low=nan&high=1", "z/x"]
)
def test_a_slice_that_isnt_there_is_refused(known: tuple[TestClient, str], slices: str) -> None:
    client, scan = known
    assert client.get(f"/api/v1/scans/{scan}/slices/{slices}").status_code == 422


@pytest.mark.parametrize(
    "path",
    [
        "file~..%2F..%2Fsecret.txt",
        "run~..%2F..",
        "x",
        "file~a/with/..%2F/progress",
        "run~one/with/one/files/secret.key",
        "run~one/with/one/files/..%2Fsecret.key",
        "run~one/with/%2e%2e/report",
    ],
)
def test_nothing_beyond_the_scans_is_given(known: tuple[TestClient, str], path: str) -> None:
    answer = known[0].get(f"/api/v1/scans/{path}")
    assert answer.status_code in (404, 422)
    assert "secret\n" not in answer.text


def test_what_is_no_scan_is_refused_as_it_comes(client: TestClient) -> None:
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w") as archive:
        archive.writestr("notes.txt", "no slices")
    for data in (out.getvalue(), b"PK\x03\x04rubbish", b"\x1f\x8b12345", b"hello", b""):
        answer = client.post("/api/v1/scans", files={"file": ("b.tif", data)})
        assert answer.status_code == 422
        assert "/" not in answer.json()["message"].split(":")[0]
    assert client.get("/api/v1/scans").json() == []


def test_a_broken_volume_is_told_so(client: TestClient) -> None:
    data = b"II*\0" + b"\xff" * 40
    assert client.post("/api/v1/scans", files={"file": ("b.tif", data)}).status_code == 201
    assert client.get("/api/v1/scans/file~b.tif").status_code == 422


def test_a_registration_wants_a_design(client: TestClient) -> None:
    scan = _added(client)
    answer = client.post(f"/api/v1/scans/{scan}/with/one/start", json={})
    assert answer.status_code == 409
    assert "make its design first" in answer.json()["message"]
    assert client.post(f"/api/v1/scans/{scan}/with/none/start", json={}).status_code == 404
    assert client.get(f"/api/v1/scans/{scan}/with/one/progress").json()["state"] == "never"
    assert client.get(f"/api/v1/scans/{scan}/with/one/report").status_code == 404


def test_files_with_other_names_in_the_folders_do_no_harm(
    client: TestClient, workspace: Workspace
) -> None:
    for place in ("runs/a b", "scans/x y.tif", "recipes/ä.yaml", "runs/.hidden"):
        (workspace.root / place).mkdir()
    for rows in ("scans", "runs", "recipes"):
        answer = client.get(f"/api/v1/{rows}")
        assert answer.status_code == 200
        assert all("name" not in row or row["name"] == "one" for row in answer.json())
