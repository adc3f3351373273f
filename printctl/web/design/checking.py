"""Check a recipe for the editor: schema, named profiles and files; each error at its field."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path, PurePath
from typing import Any, Final

from pydantic import ValidationError

from firmware_profiles import (
    Bath,
    Dish,
    Ink,
    Needle,
    Plate,
    Printer,
    ProfileError,
    Syringe,
    load,
)
from firmware_profiles.strict_model import Facts
from printctl.recipe import Recipe
from printctl.recipe.load import sentence
from printctl.web.design import form as forms
from printctl.web.design.schema import recipe_form
from printctl.web.design.yaml_text import read_text
from printctl.web.errors import BadRequestError
from printctl.web.profile_store import ProfileStore

PROFILES: Final[dict[str, type[Facts]]] = {
    "printers": Printer,
    "needles": Needle,
    "syringes": Syringe,
    "inks": Ink,
    "baths": Bath,
    "dishes": Dish,
    "plates": Plate,
}


@dataclass(frozen=True)
class RecipeProblem:
    """Error in a recipe, with its place.

    Attributes
    ----------
    path : tuple of str or int
        Keys to the field; empty for the whole.
    message : str
    """

    path: forms.Path
    message: str

    @property
    def place(self) -> str:
        """The path in one word, as messages name it."""
        return ".".join(map(str, self.path))


@dataclass(frozen=True)
class CheckedRecipe:
    """A recipe's text, read and held against the schema.

    Attributes
    ----------
    data : dict or None
        None when the text can't be read.
    recipe : Recipe or None
        None when it can't be used.
    problems : tuple of RecipeProblem
    """

    data: dict[str, Any] | None
    recipe: Recipe | None
    problems: tuple[RecipeProblem, ...]


def check_text(text: str, folder: Path, store: ProfileStore) -> CheckedRecipe:
    """Read and check a recipe.

    Parameters
    ----------
    text : str
    folder : Path
        That the recipe's paths are relative to, and stay in.
    store : ProfileStore
        Profiles that it may name.
    """
    try:
        data = read_text(text)
    except BadRequestError as exc:
        return CheckedRecipe(None, None, (RecipeProblem((), str(exc)),))
    return check_data(data, folder, store)


def check_data(data: dict[str, Any], folder: Path, store: ProfileStore) -> CheckedRecipe:
    """As `check_text`, of data."""
    named = tuple(_named(data, folder, store))
    try:
        recipe = Recipe.model_validate(data)
    except ValidationError as exc:
        problems = tuple(_problem(dict(one), data) for one in exc.errors())
        return CheckedRecipe(data, None, problems + named)
    return CheckedRecipe(data, None if named else recipe, named)


def _problem(raw: dict[str, Any], data: dict[str, Any]) -> RecipeProblem:
    path = forms.user_path(recipe_form(), data, raw["loc"])
    return RecipeProblem(path, sentence(raw, path).strip())


def _named(data: dict[str, Any], folder: Path, store: ProfileStore) -> list[RecipeProblem]:
    """Profiles that aren't there, and files that aren't or lie outside the recipe's folder."""
    problems = []
    # Unknown keys are refused by the schema itself.
    for path, value in forms.form_values(recipe_form(), data, strict=False):
        field = forms.field_at(recipe_form(), data, path)
        if field is None or not isinstance(value, str):
            continue
        message = ""
        if field.node.sort == "profile":
            message = _profile(PROFILES[field.node.profile], value, store)
        elif field.node.sort == "file":
            message = _file(value, folder)
        if message:
            problems.append(RecipeProblem(path, f"{'.'.join(map(str, path))}: {message}"))
    return problems


def _profile(model: type[Facts], name: str, store: ProfileStore) -> str:
    if name.endswith((".yaml", ".yml")) and name not in store.choices(model):
        return (
            f"on the page a shipped profile is named, or one of your own in {store.folder(model)}; "
            "any other file is used from a terminal"
        )
    try:
        load(model, name)
    except ProfileError as exc:
        return str(exc)
    return ""


def _file(name: str, folder: Path) -> str:
    inside = PurePath(name)
    if inside.is_absolute() or ".." in inside.parts or "\\" in name or not name:
        return (
            f"{name!r} isn't the name of a file beside the recipe; upload the file to the "
            "recipes and give its name"
        )
    try:
        there = (folder / inside).exists()
    except OSError:  # no file system takes such a name
        there = False
    if not there:
        return f"there is no file {name!r} beside the recipe; upload it"
    return ""
