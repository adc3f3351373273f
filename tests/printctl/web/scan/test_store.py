"""Uploaded scans: naming, unpacking, refusal."""

from __future__ import annotations

import gzip
import io
import stat
import zipfile
import zlib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tifffile
from PIL import Image
from starlette.testclient import TestClient

from printctl.web.app import build_app
from printctl.web.core import Core
from printctl.web.errors import BadRequestError, NotFoundError
from printctl.web.scan import store as unpacked_size
from printctl.web.scan.findings import alignment, findings
from printctl.web.scan.slices import TINT
from printctl.web.scan.store import ScanStore, refuse_growth, scan_name
from printctl.web.settings import ServeSettings
from printctl.web.workspace import Workspace
from registration.files.readers import ScanOverrides, read_scan


@pytest.fixture
def store(tmp_path: Path) -> ScanStore:
    return ScanStore(Workspace(tmp_path / "ws").make(), upload_mb=2.0)


def _zip(members: dict[str, bytes]) -> bytes:
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, data in members.items():
            archive.writestr(name, data)
    return out.getvalue()


def _tiff(image: np.ndarray[tuple[int, int], np.dtype[np.uint8]]) -> bytes:
    out = io.BytesIO()
    tifffile.imwrite(out, image)
    return out.getvalue()


def _files(store: ScanStore) -> list[str]:
    return sorted(p.name for p in store.folder.rglob("*") if p.is_file())


def test_a_volume_keeps_its_bytes(store: ScanStore) -> None:
    assert store.take("my scan.tif", io.BytesIO(b"II*\0rest")) == "file~my_scan.tif"
    assert store.path("file~my_scan.tif").read_bytes() == b"II*\0rest"
    assert [row.scan for row in store.rows()] == ["file~my_scan.tif"]


def test_slices_in_a_zip_become_a_volume_in_their_order(store: ScanStore) -> None:
    images = [np.full((4, 6), n, np.uint8) for n in range(12)]
    data = _zip({f"slices/s_{n}.tif": _tiff(image) for n, image in enumerate(images)})
    scan = store.take("stack.zip", io.BytesIO(data))
    assert scan == "file~stack"
    said = ScanOverrides(voxel_mm=(0.1, 0.1, 0.1), modality="microct", scale="linear")
    np.testing.assert_array_equal(read_scan(store.path(scan), said).volume, np.stack(images))


@pytest.mark.parametrize(
    "name", ["../x.tif", "/etc/x.tif", "a/../../x.tif", "a\\..\\x.tif", "C:/x.tif", "a//x.tif"]
)
def test_a_name_that_leads_elsewhere_is_refused(store: ScanStore, name: str) -> None:
    with pytest.raises(BadRequestError):
        store.take("bad.zip", io.BytesIO(_zip({name: b"x", "b.tif": b"y"})))
    assert _files(store) == []
    assert not list(store.folder.parent.parent.glob("x.tif"))


def test_a_link_in_an_archive_is_refused(store: ScanStore) -> None:
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w") as archive:
        link = zipfile.ZipInfo("a.tif")
        link.external_attr = (stat.S_IFLNK | 0o777) << 16
        archive.writestr(link, "/etc/passwd")
    with pytest.raises(BadRequestError, match="isn't unpacked"):
        store.take("bad.zip", io.BytesIO(out.getvalue()))


def test_a_zip_bomb_is_refused(store: ScanStore) -> None:
    data = _zip({f"{n}.dcm": bytes(400_000) for n in range(10)})
    assert len(data) < 50_000
    with pytest.raises(BadRequestError, match="at most 2 MB"):
        store.take("bomb.zip", io.BytesIO(data))
    assert _files(store) == []


def test_an_archive_that_lies_about_its_size_is_refused(store: ScanStore) -> None:
    data = _zip({"1.dcm": bytes(3_000_000)})
    said = (3_000_000).to_bytes(4, "little")
    assert data.count(said) == 2
    with pytest.raises(BadRequestError):
        store.take("liar.zip", io.BytesIO(data.replace(said, (1000).to_bytes(4, "little"))))
    assert _files(store) == []


