"""Recipe form built from the schema, checked on the shipped recipes."""

from __future__ import annotations

import os
import signal
from pathlib import Path
from typing import Any

import pytest
import yaml

from printctl.errors import UsageError
from printctl.recipe import Recipe, parse_recipe
from printctl.recipe.load import STARTER
from printctl.web.core import Core
from printctl.web.design import form as forms
from printctl.web.design.editor import Editor
from printctl.web.design.form_widgets import input_text, parse_typed, place_of
from printctl.web.design.recipes import (
    EXAMPLES,
    Recipes,
    check_data,
    check_text,
    read_text,
    rewrite_yaml,
)
from printctl.web.design.runs import RunProgress
from printctl.web.design.schema import recipe_form
from printctl.web.design.service import DesignService
from printctl.web.errors import BadRequestError, ConflictError, NotFoundError
from printctl.web.profile_store import ProfileStore
from printctl.web.settings import ServeSettings
from printctl.web.workspace import Workspace
from tests.waiting import wait_for

SHIPPED = [STARTER, *sorted(EXAMPLES.glob("*.yaml"))]
FORM = recipe_form()
PLANAR: dict[str, Any] = {
    "schema": 1,
    "name": "planar",
    "tissue": {"shape": "block", "size_mm": [16, 8, 3]},
    "vasculature": {"design": "planar_four_vessel"},
}


def _through_the_form(data: dict[str, Any]) -> dict[str, Any]:
    """The data of a form that was filled in with it, each value as its input shows and reads it."""
    new: dict[str, Any] = {}
    for path, value in forms.form_values(FORM, data):
        field = forms.field_at(FORM, data, path)
        assert field is not None, path
        node = field.node.items[0] if isinstance(path[-1], int) else field.node
        if node.sort in ("number", "text", "file"):
            value = parse_typed(node, input_text(node, value))
        new = forms.set_value(FORM, new, path, value)
    return new


@pytest.mark.parametrize("path", SHIPPED, ids=lambda path: path.stem)
def test_a_shipped_recipe_goes_through_the_form_unchanged(path: Path) -> None:
    data = yaml.safe_load(path.read_text(encoding="utf-8"))
    again = _through_the_form(data)
    assert again == data
    assert parse_recipe(again, "form") == parse_recipe(data, "file")


@pytest.mark.parametrize("path", SHIPPED, ids=lambda path: path.stem)
def test_a_shipped_recipe_has_nothing_to_mend(path: Path) -> None:
    assert (
        check_text(
            path.read_text(encoding="utf-8"), path.parent, ProfileStore(path.parent)
        ).problems
        == ()
    )


def test_every_key_of_the_model_is_in_the_form() -> None:
    keys = {field.key for field in FORM.fields}
    assert keys == {info.alias or name for name, info in Recipe.model_fields.items()}
    free = {path for path, field in FORM.walk() if field.node.sort == "free"}
    limits = {path for path in free if path[0] == "registration"}  # a number, or text: +10/-5
    assert limits == {
        ("registration", "datums"),  # a text, or a list of names
        ("registration", "diameter_tolerance_percent"),
        *(("registration", "tolerances", f"{what}_{unit}") for what in ("diameter", "mean")
          for unit in ("um", "percent")),
        ("registration", "tolerances", "vessels"),
    }  # fmt: skip
    plate = {("plate", name) for name in ("wells", "sweep", "scanned")}
    # each_part, or a list of places; an organ's inlets by name
    inlets = {("vasculature", "inlets"), ("vasculature", "anatomy", "inlets")}
    assert free - limits == plate | inlets


@pytest.mark.parametrize(
    ("more", "place", "words"),
    [
        ({"flow": {"viscosity": {"model": "carreau", "index": 7}}}, "flow.viscosity.index", "1"),
        ({"toolpath": {"method": "fresh", "layer_um": 1}}, "toolpath.layer_um", "10"),
        ({"printer": {"ink": "nope"}}, "printer.ink", "shipped: "),
        ({"seed": "x"}, "seed", "whole number"),
        ({"tissue": {"shape": "blok"}}, "tissue", "choose one of"),
        ({"colour": "red"}, "colour", "spelling"),
        (
            {"tissue": {**PLANAR["tissue"], "keep_out": [{"shape": "sphere", "radius_mm": 1}]}},
            "tissue.keep_out.0.centre_mm",
            "missing",
        ),
        (
            {"toolpath": {"method": "fresh", "regions": [{"where": {"mesh": "/etc/passwd"}}]}},
            "toolpath.regions.0.where.mesh",
            "beside the recipe",
        ),
    ],
)
def test_a_problem_stands_at_its_field(
    more: dict[str, Any], place: str, words: str, tmp_path: Path
) -> None:
    problems = check_data({**PLANAR, **more}, tmp_path, ProfileStore(tmp_path)).problems
    found = [problem for problem in problems if problem.place == place]
    assert found, [problem.message for problem in problems]
    assert words in found[0].message


