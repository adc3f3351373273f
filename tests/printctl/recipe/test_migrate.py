"""Migration of recipes from older schemas; refusal of newer ones.

The old recipe is a real one: the cylinder as it was asked for before `radius_mm` became
`diameter_mm`, when schemas weren't counted. It is called schema 0 here.
"""

import json
from pathlib import Path
from typing import get_args

import pytest
import yaml
from typer.testing import CliRunner

from printctl.cli.main import app
from printctl.errors import RecipeError
from printctl.recipe import SCHEMA, Recipe, load, load_recipe, parse_recipe
from printctl.recipe.load import STEPS, Change, Step, migrated, migrated_text, steps_from

TWICE = Step(
    0,
    "a cylinder is said by its diameter",
    (Change(("tissue", "radius_mm"), "diameter_mm", lambda radius: 2 * radius),),
)
OLD = """\
# A cylinder with a tree.
schema: 0   # the first
name: old

tissue:
  shape: cylinder
  radius_mm: 3.5  # measured by hand
  height_mm: 4
vasculature: {grow: tree, terminals: 20}
"""


@pytest.fixture
def old(monkeypatch, tmp_path: Path) -> Path:
    monkeypatch.setattr(load, "STEPS", (TWICE,))
    path = tmp_path / "old.yaml"
    path.write_text(OLD)
    return path


def test_schema_of_the_model_is_the_schema_that_is_migrated_to():
    assert get_args(Recipe.model_fields["schema_version"].annotation) == (SCHEMA,)


def test_steps_lead_from_their_first_schema_to_todays_without_a_gap():
    assert [step.old for step in STEPS] == list(range(SCHEMA - len(STEPS), SCHEMA))


def test_text_and_values_are_migrated_alike():
    data = yaml.safe_load(OLD)
    assert yaml.safe_load(migrated_text(OLD, (TWICE,))) == migrated(data, (TWICE,))
    assert data == yaml.safe_load(OLD), "the old values were changed"


def test_comments_and_order_stay_when_a_text_is_migrated():
    expected = (
        OLD.replace("schema: 0", "schema: 1").replace("radius_mm: 3.5", "diameter_mm: 7.0").strip()
    )
    assert migrated_text(OLD, (TWICE,)).strip() == expected


def test_a_key_that_the_recipe_does_not_have_is_left_alone():
    text = "schema: 0\ntissue: {shape: block}\n"
    assert migrated_text(text, (TWICE,)) == "schema: 1\ntissue: {shape: block}\n"


def test_a_key_of_that_name_elsewhere_is_left_alone():
    text = "schema: 0\nradius_mm: 1\nscan: {radius_mm: 2}\n"
    assert migrated_text(text, (TWICE,)) == text.replace("schema: 0", "schema: 1")


def test_old_recipe_is_read_with_a_note(old: Path):
    notes: list[str] = []
    recipe = load_recipe(old, notes.append)
    assert recipe.tissue.diameter_mm == 7
    assert len(notes) == 1
    assert "of schema 0, read as 1" in notes[0]
    assert f"printctl recipe migrate {old}" in notes[0]


def test_recipe_of_today_is_read_without_a_note():
    def nobody(note: str) -> None:
        raise AssertionError(note)

    load_recipe(Path(__file__).parents[3] / "examples" / "planar_fresh.yaml", nobody)


def test_newer_recipe_is_refused_and_says_what_to_do():
    with pytest.raises(RecipeError, match=r"new\.yaml is of schema 7.*up to 1.*update"):
        parse_recipe({"schema": 7, "unheard_of": True}, "new.yaml")


def test_recipe_older_than_any_step_is_refused():
    with pytest.raises(RecipeError, match=r"of schema 0.*older than 1.*printctl init"):
        steps_from({"schema": 0}, "old.yaml", ())


def test_migrate_writes_in_place_and_keeps_the_old_file(old: Path):
    done = CliRunner().invoke(app, ["recipe", "migrate", str(old)])
    assert done.exit_code == 0, done.output
    assert "a cylinder is said by its diameter" in done.output
    assert load_recipe(old).tissue.diameter_mm == 7
    assert old.read_text().startswith("# A cylinder with a tree.\nschema: 1   # the first")
    assert old.with_name("old.schema0.yaml").read_text() == OLD


def test_migrate_beside_leaves_the_old_file_as_it_was(old: Path):
    new = old.with_name("new.yaml")
    done = CliRunner().invoke(app, ["recipe", "migrate", str(old), "--out", str(new)])
    assert done.exit_code == 0, done.output
    assert old.read_text() == OLD
    assert yaml.safe_load(new.read_text())["schema"] == 1
    assert sorted(path.name for path in old.parent.iterdir()) == ["new.yaml", "old.yaml"]


def test_migrate_never_writes_over_a_file(old: Path):
    kept = old.with_name("old.schema0.yaml")
    kept.write_text("mine")
    done = CliRunner().invoke(app, ["recipe", "migrate", str(old)])
    assert done.exit_code != 0
    assert kept.read_text() == "mine"
    assert old.read_text() == OLD


def test_migrate_refuses_what_would_be_wrong_afterwards(old: Path):
    wrong = OLD + "colour: red\n"
    old.write_text(wrong)
    done = CliRunner().invoke(app, ["recipe", "migrate", str(old)])
    assert "colour" in str(done.exception)
    assert old.read_text() == wrong


def test_schema_names_keys_as_a_recipe_does():
    done = CliRunner().invoke(app, ["recipe", "schema"])
    told = json.loads(done.stdout)
    assert set(told["required"]) == {"schema", "name", "tissue", "vasculature"}
    assert told["properties"]["schema"]["const"] == SCHEMA
