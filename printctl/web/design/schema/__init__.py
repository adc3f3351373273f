"""Convert a recipe's JSON schema to a tree from which the form is built.

Goes in: the recipe's pydantic models. Comes out: a tree of fields with units and limits. Begin
with `walk.py`.
"""

from printctl.web.design.schema.nodes import FormField, Node, Option
from printctl.web.design.schema.walk import recipe_form

__all__ = ["FormField", "Node", "Option", "recipe_form"]
