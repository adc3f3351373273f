"""Stored recipes of a workspace."""

from __future__ import annotations

from pathlib import Path

import pytest
import yaml

from printctl.web.design.recipes import Recipes
from printctl.web.design.widgets.editor import Editor
from printctl.web.errors import BadRequestError, ConflictError
from printctl.web.workspace import Workspace


@pytest.fixture
def recipes(tmp_path: Path) -> Recipes:
    return Recipes(Workspace(tmp_path / "ws").make())


def test_every_example_can_be_begun_from(recipes: Recipes) -> None:
    for number, source in enumerate(recipes.examples()):
        assert recipes.check(recipes.new(f"r{number}", source).text).data is not None


def test_a_taken_name_is_refused(recipes: Recipes) -> None:
    recipes.new("one")
    with pytest.raises(ConflictError, match="already"):
        recipes.new("one")


def test_a_text_changed_elsewhere_isnt_overwritten(recipes: Recipes) -> None:
    first = recipes.new("one")
    recipes.write("one", first.text + "# mine\n", first.version)
    with pytest.raises(ConflictError, match="changed elsewhere"):
        recipes.write("one", first.text + "# yours\n", first.version)


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
        recipes.take_file("heart.stl", b"another")


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