def test_a_changed_value_leaves_the_comments(tmp_path: Path) -> None:
    text = STARTER.read_text(encoding="utf-8")
    data = read_text(text)
    changed = forms.set_value(FORM, data, ("toolpath", "layer_um"), 75)
    changed = forms.set_value(FORM, changed, ("oxygen",), {})
    changed = forms.remove_value(FORM, changed, ("scan", "shrink_percent"))
    again = rewrite_yaml(text, changed)
    assert read_text(again) == changed
    assert again.count("#") == text.count("#")
    assert "layer_um: 75" in again


BOMB = "a: &a [x, x]\nb: &b [*a, *a]\nc: &c [*b, *b]\nname: n\n"


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (BOMB, "aliases"),
        ("schema: 1\nname: !!python/object/apply:os.system ['true']\n", "tags"),
        ("schema: 1\nname: !something x\n", "tags"),
        ("[" * 40 + "]" * 40, "levels"),
        ("- 1\n- 2\n", "no keys"),
        ("a: [1, 2\n", "isn't YAML"),
        ("a: " + "x" * 300_000, "at most"),
        ("a: \x00", "isn't YAML"),
        ("1: 2\n", "no keys"),
        ("name: \ud800", "UTF-8"),
    ],
)
def test_hostile_text_is_refused(text: str, words: str) -> None:
    with pytest.raises(BadRequestError, match=words):
        read_text(text)


@pytest.mark.parametrize(
    "text",
    [
        "flow: {-1: 2, null: 3, 1.5: 4, true: 5}",
        "tissue: [1, {2: 3}]",
        "tissue: {keep_out: {a: [1]}, shape: block}",
        "tissue: {mesh: '" + "x" * 5000 + "', unit: mm}",
        'tissue: {mesh: "a\\0b", unit: mm}',
        "seed: " + "9" * 5000,
        "seed: .nan",
        "name: 2020-01-01",
        "plate: {profile: [], sweep: 7, wells: {}}",
        "toolpath: {method: [1]}",
        "vasculature: {grow: {a: b}}",
        "printer: {heads: [1, null, {ink: 5}], ink: [x]}",
    ],
)
def test_nonsense_is_told_and_never_a_fault(text: str, tmp_path: Path) -> None:
    assert check_text(text, tmp_path, ProfileStore(tmp_path)).problems


# --- recipe keys that a click on the tissue sets, by kind of growth
@pytest.mark.parametrize(
    "given", [None, {}, {"at": [1, 2]}, {"at": [1, 2, "3"]}, {"at": [1, True, 3]},
              {"at": [1, 2, float("nan")]}, {"at": [1, 2, 1e9]}, [1, 2, 3]]
)  # fmt: skip
def test_what_a_frame_sends_is_a_place_or_nothing(given: Any) -> None:
    assert place_of(given) is None
    assert place_of({"at": [1, 2.5, -3]}) == [1.0, 2.5, -3.0]


# --- stored recipes of a workspace
@pytest.fixture
def recipes(tmp_path: Path) -> Recipes:
    return Recipes(Workspace(tmp_path / "ws").make())


@pytest.mark.parametrize("name", ["../x", "a/b", "", ".x", "x" * 99, "a b", "ä", "..", "x\n"])
def test_names_that_lead_elsewhere_are_refused(recipes: Recipes, name: str) -> None:
    with pytest.raises(BadRequestError):
        recipes.new(name)
    with pytest.raises(BadRequestError):
        recipes.read(name)


def test_only_files_that_recipes_read_are_taken(recipes: Recipes) -> None:
    assert recipes.take_file("a/heart.stl", b"solid") == "heart.stl"
    with pytest.raises(BadRequestError, match="recipes name files"):
        recipes.take_file("x.py", b"")
    with pytest.raises(ConflictError):
        recipes.take_file("heart.stl", b"solid another")
    for name in ("junk.stl", "junk.ply", "junk.npz", "junk.csv"):
        with pytest.raises(BadRequestError, match="isn't what its suffix says"):
            recipes.take_file(name, bytes(200))


def test_the_editor_keeps_what_cant_be_read_out_of_the_file(recipes: Recipes) -> None:
    text = recipes.new("one").text
    editor = Editor(recipes)
    editor.load("one")
    editor.set_text("a: [")
    assert not editor.saved
    assert "isn't YAML" in editor.problems[0].message
    assert recipes.read("one").text == text


def test_the_editor_writes_a_wrong_value_and_says_where(recipes: Recipes) -> None:
    recipes.new("one")
    editor = Editor(recipes)
    editor.load("one")
    editor.put(("toolpath", "layer_um"), 1)
    assert "10" in editor.problem_at(("toolpath", "layer_um"))
    assert editor.problems_below(("toolpath",)) == 1
    assert "layer_um: 1\n" in recipes.read("one").text
    editor.remove(("toolpath", "layer_um"))
    assert editor.problems == ()
    assert "layer_um" not in yaml.safe_load(recipes.read("one").text)["toolpath"]


# --- detached runs: started, found by a restarted server, cancelled, refused
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
    wait_for(lambda: service.runs.progress("one").state in states, _LIMIT_S)
    return service.runs.progress("one")


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
