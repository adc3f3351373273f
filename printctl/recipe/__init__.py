"""The recipe: its schema, and reading it."""

from printctl.recipe.load import load_recipe, parse_recipe
from printctl.recipe.migrate import SCHEMA
from printctl.recipe.model import Recipe

__all__ = ["SCHEMA", "Recipe", "load_recipe", "parse_recipe"]
