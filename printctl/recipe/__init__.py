"""The recipe: its schema, and reading it."""

from printctl.recipe.load import load_recipe, parse_recipe
from printctl.recipe.model import Recipe

__all__ = ["Recipe", "load_recipe", "parse_recipe"]
