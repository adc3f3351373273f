"""REST routes for recipes: list, create, import, check, write, copy, rename, delete, restore."""

from __future__ import annotations

from typing import Any

from fastapi import APIRouter, UploadFile
from starlette.responses import HTMLResponse

from printctl.web.design import answers as a
from printctl.web.design.embedded import Theme, embedded
from printctl.web.design.recipes import RecipeText
from printctl.web.design.schema import recipe_form
from printctl.web.design.service import DesignService
from printctl.web.design.yaml_text import MOST_BYTES
from printctl.web.errors import BadRequestError

MOST_FILE_BYTES = 200_000_000


def recipe_routes(service: DesignService) -> APIRouter:
    """Routes below ``/api/v1/recipes``."""
    recipes = service.recipes
    routes = APIRouter(prefix="/api/v1/recipes", tags=["recipes"], responses=a.REFUSALS)

    def answer(text: RecipeText) -> a.RecipeAnswer:
        return a.RecipeAnswer.of(text, recipes.check(text.text))

    @routes.get("", summary="All recipes")
    def every() -> list[a.RecipeRow]:
        return [a.RecipeRow(**vars(row)) for row in recipes.rows()]

    @routes.post("", summary="Begin a recipe from the starter or an example", status_code=201)
    def new(given: a.NewRecipe) -> a.RecipeAnswer:
        return answer(recipes.new(given.name, given.source))

    @routes.get("/examples", summary="What a new recipe can begin from")
    def examples() -> list[str]:
        return recipes.examples()

    @routes.get("/schema", summary="The recipe's fields, as the form shows them")
    def schema() -> dict[str, Any]:
        return recipe_form().as_json()

    @routes.post("/validate", summary="Hold a text against the schema; nothing is kept")
    def validate(given: a.RecipeTextRequest) -> a.Validation:
        checked = recipes.check(given.text)
        return a.Validation(valid=not checked.problems, problems=a.problems(checked))

    @routes.post("/import", summary="Take in a recipe's file", status_code=201)
    def take_in(file: UploadFile) -> a.RecipeAnswer:
        return answer(recipes.take_in(file.filename or "recipe.yaml", _read(file, MOST_BYTES)))

    @routes.post("/files", summary="Take in a file that recipes name", status_code=201)
    def take_file(file: UploadFile) -> str:
        return recipes.take_file(file.filename or "", _read(file, MOST_FILE_BYTES))

    @routes.get("/{name}", summary="A recipe")
    def read(name: str) -> a.RecipeAnswer:
        return answer(recipes.read(name))

    @routes.put("/{name}", summary="Write a recipe's text, right or wrong")
    def write(name: str, given: a.ChangedText) -> a.RecipeAnswer:
        return answer(recipes.write(name, given.text, given.version))

    @routes.get(
        "/{name}/tissue",
        summary="The recipe's tissue in 3D, on which places are picked",
        response_class=HTMLResponse,
    )
    def tissue(name: str, theme: Theme = "system") -> HTMLResponse:
        return embedded(service.tissue(name), theme, bare=True)

    @routes.post("/{name}/duplicate", summary="Copy a recipe", status_code=201)
    def duplicate(name: str, given: a.RenameRequest) -> a.RecipeAnswer:
        return answer(recipes.duplicate(name, given.name))

    @routes.post("/{name}/rename", summary="Give a recipe another name")
    def rename(name: str, given: a.RenameRequest) -> a.RecipeAnswer:
        return answer(recipes.rename(name, given.name))

    @routes.delete("/{name}", summary="Put a recipe into the bin", status_code=204)
    def delete(name: str) -> None:
        recipes.delete(name)

    @routes.post("/{name}/restore", summary="Take a recipe back from the bin")
    def restore(name: str) -> a.RecipeAnswer:
        return answer(recipes.restore(name))

    return routes


def _read(file: UploadFile, most: int) -> bytes:
    data = file.file.read(most + 1)
    if len(data) > most:
        raise BadRequestError(f"{(file.filename or 'file')[:80]}: more than {most / 1e6:g} MB")
    return data
