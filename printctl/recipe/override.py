"""Replace given keys of a recipe, as for one well or search candidate; validate the result."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from printctl.errors import RecipeError
from printctl.recipe.load import parse_recipe
from printctl.recipe.model import Recipe


def overridden(recipe: Recipe, values: Mapping[str, Any], name: str, origin: str) -> Recipe:
    """The recipe of one part, under another name, with ``values`` in place of its own.

    Parameters
    ----------
    recipe : Recipe
        Its plate, if it has one, is left out.
    values : mapping of str to value
        Key as ``vasculature.terminals`` to what it is to be.
    name : str
    origin : str
        For messages: who asked for these values.

    Raises
    ------
    RecipeError
        For a key that the recipe hasn't, or a value that it refuses.
    """
    data = recipe_data(recipe)
    data["name"] = name
    for key, value in values.items():
        _put(data, key, value, origin)
    return parse_recipe(data, origin)


def recipe_data(recipe: Recipe) -> dict[str, Any]:
    """What the user said, as a file would hold it; the plate left out."""
    data = recipe.model_dump(mode="json", by_alias=True, exclude_unset=True)
    data.pop("plate", None)
    data["toolpath"] = recipe.toolpath.model_dump(mode="json", exclude_unset=True)
    data["toolpath"]["method"] = recipe.toolpath.method
    return data


def _put(data: dict[str, Any], key: str, value: Any, origin: str) -> None:
    *sections, last = key.split(".")
    inside = data
    for section in sections:
        inside = inside.setdefault(section, {})
        if not isinstance(inside, dict):
            raise RecipeError(
                f"{origin}: {key} goes into {section}, which holds no keys of its own; name the "
                "whole of it"
            )
    inside[last] = value
