"""REST API of the print history, used as a script would."""

from __future__ import annotations

import csv
import io
import json
import zipfile
from pathlib import Path

import pytest
from starlette.testclient import TestClient

from printctl.machine.records.lab_key import lab_key
from tests.printctl.history.records.prints import GCODE, printed, with_run
from tests.printctl.web.serving import Served, served

WAY = "/api/v1/history"


@pytest.fixture(autouse=True)
def data(tmp_path, monkeypatch) -> Path:
    monkeypatch.setenv("PRINTCTL_DATA", str(tmp_path / "data"))
    return tmp_path / "data"


@pytest.fixture
def app(tmp_path) -> Served:
    return served(tmp_path / "ws")


def _script(app: Served) -> TestClient:
    client = app.client()
    client.headers["Authorization"] = f"Bearer {app.access.token}"
    return client


@pytest.fixture
def script(app) -> TestClient:
    """A client that shows the token."""
    return _script(app)


@pytest.fixture(scope="module")
def asking(tmp_path_factory) -> TestClient:
    """The same, for all tests that are refused."""
    return _script(served(tmp_path_factory.mktemp("asking")))


def test_prints_are_listed_narrowed_and_paged(script, tmp_path):
    for k in range(7):
        end = "killed" if k == 3 else "done"
        printed(tmp_path / str(k), f"{k}.gcode", 1e9 + 86_400 * k, end)
    found = script.get(WAY, params={"limit": 3, "offset": 3}).json()
    assert (found["total"], [p["file"] for p in found["prints"]]) == (
        7,
        ["3.gcode", "2.gcode", "1.gcode"],
    )
    found = script.get(WAY, params={"state": ["killed", "failed"]}).json()
    assert [p["file"] for p in found["prints"]] == ["3.gcode"]
    found = script.get(WAY, params={"words": "cold 5.gcode"}).json()
    assert [p["file"] for p in found["prints"]] == ["5.gcode"]
    days = {"since": "2001-09-10", "until": "2001-09-11", "descending": False}
    assert script.get(WAY, params=days).json()["total"] in (2, 3)  # days are the machine's


def test_prints_of_this_workspace_are_told_from_those_of_others(script, app, tmp_path):
    here = app.core.workspace.root
    printed(here / "runs" / "chip", started=1e9, who="ada")
    printed(here.with_name("ws_2") / "runs" / "chip", started=1e9 + 1, who="grace")
    found = script.get(WAY, params={"here": True}).json()
    assert [(p["job"], p["who"]) for p in found["prints"]] == [("run~chip", "ada")]
    assert [p["job"] for p in script.get(WAY).json()["prints"]] == ["", "run~chip"]
    choices = f"{WAY}/choices"
    assert script.get(choices, params={"here": True}).json()["people"] == ["ada"]
    assert script.get(choices).json()["people"] == ["ada", "grace"]
    assert script.get(f"{WAY}/csv", params={"here": True}).text.count("\n") == 2


@pytest.mark.parametrize(
    "query",
    [{"limit": 0}, {"limit": 10**6}, {"offset": -1}, {"sort": "id; DROP"}, {"since": "yesterday"},
     {"since": "0001-01-01"}, {"words": "x" * 201}],
)  # fmt: skip
def test_question_that_can_not_be_asked_is_told(asking, query):
    answer = asking.get(WAY, params=query)
    assert answer.status_code == 422
    assert answer.json()["message"]


def test_one_print_is_told_with_all_there_is(script, tmp_path):
    folder = tmp_path / "run"
    note = {"values": {"operator": "Ada", "ink_lot": "A7"}, "mean": float("nan")}
    (folder / "print").mkdir(parents=True)
    (folder / "print" / "record.json").write_text(json.dumps(note))
    entry = printed(folder)
    with_run(folder)
    told = script.get(f"{WAY}/{entry.id}").json()
    assert (told["verdict"], told["reasons"], told["gcode_there"]) == ("pass", ["All open"], True)
    assert told["note"]["values"]["ink_lot"] == "A7"
    assert told["print"]["operator"] == "Ada"
    assert [e["kind"] for e in told["events"]] == ["begun", "state", "state", "alarm", "end"]


def test_rehearsed_print_is_told_as_simulated(script, tmp_path):
    place = tmp_path / "run" / "print"
    place.mkdir(parents=True)
    (place / "sim.address").write_text("/dev/pts/3\n")  # as the simulated printer leaves it
    rehearsed, real = printed(tmp_path / "run"), printed(tmp_path / "other", started=2e9)
    told = script.get(f"{WAY}/{rehearsed.id}").json()
    assert told["print"]["port"] == "simulated"
    assert told["events"][0]["text"] == "part.gcode on simulated"
    ports = [one["port"] for one in script.get(WAY).json()["prints"]]
    assert ports == [real.port, "simulated"] == ["/dev/pts/3", "simulated"]


@pytest.mark.parametrize(
    ("way", "status"),
    [("1000000000-00000000", 404), ("..%2f..%2fetc%2fpasswd", 404), ("x", 422), ("1-2-3", 422)],
)
def test_print_that_is_not_there_is_not_found(asking, way, status):
    for more in ("", "/bundle", "/report", "/repeat"):
        assert asking.get(f"{WAY}/{way}{more}").status_code in (status, 404)


