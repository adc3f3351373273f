"""Field tree behind the recipe form: node types, units, conversion from pydantic models.

Goes in: the recipe's pydantic models. Comes out: a tree of fields with units and limits. Begin
with `walk.py`.
"""

from printctl.web.design.schema.nodes import FormField, Node, Option
from printctl.web.design.schema.walk import recipe_form

__all__ = ["FormField", "Node", "Option", "recipe_form"]
