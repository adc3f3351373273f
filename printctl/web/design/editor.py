"""Recipe open in the browser: text and data kept in step, checked and saved on each change."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from printctl.web.design import form as forms
from printctl.web.design.recipes import CheckedRecipe, RecipeProblem, Recipes, rewrite_yaml
from printctl.web.design.schema import recipe_form
from printctl.web.errors import BadRequestError


class Editor:
    """One recipe, edited by form or as text; each change is checked and written.

    Attributes
    ----------
    name : str
        Empty when none is loaded.
    text : str
    data : dict
        Of the last text that could be read.
    problems : tuple of RecipeProblem
    saved : bool
        Whether the text is in its file; not while it can't be read.
    changed : list of functions
        Called after each change with whether the data changed by other hands than the form's.
    """

    def __init__(self, recipes: Recipes) -> None:
        self.recipes = recipes
        self.form = recipe_form()
        self.name, self.text, self._version = "", "", ""
        self.data: dict[str, Any] = {}
        self.problems: tuple[RecipeProblem, ...] = ()
        self.saved = True
        self.changed: list[Callable[[bool], None]] = []

    def load(self, name: str) -> None:
        """Take up a recipe; blocking.

        Raises
        ------
        NotFoundError
        """
        recipe = self.recipes.read(name)
        self.name, self._version = recipe.name, recipe.version
        self._take(recipe.text, self.recipes.check(recipe.text))
        self.saved = True

    def set_text(self, text: str) -> None:
        """Take a text as it was typed; it is written when it can be read. Blocking.

        Raises
        ------
        ConflictError
            When the recipe was changed elsewhere.
        """
        self._take(text, self.recipes.check(text))
        try:
            self._version = self.recipes.write(self.name, text, self._version).version
            self.saved = True
        except BadRequestError:
            self.saved = False

    def put(self, path: forms.Path, value: Any) -> None:
        """Say a value at a field; blocking."""
        self._set_data(forms.set_value(self.form, self.data, path, value))

    def remove(self, path: forms.Path) -> None:
        """Leave a field to its default; blocking."""
        self._set_data(forms.remove_value(self.form, self.data, path))

    def tell(self, rebuild: bool) -> None:
        """Call who wants to know of a change; on the event loop."""
        for listener in self.changed:
            listener(rebuild)

    def _set_data(self, data: dict[str, Any]) -> None:
        if data != self.data or any(map(_differs, data.values(), self.data.values())):
            self.set_text(rewrite_yaml(self.text, data))

    def _take(self, text: str, checked: CheckedRecipe) -> None:
        self.text, self.problems = text, checked.problems
        self.data = self.data if checked.data is None else checked.data

    def problem_at(self, path: forms.Path) -> str:
        """What is wrong at a field; empty for nothing."""
        return "; ".join(_without(p, path) for p in self.problems if p.path == path)

    def problems_below(self, path: forms.Path) -> int:
        """How many things are wrong at a field or below it."""
        return sum(p.path[: len(path)] == path for p in self.problems)


def _without(problem: RecipeProblem, path: forms.Path) -> str:
    """The message without the path, where it stands at its field."""
    return problem.message.removeprefix(f"{'.'.join(map(str, path))}: ")


def _differs(one: Any, other: Any) -> bool:
    """1 and true are equal to Python, and not to a recipe."""
    return isinstance(one, bool) != isinstance(other, bool)