def test_csv_holds_every_page_and_no_formula(script, tmp_path):
    for k in range(60):
        printed(tmp_path / str(k), f"{k}.gcode", 1e9 + k, who="=1+1")
    answer = script.get(f"{WAY}/csv", params={"words": "gcode"})
    rows = list(csv.DictReader(io.StringIO(answer.text)))
    assert len(rows) == 60
    assert {row["who"] for row in rows} == {"'=1+1"}
    assert "attachment" in answer.headers["content-disposition"]


def test_bundle_comes_whole_is_verified_and_leaves_nothing_behind(script, app, tmp_path):
    entry = printed(tmp_path / "run")
    data = script.get(f"{WAY}/{entry.id}/bundle").content
    with zipfile.ZipFile(io.BytesIO(data)) as opened:
        assert opened.read("job.gcode") == GCODE
    found = script.post(f"{WAY}/verify", files={"bundle": ("a.zip", data)}).json()
    assert (found["whole"], found["signature"], found["print_id"]) == (True, "trusted", entry.id)
    assert list((app.core.workspace.private / "bundles").iterdir()) == []


def test_verify_tells_what_is_changed_and_whose_key_it_is(script, tmp_path):
    entry = printed(tmp_path / "run")
    data = bytearray(script.get(f"{WAY}/{entry.id}/bundle").content)
    other = lab_key(tmp_path / "other").public.pem()
    files = {"bundle": ("a.zip", bytes(data)), "key": ("k.pem", other)}
    assert script.post(f"{WAY}/verify", files=files).json()["signature"] == "unknown key"
    data[data.index(b"a comment")] ^= 1
    found = script.post(f"{WAY}/verify", files={"bundle": ("../../a.zip", bytes(data))}).json()
    assert found["changed"] == ["job.gcode: changed"]
    assert found["print_id"] == ""


@pytest.mark.parametrize(
    "files",
    [{}, {"bundle": ("a.zip", b"PK"), "key": ("k.pem", b"garbage")},
     {"bundle": ("a.zip", b"PK"), "key": ("k.pem", b"x" * 20_000)}],
)  # fmt: skip
def test_verify_refuses_what_it_can_not_take(asking, files):
    answer = asking.post(f"{WAY}/verify", files=files)
    assert answer.status_code == 422


def test_public_key_can_be_had_and_the_private_one_can_not(script):
    answer = script.get(f"{WAY}/key")
    assert answer.content == lab_key().public.pem()
    assert b"PRIVATE" not in answer.content


def test_report_runs_as_a_page_of_nobody(script, tmp_path):
    entry = printed(tmp_path / "run")
    assert script.get(f"{WAY}/{entry.id}/report").status_code == 404
    with_run(tmp_path / "run")
    answer = script.get(f"{WAY}/{entry.id}/report")
    assert answer.text == "<p>report"
    policy = answer.headers["content-security-policy"]
    assert "sandbox" in policy
    assert "allow-same-origin" not in policy
    assert script.get(f"{WAY}/{entry.id}/report", params={"kind": "pdf"}).status_code == 404


def test_photos_are_pictures_of_this_print_only(script, tmp_path):
    entry = printed(tmp_path / "run")
    photos = tmp_path / "run" / "print" / "photos"
    photos.mkdir()
    (photos / "a.jpg").write_bytes(b"\xff\xd8\xff")
    (photos / "a.html").write_text("<script>")
    (photos / "link.png").symlink_to("/etc/passwd")
    (photos / "c.jpg").write_bytes(b"of the print before")
    named = [{"name": name} for name in ("a.jpg", "a.html", "link.png", "b.jpg", "../journal.log")]
    (photos.parent / "record.json").write_text(json.dumps({"photos": [*named, 7, {"name": 7}]}))
    assert script.get(f"{WAY}/{entry.id}/photos/a.jpg").headers["content-type"] == "image/jpeg"
    for name in ("a.html", "link.png", "b.jpg", "c.jpg", "..%2fjournal.log"):
        assert script.get(f"{WAY}/{entry.id}/photos/{name}").status_code in (404, 422)


def test_repeat_tells_what_differs_and_makes_a_job_that_is_not_started(script, app, tmp_path):
    entry = printed(tmp_path / "run")
    with_run(tmp_path / "run")
    plan = script.get(f"{WAY}/{entry.id}/repeat").json()
    assert any("collagen_fresh" in one["what"] for one in plan["differences"])
    job = script.post(f"{WAY}/{entry.id}/repeat").json()["job"]
    assert app.core.workspace.job_file(job).read_bytes() == GCODE
    assert not app.core.workspace.print_folder(job).exists()
    (tmp_path / "run" / "part.gcode").write_bytes(b"G28\n")
    answer = script.post(f"{WAY}/{entry.id}/repeat")
    assert answer.status_code == 409
    assert "changed since" in answer.json()["message"]


def test_nothing_is_told_or_made_without_a_token(app, tmp_path):
    entry = printed(tmp_path / "run")
    for way in ("", "/csv", "/key", f"/{entry.id}", f"/{entry.id}/bundle", f"/{entry.id}/report"):
        assert app.client().get(WAY + way).status_code == 401
    for way in ("/verify", f"/{entry.id}/repeat"):
        assert app.client().post(WAY + way).status_code in (401, 403)
