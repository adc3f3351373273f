"""Two clients of one project: nothing that was saved is lost, and no run mixes two designs."""

from __future__ import annotations

import random
import threading
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pytest
import yaml
from starlette.testclient import TestClient

from printctl.web.app import build_app
from printctl.web.core import Core
from printctl.web.design.runs import RECIPE
from printctl.web.detached_runs import DetachedProcesses
from printctl.web.settings import ServeSettings
from printctl.web.workspace import Workspace

API = "/api/v1"
SMALL = {
    "schema": 1,
    "name": "p",
    "seed": 1,
    "tissue": {"shape": "block", "size_mm": [16, 8, 3]},
    "vasculature": {"grow": "tree", "terminals": 10},
    "toolpath": {"method": "embedded", "needle": "30g_50mm"},
}
KEYS = {"vasculature.terminals": ("vasculature", "terminals"), "seed": ("seed",)}


@dataclass
class Processes:
    """Runs that were started, and what each reads; they end when they are told to."""

    reads: dict[Path, Path] = field(default_factory=dict)

    def spawn(self, folder: Path, command: Sequence[str], cwd: Path) -> None:
        self.reads[folder] = Path(command[1])


@pytest.fixture
def runs(monkeypatch: pytest.MonkeyPatch) -> Processes:
    made = Processes()
    monkeypatch.setattr(DetachedProcesses, "spawn", lambda _, *what: made.spawn(*what))
    monkeypatch.setattr(DetachedProcesses, "going_on", lambda _, name, at: at in made.reads)
    return made


@pytest.fixture
def workspace(tmp_path: Path) -> Workspace:
    return Workspace(tmp_path / "ws").make()


@pytest.fixture
def client(workspace: Workspace, runs: Processes) -> Iterator[TestClient]:
    app = build_app(Core(ServeSettings(workspace.root), workspace), pages=False)
    with TestClient(app) as made:
        yield made


def value_of(text: str, key: str) -> Any:
    data = yaml.safe_load(text)
    for step in KEYS[key]:
        data = data[step]
    return data


def new(client: TestClient, name: str) -> str:
    """Begin a recipe; give its version."""
    body = {"text": yaml.safe_dump(SMALL | {"name": name})}
    answer = client.put(f"{API}/recipes/{name}", json=body)
    assert answer.status_code == 200, answer.text
    version: str = answer.json()["version"]
    return version


def test_a_save_while_the_run_goes_on_changes_nothing(
    client: TestClient, workspace: Workspace, runs: Processes
) -> None:
    version = new(client, "p")
    started = client.post(f"{API}/runs/p/start", json={"version": version})
    assert started.status_code == 200, started.text
    before = workspace.recipe("p").read_bytes()
    body = {"values": {"seed": 5.0}, "version": version}
    answer = client.patch(f"{API}/projects/p", json=body)
    assert answer.status_code == 409
    assert "is going on; wait, or cancel it" in answer.json()["message"]
    assert workspace.recipe("p").read_bytes() == before
    runs.reads.clear()
    assert client.patch(f"{API}/projects/p", json=body).status_code == 200


def test_the_second_save_of_two_tabs_is_refused_with_both_versions(client: TestClient) -> None:
    version = new(client, "p")
    for ends, status in ((40, 200), (25, 409)):
        body = {"values": {"vasculature.terminals": ends}, "version": version}
        answer = client.patch(f"{API}/projects/p", json=body)
        assert answer.status_code == status, answer.text
    said = answer.json()
    assert said["error"] == "ChangedError"
    assert "vasculature.terminals is 40 there and 25 here" in said["message"]
    assert client.post(f"{API}/runs/p/start", json={"version": version}).status_code == 409
    text = client.get(f"{API}/recipes/p").json()["text"]
    assert value_of(text, "vasculature.terminals") == 40