def test_too_many_files_are_refused(store: ScanStore, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("printctl.web.scan.store.MOST_FILES", 3)
    with pytest.raises(BadRequestError, match="at most 3"):
        store.take("many.zip", io.BytesIO(_zip({f"{n}.dcm": b"x" for n in range(4)})))


def test_more_than_is_taken_is_refused_as_it_comes(store: ScanStore) -> None:
    with pytest.raises(BadRequestError, match="larger than 2 MB"):
        store.take("big.tif", io.BytesIO(bytes(2_500_000)))
    assert _files(store) == []


@pytest.mark.parametrize(
    ("name", "ours"),
    [
        ("../../a.tif", "a.tif"),
        ("c:\\scans\\a.tif", "a.tif"),
        ("<script>alert(1)</script>.tif", "script_.tif"),
        (".hidden.tif", "hidden.tif"),
    ],
)
def test_a_files_name_becomes_one_of_ours(name: str, ours: str) -> None:
    assert scan_name(name) == ours


@pytest.mark.parametrize("name", ["", "..", "a.json", "x.yaml"])
def test_what_cant_be_a_scans_name_is_refused(name: str) -> None:
    with pytest.raises(BadRequestError):
        scan_name(name)


# --- decompression bombs: scans that unpack to far more than was sent are refused
MOST = 10**10
SIZE = 2_600_000


@pytest.fixture(scope="module")
def packed() -> bytes:
    packer = zlib.compressobj(9, zlib.DEFLATED, 31)
    piece = bytes(100_000)
    return b"".join(packer.compress(piece) for _ in range(SIZE // 10**5)) + packer.flush()


@pytest.fixture(autouse=True)
def _growth_is_looked_at_early(monkeypatch: pytest.MonkeyPatch) -> None:
    """From 2 MB on, not from 200: to pack what grows so far takes seconds."""
    monkeypatch.setattr(unpacked_size, "_RATIO_FROM", 2_000_000)


@pytest.mark.parametrize(
    ("name", "before"),
    [
        ("scan.nii.gz", b""),
        ("scan.nii.gz", gzip.compress(b"first")),  # what follows a small stream counts as well
        ("scan.nrrd", b"NRRD0004\ntype: uint8\nencoding: gzip\n\n"),
    ],
)
def test_a_gzip_that_grows_is_refused(
    tmp_path: Path, packed: bytes, name: str, before: bytes
) -> None:
    (tmp_path / name).write_bytes(before + packed)
    with pytest.raises(BadRequestError, match="more than 200 times its size"):
        refuse_growth(tmp_path / name, MOST)


def test_zips_that_grow_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "scan.npz"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("slice.tif", bytes(SIZE))
    with pytest.raises(BadRequestError, match="more than 200 times its size"):
        refuse_growth(path, MOST)


# --- registration findings in words
def _turned(degrees: float) -> list[list[float]]:
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    return [[c, -s, 0, 1.5], [s, c, 0, -2.25], [0, 0, 1, 0.125], [0, 0, 0, 1]]


NUMBERS: dict[str, Any] = {
    "transform_scan_to_part": _turned(30.0),
    "scale": [0.99, 1.0, 1.01],
    "interval_95": {"rotation_deg": [0.01, 0.02], "shift_um": [1.0, 4.0], "scale": [0.001]},
    "rigid": {"rms_um": 30.5, "p95_um": 75.4},
    "ambiguity": {"flag": False},
}


def test_pose_scales_and_intervals_are_told_with_units() -> None:
    said = {one.name: one.value for one in alignment(NUMBERS)}
    assert said["Turned by"] == "30.00° (± 0.02 °, 95 %)"
    assert said["Shifted by x, y, z"] == "1.500, −2.250, 0.125 mm (± 4 µm, 95 %)"
    scale = said["Part against design along x, y, z"]
    assert scale == "99.00 %, 100.00 %, 101.00 % (± 0.1 %, 95 %)"
    assert said["Pose"] == "unambiguous"
    assert said["RMS deviation, rigid fit"] == "30.5 µm; 95 % of it within 75.4 µm"


@pytest.mark.parametrize("text", ["", "{", "[1]"])
def test_without_a_registration_there_are_none(tmp_path: Path, text: str) -> None:
    (tmp_path / "registration.json").write_text(text)
    with pytest.raises(NotFoundError, match="no scan is registered"):
        findings(tmp_path)


@pytest.mark.parametrize("scan", ["file~../x", "file~", "run~../..", "x", "file~a/b", "file~.x"])
def test_scans_elsewhere_arent_found(store: ScanStore, scan: str) -> None:
    with pytest.raises((BadRequestError, NotFoundError)):
        store.path(scan)


def test_more_than_is_taken_is_refused_at_any_ratio(tmp_path: Path) -> None:
    (tmp_path / "scan.nii.gz").write_bytes(gzip.compress(bytes(range(256)) * 8000))
    with pytest.raises(BadRequestError, match="at most 1 MB"):
        refuse_growth(tmp_path / "scan.nii.gz", 10**6)


# --- rEST routes of scans
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


def test_only_what_is_missing_is_named_and_what_was_said_comes_back(client: TestClient) -> None:
    scan = _added(client)
    needs = client.get(f"/api/v1/scans/{scan}/said").json()
    assert needs["missing"] == ["voxel_um", "scale", "modality"]
    some = {"voxel_um": [10, 20, 30], "modality": "oct"}
    assert client.put(f"/api/v1/scans/{scan}/said", json=some).status_code == 422  # but kept
    needs = client.get(f"/api/v1/scans/{scan}/said").json()
    assert {"refractive_index", "optical_depth", "scale"} <= set(needs["missing"])
    assert needs["said"]["voxel_um"] == pytest.approx([10, 20, 30])
    client.put(f"/api/v1/scans/{scan}/said", json=SAID)
    needs = client.get(f"/api/v1/scans/{scan}/said").json()
    assert (needs["missing"], needs["problem"]) == ([], "")
    assert client.put(f"/api/v1/scans/{scan}/said", json={"voxels": 1}).status_code == 422


def test_scans_tell_with_which_runs_they_were_compared(
    client: TestClient, workspace: Workspace
) -> None:
    scan = _added(client)
    (workspace.run("one") / ".registered" / scan).mkdir(parents=True)
    assert [row["registered"] for row in client.get("/api/v1/scans").json()] == [["one"]]


def test_slices_are_those_of_the_file_and_tinted_above_a_threshold(client: TestClient) -> None:
    scan = _added(client)
    client.put(f"/api/v1/scans/{scan}/said", json=SAID)
    for axis, image in (("z", VOLUME[2]), ("y", VOLUME[:, 2]), ("x", VOLUME[:, :, 2])):
        for more in ("", "&threshold=100"):
            path = f"/api/v1/scans/{scan}/slices/{axis}/2?low=0&high=255{more}"
            answer = client.get(path)
            assert answer.headers["content-type"] == "image/png"
            seen = np.asarray(Image.open(io.BytesIO(answer.content))).astype(int)
            grey = np.repeat(image[..., None], 3, axis=2).astype(int)
            tinted = (grey + np.array(TINT)) // 2 if more else grey
            np.testing.assert_array_equal(seen, np.where((image >= 100)[..., None], tinted, grey))


def test_a_scan_of_which_something_else_is_said_is_read_again(client: TestClient) -> None:
    path = f"/api/v1/scans/{_added(client)}/said"
    for modality in ("microct", "confocal"):
        answer = client.put(path, json=SAID | {"modality": modality})
        assert answer.json()["modality"] == modality


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


def test_a_link_that_leads_out_isnt_followed(client: TestClient, workspace: Workspace) -> None:
    scan, run = _added(client), workspace.run("one")
    outside = workspace.root.parent / "outside" / scan
    outside.mkdir(parents=True)
    (outside / "run.log").write_text("secret")
    (outside / "report.html").write_text("secret")
    (run / "scan.oct").symlink_to(outside / "run.log")
    registered = run / ".registered"

    def refused(*files: str) -> bool:
        way = f"/api/v1/scans/{scan}/with/one"
        answers = [client.get(f"{way}/{file}") for file in files]
        return all(one.status_code in (404, 422) and "secret" not in one.text for one in answers)

    registered.symlink_to(outside.parent)
    assert refused("files", "files/run.log", "report")
    registered.unlink()
    registered.mkdir()
    (registered / scan).symlink_to(outside)
    assert refused("files", "files/run.log", "report")
    (registered / scan).unlink()
    (registered / scan).mkdir()
    for name in ("run.log", "report.html"):
        (registered / scan / name).symlink_to(outside / name)
    assert refused("files/run.log", "report")
    assert client.get(f"/api/v1/scans/{scan}/with/one/files").json() == []
    assert [row["scan"] for row in client.get("/api/v1/scans").json()] == [scan]
    assert client.get("/api/v1/scans/run~one").status_code == 404


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
