"""Gallery, sketch and steps of a project, by REST."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
from starlette.testclient import TestClient

from printctl.recipe import load_recipe
from printctl.web.app import build_app
from printctl.web.core import Core
from printctl.web.design.recipes import EXAMPLES
from printctl.web.design.runs import RECIPE
from printctl.web.page.assets import FOLDER
from printctl.web.settings import ServeSettings
from printctl.web.workspace import Workspace
from tests.printctl.web.serving import ROOT

API = "/api/v1"


@pytest.fixture
def workspace(tmp_path: Path) -> Workspace:
    return Workspace(tmp_path / "ws").make()


@pytest.fixture
def client(workspace: Workspace) -> Iterator[TestClient]:
    app = build_app(Core(ServeSettings(workspace.root), workspace), pages=False)
    with TestClient(app) as made:
        yield made


def begun(client: TestClient, example: str, name: str = "p") -> str:
    made = client.post(f"{API}/recipes", json={"name": name, "source": example})
    assert made.status_code == 201, made.text
    return name


def sketch(client: TestClient, name: str, known: str = "", **values: float) -> dict[str, Any]:
    body = {"values": {key.replace("__", "."): value for key, value in values.items()}}
    answer = client.post(f"{API}/projects/{name}/sketch", json=body | {"known": known})
    assert answer.status_code == 200, answer.text
    found: dict[str, Any] = answer.json()
    return found


def test_each_entry_of_the_gallery_has_a_picture_and_a_recipe_of_its_size(
    client: TestClient,
) -> None:
    entries = client.get(f"{API}/gallery").json()
    assert len(entries) >= 6
    for one in entries:
        assert (FOLDER / "pictures" / f"{one['example']}.webp").stat().st_size < 40_000
        tissue = load_recipe(EXAMPLES / f"{one['example']}.yaml", print).tissue.model_dump()
        sizes = [*tissue.get("size_mm", ()), tissue.get("diameter_mm"), tissue.get("height_mm")]
        assert all(f"{size:g}" in one["size"] for size in sizes if size)


def test_a_slider_grows_other_vessels_in_the_same_tissue(client: TestClient) -> None:
    name = begun(client, "planar_tree")
    first = sketch(client, name)
    again = sketch(client, name, known=first["tissue"], vasculature__terminals=12)
    assert first["figures"]["terminals"] == 30
    assert again["figures"]["terminals"] == 12
    assert first["outline"] is not None
    assert again["outline"] is None, "the browser has it already"
    pieces = np.reshape(first["pieces"], (-1, 8))
    assert len(pieces) == len(first["kinds"])
    low, high = np.zeros(3), np.array([16.0, 8.0, 3.0])
    assert (pieces[:, :3] >= low - 1e-3).all()
    assert (pieces[:, 3:6] <= high + 1e-3).all()
    assert (pieces[:, 6:] > 0).all()
    assert sketch(client, name)["pieces"] == first["pieces"], "nothing was kept"


@pytest.mark.parametrize(
    ("values", "status", "said"),
    [
        ({"vasculature.terminals": -3}, 422, "terminals"),
        ({"tissue.size_mm.7": 3.0}, 422, "tissue.size_mm.7"),
        ({"tissue.shape.of.it": 3.0}, 422, "tissue: "),
        ({"vasculature.smallest_diameter_mm": 1.9}, 409, "too thin"),
    ],
)
def test_a_sketch_that_can_not_be_grown_says_why(
    client: TestClient, values: dict[str, float], status: int, said: str
) -> None:
    name = begun(client, "planar_tree")
    answer = client.post(f"{API}/projects/{name}/sketch", json={"values": values})
    assert answer.status_code == status, answer.text
    assert said in answer.json()["message"]
    assert sketch(client, name)["figures"]["terminals"] == 30, "the next one is grown"


def test_a_slider_s_value_is_written_and_comments_stay(client: TestClient) -> None:
    name = begun(client, "planar_tree")
    before = client.get(f"{API}/recipes/{name}").json()["text"]
    body = {"values": {"vasculature.terminals": 44.0}}
    project = client.patch(f"{API}/projects/{name}", json=body).json()
    text = client.get(f"{API}/recipes/{name}").json()["text"]
    assert "terminals: 44" in text
    assert [line for line in text.splitlines() if line.startswith("#")] == [
        line for line in before.splitlines() if line.startswith("#")
    ]
    ends = next(one for one in project["sliders"] if one["path"] == "vasculature.terminals")
    assert (ends["value"], ends["least"]) == (44, 2)


def test_a_mesh_begins_a_project_and_a_bad_name_or_unit_keeps_nothing(
    client: TestClient, workspace: Workspace
) -> None:
    data = trimesh.creation.box((12, 9, 7)).export(file_type="stl")
    stl = {"file": ("box.stl", data, "model/stl")}
    assert client.post(f"{API}/recipes/files", files=stl).status_code in (200, 201)
    for body in ({"name": "../x", "file": "box.stl"}, {"name": "x", "file": "none.stl"}):
        answer = client.post(f"{API}/projects", json=body)
        assert answer.status_code == 422, answer.text
    assert client.get(f"{API}/projects").json() == []
    made = client.post(f"{API}/projects", json={"name": "box", "file": "box.stl", "unit": "mm"})
    assert made.json()["step"] == "shape"
    again = client.post(f"{API}/projects", json={"name": "box", "file": "box.stl", "unit": "mm"})
    assert again.status_code == 409
    assert sketch(client, "box")["figures"]["terminals"] > 1


def test_a_text_network_is_in_cm_or_in_the_unit_that_is_given(
    client: TestClient, workspace: Workspace
) -> None:
    text = "Vessel: 0, Number of Points: 2\n0, 0, 0, 0.05\n2, 0, 0, 0.05\n"
    workspace.recipe("one").with_name("one.txt").write_text(text)
    for name, unit in (("plain", {}), ("millimetres", {"unit": "mm"})):
        body = {"name": name, "file": "one.txt"} | unit
        assert client.post(f"{API}/projects", json=body).status_code == 200
        part = load_recipe(workspace.recipe(name)).vasculature
        assert getattr(part, "unit", "") == unit.get("unit")


def test_a_project_s_name_may_be_as_long_as_any(client: TestClient) -> None:
    data = trimesh.creation.box((12, 9, 7)).export(file_type="stl")
    client.post(f"{API}/recipes/files", files={"file": ("box.stl", data, "model/stl")})
    for count in (60, 64):
        body = {"name": "n" * count, "file": "box.stl"}
        assert client.post(f"{API}/projects", json=body).status_code == 200
        assert client.get(f"{API}/projects/{'n' * count}").json()["step"] == "shape"
    answer = client.post(f"{API}/projects", json={"name": "n" * 65, "file": "box.stl"})
    assert answer.status_code == 422
    assert len(client.get(f"{API}/projects").json()) == 2


def test_a_mesh_is_begun_with_what_was_asked_of_it(client: TestClient) -> None:
    data = trimesh.creation.box((12, 9, 7)).export(file_type="stl")
    client.post(f"{API}/recipes/files", files={"file": ("box.stl", data, "model/stl")})
    assert client.get(f"{API}/recipes/files/box.stl/size").json()["size"] == [12, 9, 7]
    assert client.get(f"{API}/recipes/files/none.stl/size").status_code == 404
    body = {"name": "box", "file": "box.stl", "unit": "cm", "needle": "27g"}
    asked = {"smallest_diameter_mm": 0.4, "inlet": "top"}
    assert client.post(f"{API}/projects", json=body | asked).status_code == 200
    data = client.get(f"{API}/recipes/box").json()["data"]
    assert data["tissue"] == {"mesh": "box.stl", "unit": "cm"}
    assert data["toolpath"]["needle"] == "27g"
    assert data["vasculature"]["smallest_diameter_mm"] == 0.4
    assert data["vasculature"]["root"] == "top"
    for k, inlet in enumerate(("face", "each_part")):
        made = client.post(f"{API}/projects", json=body | {"name": f"b{k}", "inlet": inlet})
        assert made.status_code == 200, made.text
    wrong = client.post(f"{API}/projects", json=body | {"name": "w", "needle": "none_such"})
    assert wrong.status_code == 422


def test_an_empty_file_is_called_empty(client: TestClient) -> None:
    for name in ("box.stl", "tree.ply"):
        answer = client.post(f"{API}/recipes/files", files={"file": (name, b"", "model/stl")})
        assert (answer.status_code, answer.json()["message"]) == (
            422,
            f"{name} is empty (0 bytes); export it again",
        )


def test_what_is_of_another_recipe_or_was_not_checked_is_not_made(
    client: TestClient, workspace: Workspace
) -> None:
    name = begun(client, "planar_tree")
    folder = workspace.run(name)
    folder.mkdir()
    (folder / "part.gcode").write_text("G1 X1\n")
    text = client.get(f"{API}/recipes/{name}").json()["text"]
    for made_of in (text.replace("terminals: 30", "terminals: 31"), text):
        (folder / RECIPE).write_text(made_of)
        assert not client.get(f"{API}/projects/{name}").json()["made"]
        assert client.get(f"{API}/projects").json()[0]["step"] == "shape"
        answer = client.post(f"{API}/projects/{name}/rehearse", json={"speed": 100})
        assert answer.status_code == 409
        assert "make it" in answer.json()["message"]


@pytest.mark.slow
def test_a_rehearsal_is_never_taken_for_a_print(tmp_path: Path) -> None:
    """A run with a real port after it still wants the port, and no pretended scan."""
    text = (EXAMPLES / "planar_tree.yaml").read_text()
    text = text.replace("port: simulated", "port: /dev/ttyNOPE")
    recipe = tmp_path / "real.yaml"
    recipe.write_text(text)
    run = [sys.executable, "-m", "printctl", "run", str(recipe), "--out", str(tmp_path / "out")]
    run += ["--until", "print", "--yes"]
    assert subprocess.run([*run, "--rehearse", "0"], cwd=ROOT, check=False).returncode == 0
    pretended = subprocess.run(run, cwd=ROOT, capture_output=True, text=True, check=False)
    assert pretended.returncode == 2
    assert "a simulated scan needs" in pretended.stderr
    scan = "  simulated: microct\n  voxel_um: [40, 40, 40]\n"
    recipe.write_text(text.replace(scan, "  file: scan.tif\n"))
    (tmp_path / "scan.tif").touch()
    real = subprocess.run(run, cwd=ROOT, capture_output=True, text=True, check=False)
    assert real.returncode == 4
    assert "/dev/ttyNOPE doesn't exist" in real.stderr
    taken = subprocess.run(
        [*run, "--printed"], cwd=ROOT, capture_output=True, text=True, check=False
    )
    assert taken.returncode == 4
    assert "no finished print" in taken.stderr