def test_a_run_reads_the_recipe_as_it_was_started(
    client: TestClient, workspace: Workspace, runs: Processes
) -> None:
    version = new(client, "p")
    assert client.post(f"{API}/runs/p/start", json={"version": version}).status_code == 200
    changed = {"path": ["seed"], "value": 9, "version": version}  # on the Design page
    assert client.patch(f"{API}/recipes/p", json=changed).status_code == 200
    reads, folder = runs.reads[workspace.run("p")], workspace.run("p")
    assert value_of(reads.read_text(), "seed") == 1
    assert reads.read_text() == (folder / RECIPE).read_text()
    assert reads.parent == workspace.recipe("p").parent  # files beside the recipe are found
    assert not client.get(f"{API}/projects/p").json()["made"]
    assert [one["name"] for one in client.get(f"{API}/recipes").json()] == ["p"]


@dataclass
class Tab:
    """A browser's tab: what it saw last."""

    version: str = ""
    text: str = ""


@pytest.mark.parametrize(
    "seeds", [range(30), pytest.param(range(30, 200), marks=pytest.mark.slow)], ids=["few", "all"]
)
def test_no_interleaving_loses_or_mixes_anything(
    seeds: range, client: TestClient, workspace: Workspace, runs: Processes
) -> None:
    for seed in seeds:
        interleave(f"p{seed}", random.Random(seed), client, workspace, runs)
        runs.reads.clear()


def interleave(
    name: str, draw: random.Random, client: TestClient, workspace: Workspace, runs: Processes
) -> None:
    """Have two tabs do eight things in any order; the truth is what was granted last."""
    truth = Tab(new(client, name), workspace.recipe(name).read_text())
    tabs = [Tab(truth.version, truth.text) for _ in range(2)]
    folder, recipe = workspace.run(name), f"{API}/recipes/{name}"
    made = ""
    for step in range(8):
        tab, act = draw.choice(tabs), draw.choice(("look", "slide", "type", "make", "end"))
        current, going = tab.version == truth.version, folder in runs.reads
        key, value = draw.choice(list(KEYS)), 2 + 10 * step + draw.randrange(7)
        if act == "look":
            seen = client.get(recipe).json()
            tab.version, tab.text = seen["version"], seen["text"]
        elif act == "slide":
            body = {"values": {key: value}, "version": tab.version}
            answer = client.patch(f"{API}/projects/{name}", json=body)
            assert answer.status_code == (200 if current and not going else 409), answer.text
        elif act == "type":
            data = yaml.safe_load(tab.text)
            (data["vasculature"] if key != "seed" else data)[KEYS[key][-1]] = value
            body = {"text": yaml.safe_dump(data), "version": tab.version}
            answer = client.put(recipe, json=body)
            assert answer.status_code == (200 if current else 409), answer.text
        elif act == "make":
            answer = client.post(f"{API}/runs/{name}/start", json={"version": tab.version})
            assert answer.status_code == (200 if current and not going else 409), answer.text
            made = truth.text if answer.status_code == 200 else made
        else:
            runs.reads.clear()
        now = client.get(recipe).json()
        if act in ("slide", "type") and answer.status_code == 200:
            assert value_of(now["text"], key) == value
            other = next(one for one in KEYS if one != key)
            assert value_of(now["text"], other) == value_of(truth.text, other)
            truth = Tab(now["version"], now["text"])
            tab.version, tab.text = truth.version, truth.text
        assert (now["version"], now["text"]) == (truth.version, truth.text)
        for reads in runs.reads.values():
            assert reads.read_text() == (folder / RECIPE).read_text() == made


def test_what_is_saved_while_it_is_renamed_is_in_one_of_both(
    client: TestClient, workspace: Workspace
) -> None:
    for k in range(10):
        name, saved = f"p{k}", []
        version = new(client, name)

        def save(name: str = name, version: str = version, saved: list[int] = saved) -> None:
            change = {"path": ["seed"], "value": 7, "version": version}
            saved.append(client.patch(f"{API}/recipes/{name}", json=change).status_code)

        thread = threading.Thread(target=save)
        thread.start()
        renamed = client.post(f"{API}/recipes/{name}/rename", json={"name": f"q{k}"})
        thread.join()
        assert renamed.status_code == 200
        assert not workspace.recipe(name).exists()
        if saved == [200]:
            assert value_of(workspace.recipe(f"q{k}").read_text(), "seed") == 7
