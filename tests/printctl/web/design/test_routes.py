"""REST routes of recipes and runs, with access control."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any
from urllib.parse import unquote

import pytest
from starlette.testclient import TestClient

from printctl.pipeline.running.lock import run_lock
from printctl.run_folder.manifest import Manifest, StageRecord
from printctl.web.app import build_app
from printctl.web.core import Core
from printctl.web.design import run_views
from printctl.web.design.run_views import tissue_page
from printctl.web.errors import ConflictError
from printctl.web.settings import ServeSettings
from printctl.web.workspace import Workspace


def _workspace(tmp_path: Path) -> Workspace:
    (tmp_path / "secret.txt").write_text("secret")
    made = Workspace(tmp_path / "ws").make()
    _run(made, "one", vessels=14, print_time_s=600.0, recipe={"toolpath": {"layer_um": 60.0}})
    _run(made, "two", vessels=14, print_time_s=900.0, recipe={"toolpath": {"layer_um": 40.0}})
    return made


def _run(
    workspace: Workspace, name: str, vessels: int, print_time_s: float, recipe: object
) -> None:
    folder = workspace.run(name)
    folder.mkdir()
    stages = {
        "vasculature": StageRecord("k", {}, {"vessels": vessels}, 1.0, 1.0),
        "dry run": StageRecord("k", {}, {"print_time_s": print_time_s}, 1.0, 1.0),
    }
    Manifest(folder, {"recipe": recipe}, stages).save()
    (folder / "flow.csv").write_text("vessel\n0\n")
    (folder / "report.html").write_text('<!doctype html><html lang="en"><head></head></html>')
    (folder / "secret.key").write_text("secret")


def _client(workspace: Workspace) -> TestClient:
    app = build_app(Core(ServeSettings(workspace.root), workspace), pages=False)
    return TestClient(app, raise_server_exceptions=True)


@pytest.fixture
def workspace(tmp_path: Path) -> Workspace:
    return _workspace(tmp_path)


@pytest.fixture
def client(workspace: Workspace) -> TestClient:
    return _client(workspace)


@pytest.fixture(scope="module")
def asked(tmp_path_factory: pytest.TempPathFactory) -> TestClient:
    """One for all tests that only ask."""
    return _client(_workspace(tmp_path_factory.mktemp("asked")))


def test_a_recipe_is_made_changed_checked_and_thrown_away(client: TestClient) -> None:
    made = client.post("/api/v1/recipes", json={"name": "a"}).json()
    assert made["problems"] == []
    text = made["text"].replace("layer_um: 60", "layer_um: 1")
    body = {"text": text, "version": made["version"]}
    wrong = client.put("/api/v1/recipes/a", json=body).json()
    assert wrong["problems"][0]["path"] == ["toolpath", "layer_um"]
    assert client.put("/api/v1/recipes/a", json=body).status_code == 409
    assert client.delete("/api/v1/recipes/a").status_code == 204
    assert client.get("/api/v1/recipes/a").status_code == 404
    assert client.post("/api/v1/recipes/a/restore").json()["text"] == text


def test_a_recipe_isnt_thrown_away_while_it_is_made(
    client: TestClient, workspace: Workspace
) -> None:
    client.post("/api/v1/recipes", json={"name": "a"})
    with run_lock(workspace.run("a")):
        refused = client.delete("/api/v1/recipes/a")
    assert refused.status_code == 409
    assert "is being made" in refused.json()["message"]
    assert client.delete("/api/v1/recipes/a").status_code == 204


def test_a_text_is_checked_without_being_kept(client: TestClient) -> None:
    found = client.post("/api/v1/recipes/validate", json={"text": "a: *x"}).json()
    assert not found["valid"]
    assert client.get("/api/v1/recipes").json() == []


def test_one_value_is_changed_as_value_or_yaml(client: TestClient) -> None:
    made = client.post("/api/v1/recipes", json={"name": "a"}).json()

    def change(**given: object) -> dict[str, Any]:
        body = {"version": made["version"], **given}
        made.update(client.patch("/api/v1/recipes/a", json=body).json())
        return dict(made["data"])

    assert change(path=["flow", "viscosity_mpa_s"], value=2)["flow"]["viscosity_mpa_s"] == 2
    assert change(path=["solid", "formats"], yaml="[stl]")["solid"] == {"formats": ["stl"]}
    assert "solid" not in change(path=["solid"])
    wrong = change(path=["tissue", "size_mm"], yaml="[1, ")["tissue"]["size_mm"]
    assert wrong == "[1, "
    assert made["problems"][0]["path"] == ["tissue", "size_mm"]
    body = {"path": ["seed"], "yaml": "&a 1", "version": made["version"]}
    assert client.patch("/api/v1/recipes/a", json=body).status_code == 422
    assert client.patch("/api/v1/recipes/a", json={**body, "colour": 1}).status_code == 422
    stale = {"path": ["seed"], "value": 2, "version": "0"}
    assert client.patch("/api/v1/recipes/a", json=stale).status_code == 409


def test_what_the_form_needs_is_given(client: TestClient, workspace: Workspace) -> None:
    (workspace.root / "recipes" / "a b.yaml").write_text("schema: 1\n")
    keys = list(client.get("/api/v1/recipes/schema").json()["properties"])
    assert keys[:3] == ["schema", "name", "seed"]
    choices = client.get("/api/v1/recipes/choices").json()
    assert choices["profiles"]["inks"]["collagen_fresh"] == "collagen_fresh"
    assert choices["stages"][-1] == "lumens"
    assert choices["unusable"] == ["recipes/a b.yaml"]


def test_progress_says_the_state_of_the_print(client: TestClient) -> None:
    answer = client.get("/api/v1/runs/one/progress").json()
    assert (answer["state"], answer["print_state"], answer["fraction"]) == ("never", "", 0.0)


def test_a_file_of_a_run_comes_as_a_download(asked: TestClient) -> None:
    answer = asked.get("/api/v1/runs/one/files/flow.csv")
    assert answer.text == "vessel\n0\n"
    assert answer.headers["content-disposition"].startswith("attachment")


@pytest.mark.parametrize(
    "path",
    [
        "runs/one/files/secret.key",
        "runs/one/files/..%2F..%2F..%2Fsecret.txt",
        "runs/one/files/%2e%2e",
        "runs/..%2F..%2F/files/secret.txt",
        "runs/%2e%2e/files/secret.txt",
        "runs/one/pages/..%2Freport",
        "runs/one/pages/manifest",
        "recipes/..%2F..%2Fsecret",
        "recipes/%2e%2e",
        "runs/.hidden/progress",
    ],
)
def test_nothing_beyond_the_list_is_given(asked: TestClient, path: str) -> None:
    answer = asked.get(f"/api/v1/{path}")
    assert answer.status_code in (404, 422)
    named = answer.text.replace("secret.key", "").replace("secret.txt", "")
    assert "secret" not in named.replace(unquote(path), "")  # refusals name what was asked for


def test_a_link_that_leads_out_isnt_followed(client: TestClient, workspace: Workspace) -> None:
    (workspace.run("one") / "run.log").symlink_to(workspace.root.parent / "secret.txt")
    assert client.get("/api/v1/runs/one/files/run.log").status_code == 404


def test_a_page_of_a_run_is_shut_in(asked: TestClient) -> None:
    answer = asked.get("/api/v1/runs/one/pages/report?theme=dark")
    policy = answer.headers["content-security-policy"]
    assert "sandbox allow-scripts" in policy
    assert "allow-same-origin" not in policy
    assert "default-src 'none'" in policy
    assert answer.headers["x-frame-options"] == "SAMEORIGIN"
    assert '<html lang="en" data-theme="dark">' in answer.text
    assert asked.get("/api/v1/runs/one/pages/report?theme=x").status_code == 422


def test_a_view_is_made_whatever_lies_in_the_working_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "design.py").write_text("raise SystemExit('the working folder was imported')")
    monkeypatch.chdir(tmp_path)
    recipe = tmp_path / "one.yaml"
    recipe.write_text("tissue: {shape: block, size_mm: [16, 8, 3]}\n")
    page = tissue_page(recipe, {}, tmp_path / "pages")
    assert "view-data" in page.read_text()
    with run_views._MAKING:  # one that is there waits for none that is being made
        assert tissue_page(recipe, {}, tmp_path / "pages") == page
        monkeypatch.setattr(run_views, "_LONGEST_S", 0.01)
        with pytest.raises(ConflictError, match="still being made; try again"):
            tissue_page(recipe, {"another": 1}, tmp_path / "pages")


def test_two_runs_are_compared(asked: TestClient) -> None:
    found = asked.get("/api/v1/runs/compare?one=one&other=two").json()
    assert found["recipe"] == [
        {"name": "toolpath.layer_um", "one": "60.0", "other": "40.0", "change": ""}
    ]
    time = next(row for row in found["figures"] if row["name"] == "Print time")
    assert (time["one"], time["other"], time["change"]) == ("10 min", "15 min", "+50 %")


def test_an_uploaded_recipe_is_answered_with_its_name(client: TestClient) -> None:
    for sent, name in (
        (".yaml", "recipe"),
        (".yaml", "recipe_2"),
        ("Mein Gefäß.yaml", "Mein_Gefa_"),
    ):
        answer = client.post("/api/v1/recipes/import", files={"file": (sent, b"name: one\n")})
        assert answer.json()["name"] == name


def test_an_upload_that_is_no_recipe_is_refused(client: TestClient) -> None:
    for data in (b"\xff\xfe", b"- 1", b"a: &x 1", b"x" * 300_000):
        answer = client.post("/api/v1/recipes/import", files={"file": ("r.yaml", data)})
        assert answer.status_code == 422, data[:10]
    assert json.loads(client.get("/api/v1/recipes").text) == []
