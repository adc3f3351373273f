"""Schema of a run's YAML recipe, and its reading and checking.

Names are loaded when first asked for: most commands need one part of the schema, not all.

Goes in: a YAML file. Comes out: a `Recipe`, checked. Begin with `load.py`.
"""

from typing import TYPE_CHECKING

from design.on_demand import on_demand

if TYPE_CHECKING:
    from printctl.recipe.load import SCHEMA, load_recipe, parse_recipe
    from printctl.recipe.model import Recipe

__all__ = ["SCHEMA", "Recipe", "load_recipe", "parse_recipe"]

__getattr__, __dir__ = on_demand(__name__)
