"""JSON Schema of the recipe, held against the model and the shipped recipes."""

from __future__ import annotations

from pathlib import Path

import pytest
import yaml

from printctl.recipe import Recipe, parse_recipe
from printctl.recipe.load import STARTER
from printctl.recipe.schema import option_of, recipe_schema, resolved

SHIPPED = [STARTER, *sorted((Path(__file__).parents[3] / "examples").glob("*.yaml"))]


@pytest.mark.parametrize("path", SHIPPED, ids=lambda path: path.stem)
def test_the_schema_tells_sections_apart_as_the_model_does(path: Path) -> None:
    data = yaml.safe_load(path.read_text(encoding="utf-8"))
    recipe = parse_recipe(data, "file")
    for key in ("tissue", "vasculature", "toolpath", "scan"):
        part = getattr(recipe, key)
        if key not in data or part is None:
            continue
        section = option_of(resolved(recipe_schema()["properties"][key]), data[key])
        assert set(section["properties"]) == {
            info.alias or name for name, info in type(part).model_fields.items()
        }


def test_every_key_of_the_model_is_in_the_schema_with_words_and_unit() -> None:
    schema = recipe_schema()
    assert set(schema["properties"]) == {i.alias or n for n, i in Recipe.model_fields.items()}
    toolpath = resolved(schema["properties"]["toolpath"])
    assert toolpath["tags"] == ["fresh", "embedded"]
    assert toolpath["begins"] == [{"method": "fresh"}, {"method": "embedded"}]
    layer = resolved(resolved(toolpath["oneOf"][0])["properties"]["layer_um"])
    assert (layer["title"], layer["unit"], layer["minimum"]) == ("layer", "µm", 10)
    needle = resolved(resolved(toolpath["oneOf"][0])["properties"]["needle"])
    assert needle["profile"] == "needles"


def test_what_begins_a_section_is_told_as_that_section() -> None:
    for key in ("tissue", "vasculature", "scan"):
        node = resolved(recipe_schema()["properties"][key])
        for option, begin in zip(node["oneOf"], node["begins"], strict=True):
            assert option_of(node, begin) == resolved(option), (key, begin)
