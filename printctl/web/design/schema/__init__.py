"""The recipe's own schema as a tree that a form can be made from; no list of fields by hand."""

from printctl.web.design.schema.nodes import FormField, Node, Option
from printctl.web.design.schema.walk import recipe_form

__all__ = ["FormField", "Node", "Option", "recipe_form"]
