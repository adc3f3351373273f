"""Recipe form built from the schema, checked on the shipped recipes."""

from __future__ import annotations

import os
import signal
from pathlib import Path
from typing import Any

import pytest
import yaml
from pydantic import TypeAdapter

from printctl.errors import UsageError
from printctl.recipe.load import STARTER
from printctl.recipe.schema import fields_of
from printctl.web.design.recipe_text import changed, read_text, rewrite_yaml
from printctl.web.design.recipes import EXAMPLES, RESERVED, Recipes
from printctl.web.design.runs import Runs
from printctl.web.detached_runs import RunProgress
from printctl.web.errors import BadRequestError, ConflictError, NotFoundError
from printctl.web.workspace import Workspace
from tests.waiting import wait_for

SHIPPED = [STARTER, *sorted(EXAMPLES.glob("*.yaml"))]
PLANAR: dict[str, Any] = {
    "schema": 1,
    "name": "planar",
    "tissue": {"shape": "block", "size_mm": [16, 8, 3]},
    "vasculature": {"design": "planar_four_vessel"},
}


@pytest.fixture
def recipes(tmp_path: Path) -> Recipes:
    return Recipes(Workspace(tmp_path / "ws").make())


@pytest.mark.parametrize("path", SHIPPED, ids=lambda path: path.stem)
def test_a_shipped_recipe_has_nothing_to_mend_and_is_made_anew_value_by_value(
    path: Path, recipes: Recipes
) -> None:
    checked = recipes.check(path.read_text(encoding="utf-8"))
    assert checked.problems == ()
    data = checked.data
    again: dict[str, Any] = {}
    for place, value, _ in fields_of(data):
        again = changed(again, place, value)
    assert again == data


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
    more: dict[str, Any], place: str, words: str, recipes: Recipes
) -> None:
    problems = recipes.check(yaml.safe_dump({**PLANAR, **more})).problems
    found = [problem for problem in problems if ".".join(map(str, problem.path)) == place]
    assert found, [problem.message for problem in problems]
    assert words in found[0].message


def test_a_changed_value_leaves_the_comments(tmp_path: Path) -> None:
    text = STARTER.read_text(encoding="utf-8")
    data = read_text(text)
    new = changed(data, ("toolpath", "layer_um"), 75)
    new = changed(new, ("oxygen",), {})
    new = changed(new, ("scan", "shrink_percent"), None)
    again = rewrite_yaml(text, new)
    assert read_text(again) == new
    assert again.count("#") == text.count("#")
    assert "layer_um: 75" in again


def test_a_path_that_leads_nowhere_is_refused_and_a_new_one_made() -> None:
    assert changed({"a": 1}, ("b", 0, "c"), 2) == {"a": 1, "b": [{"c": 2}]}
    assert changed({"a": [1, 2]}, ("a", 0), None) == {"a": [2]}
    assert changed({"a": 1}, ("b", "c"), None) == {"a": 1}
    for path in (("a", 2), ("a", -1), ("a", 0, "x", 5)):
        with pytest.raises(BadRequestError, match="no such place"):
            changed({"a": [{"x": []}]}, path, 1)


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
def test_nonsense_is_told_and_never_a_fault(text: str, recipes: Recipes) -> None:
    assert recipes.check(text).problems


# --- recipe keys that a click on the tissue sets, by kind of growth
@pytest.mark.parametrize(
    ("part", "paths"),
    [
        ({"design": "planar_four_vessel"}, []),
        ({"grow": "tree"}, [("inlets", 0)]),
        ({"grow": "tree", "inlets": [{"at_mm": [0, 0, 0]}]}, [("inlets", 1), ("inlets", 0)]),
        ({"grow": "tree", "inlets": "each_part"}, [("inlets", 0)]),
        ({"grow": "tree", "anatomy": {"template": "kidney"}}, [("anatomy", "inlets", "hilum")]),
        ({"grow": "closed_loop"}, [("root_mm",), ("vein_root_mm",)]),
        ({"grow": "forest", "networks": [{"trees": [{}, 3]}]},
         [("networks", 0, "trees", k, "root_mm") for k in (0, 1)]),
    ],
)  # fmt: skip
def test_places_are_picked_for_what_grows(
    part: dict[str, Any], paths: list[Any], recipes: Recipes
) -> None:
    found = recipes.write("one", yaml.safe_dump({"vasculature": part})).places
    assert [one.path[1:] for one in found] == paths
    for one in found:
        place = [1.0, 2.0, 3.0]
        new = changed({"vasculature": part}, one.path, {one.key: place} if one.key else place)
        assert "1.0, 2.0, 3.0" in str(new)


