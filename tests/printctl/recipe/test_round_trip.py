"""Recipe round trip: written with all defaults and read back equal."""

from pathlib import Path

import pytest

from printctl.pipeline.facts import recipe_facts
from printctl.recipe import load_recipe, parse_recipe

EXAMPLES = sorted((Path(__file__).parents[3] / "examples").glob("*.yaml"))


@pytest.mark.parametrize("path", EXAMPLES, ids=lambda path: path.stem)
def test_dumped_recipe_reads_back_as_the_same(path: Path) -> None:
    recipe = load_recipe(path)
    assert parse_recipe(recipe.model_dump(mode="json", by_alias=True), "dumped") == recipe


@pytest.mark.parametrize("path", EXAMPLES, ids=lambda path: path.stem)
def test_recipe_of_a_manifest_reads_back_as_the_same(path: Path) -> None:
    recipe = load_recipe(path)
    assert parse_recipe(recipe_facts(recipe), "manifest.json") == recipe
