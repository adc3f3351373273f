"""The recipe: its schema, and reading it.

Names are loaded when first asked for: most commands need one part of the schema, not all.
"""

from pathlib import Path
from typing import TYPE_CHECKING, Final

from design.on_demand import on_demand

if TYPE_CHECKING:
    from printctl.recipe.load import load_recipe, parse_recipe
    from printctl.recipe.migrate import SCHEMA
    from printctl.recipe.model import Recipe

STARTER: Final = Path(__file__).parent / "starter.yaml"
"""Commented recipe that runs as it stands."""

__all__ = ["SCHEMA", "STARTER", "Recipe", "load_recipe", "parse_recipe"]

__getattr__ = on_demand(__name__)


def __dir__() -> list[str]:
    return __all__