# --- stored recipes of a workspace
@pytest.mark.parametrize("name", ["../x", "a/b", "", ".x", "x" * 99, "a b", "ä", "..", "x\n"])
def test_names_that_lead_elsewhere_are_refused(recipes: Recipes, name: str) -> None:
    with pytest.raises(BadRequestError):
        recipes.new(name)
    with pytest.raises(BadRequestError):
        recipes.read(name)


def test_only_files_that_recipes_read_are_taken(recipes: Recipes) -> None:
    assert recipes.take_file("a/heart.stl", b"solid") == "heart.stl"
    assert recipes.take_file("mein Herz.stl", b"solid") == "mein_Herz.stl"
    with pytest.raises(BadRequestError, match="recipes name files"):
        recipes.take_file("x.py", b"")
    with pytest.raises(ConflictError):
        recipes.take_file("heart.stl", b"solid another")
    for name in ("junk.stl", "junk.ply", "junk.npz", "junk.csv"):
        with pytest.raises(BadRequestError, match="isn't what its suffix says"):
            recipes.take_file(name, bytes(200))


def test_names_of_rest_paths_are_no_recipe_s(recipes: Recipes) -> None:
    for name in RESERVED:
        with pytest.raises(BadRequestError, match="another one"):
            recipes.new(name)


def test_an_opened_recipe_can_be_sent_whatever_it_holds(recipes: Recipes) -> None:
    text = "name: 2020-01-01\nflow: {-1: 2, null: .nan, 1.5: 4, true: 5}\nplate: {sweep: .inf}\n"
    made = recipes.write("odd", text)
    assert TypeAdapter(type(made)).dump_json(made)


# --- detached runs: started, found by a restarted server, cancelled, refused
_LIMIT_S = 60.0


@pytest.fixture
def runs(recipes: Recipes) -> Runs:
    recipes.new("one")
    return Runs(recipes.workspace, recipes)


def _until(runs: Runs, *states: str) -> RunProgress:
    wait_for(lambda: runs.progress("one").state in states, _LIMIT_S)
    return runs.progress("one")


@pytest.mark.slow
def test_another_server_finds_a_run_and_cancels_it(runs: Runs) -> None:
    runs.start("one")
    pid = _until(runs, "running").pid
    os.killpg(pid, signal.SIGSTOP)  # or it is done before it is cancelled, on a busy machine
    other = Runs(runs.workspace, runs.recipes)
    found = other.progress("one")
    assert found.going_on
    assert found.stages
    with pytest.raises(ConflictError, match="going on"):
        other.start("one")
    other.cancel("one")
    os.killpg(pid, signal.SIGCONT)
    assert _until(other, "interrupted").message
    with pytest.raises(ConflictError, match="isn't going on"):
        other.cancel("one")
    assert _until(runs, "interrupted") == other.progress("one")


@pytest.mark.slow
def test_a_run_that_was_killed_is_told_so(runs: Runs) -> None:
    runs.start("one")
    run = _until(runs, "running")
    os.killpg(run.pid, signal.SIGKILL)
    found = _until(runs, "interrupted")
    assert "process is gone" in found.message
    assert _until(Runs(runs.workspace, runs.recipes), "interrupted").message == found.message


@pytest.mark.slow
def test_a_failed_stage_says_why(runs: Runs) -> None:
    runs.recipes.take_file("n.csv", b"vessel,node0\n1,2\n")
    text = runs.recipes.read("one")
    given = "{network: n.csv, unit: mm}\n"
    wrong = text.text.replace("\n  design: planar_four_vessel", f" {given}#")
    runs.recipes.write("one", wrong, text.version)
    runs.start("one", "flow")
    run = _until(runs, "failed")
    assert [stage.name for stage in run.stages if stage.state == "failed"] == ["vasculature"]
    assert run.message
    assert "Traceback" not in run.message


def test_what_prints_isnt_started_here(runs: Runs) -> None:
    with pytest.raises(BadRequestError, match="Job page"):
        runs.start("one", "print")
    with pytest.raises(UsageError, match="no stage"):
        runs.start("one", "--yes")
    with pytest.raises(ConflictError, match="no finished print"):
        runs.go_on("one")


def test_a_wrong_recipe_isnt_started(runs: Runs) -> None:
    text = runs.recipes.read("one")
    runs.recipes.write("one", text.text + "colour: red\n", text.version)
    with pytest.raises(BadRequestError, match="colour"):
        runs.start("one")
    with pytest.raises(NotFoundError):
        runs.start("two")
