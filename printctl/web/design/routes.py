"""REST of recipes and their runs."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any, Final, Literal

from fastapi import APIRouter, UploadFile
from pydantic import Field
from starlette.responses import FileResponse, HTMLResponse

from printctl.recipe.schema import recipe_schema
from printctl.web.design.recipe_text import MOST_BYTES, read_value, with_values
from printctl.web.design.recipes import CheckedRecipe, Recipes, RecipeText
from printctl.web.design.run_views import Comparison, Figure, compare_runs, key_figures
from printctl.web.design.runs import Runs, artefact, artefacts
from printctl.web.detached_runs import RunProgress
from printctl.web.errors import BadRequestError
from printctl.web.rest import API, REFUSALS, Body

Name = Annotated[str, Field(max_length=64)]
Text = Annotated[str, Field(max_length=MOST_BYTES)]


class NewRecipe(Body):
    """What a new recipe begins from."""

    name: Name
    source: str = Field(default="starter", max_length=64, description="starter, or an example.")


class RenameRequest(Body):
    """Another name."""

    name: Name


class RecipeTextRequest(Body):
    """A recipe's text."""

    text: Text


class ChangedText(RecipeTextRequest):
    """A changed text, and the version that was changed."""

    version: str | None = Field(default=None, description="Of the text before; none for a new one.")


class ChangedValue(Body):
    """A changed value of a recipe, and the version that was changed."""

    path: list[str | int] = Field(
        min_length=1, max_length=30, description="Keys to the value; numbers are places in lists."
    )
    value: Any = Field(default=None, description="Null, or nothing, removes what stands there.")
    yaml: Text | None = Field(default=None, description="The value written as YAML, instead.")
    version: str = Field(description="Of the text that is changed.")


class MakeRequest(Body):
    """How far a design is to be made."""

    until: str = Field(default="lumens", max_length=40, description="Last stage; none that prints.")
    version: str | None = Field(default=None, description="Of the recipe that is meant.")


# It runs its own scripts in a sandbox: without our origin it has neither cookies nor the API.
Theme = Literal["system", "light", "dark"]
POLICY: Final = (
    "sandbox allow-scripts allow-downloads; default-src 'none'; script-src 'unsafe-inline' data:; "
    "style-src 'unsafe-inline'; img-src data: blob:; font-src data:; base-uri 'none'; "
    "form-action 'none'; frame-ancestors 'self'"
)
"""The page's own policy, which names its scripts by hash, holds as well."""
_BARE: Final = (
    "body > header, body > footer, #map > h2 { display: none } body { padding: 8px } "
    "main, section { margin: 0; padding: 0; border: 0 } .stage { min-height: 0 } "
    "@media screen { .wide:not(.play-page) .viewer "
    "{ grid-template-rows: max(16rem, 100vh - 18px) } } "
    "@media screen and (min-width: 44rem) { .wide:not(.play-page) .viewer[data-state=ready] "
    "{ grid-template-columns: minmax(0, 1fr) 14rem } .panel { overflow-y: auto } }"
)


def embedded(path: Path, theme: Theme = "system", bare: bool = False) -> HTMLResponse:
    """An HTML file that the product wrote, as an answer that our pages alone may frame.

    ``bare`` leaves out its own head and foot: what stands there stands around it.
    """
    text = path.read_text(encoding="utf-8")
    if bare:
        text = text.replace("</head>", f"<style>{_BARE}</style></head>", 1)
    if theme != "system":
        text = text.replace('<html lang="en">', f'<html lang="en" data-theme="{theme}">', 1)
    return HTMLResponse(
        text,
        headers={
            "Content-Security-Policy": POLICY,
            "X-Frame-Options": "SAMEORIGIN",
            "Cache-Control": "no-store",
        },
    )


MOST_FILE_BYTES = 200_000_000


def recipe_routes(recipes: Recipes) -> APIRouter:
    """Routes below ``/api/v1/recipes``."""
    routes = APIRouter(prefix=f"{API}/recipes", tags=["recipes"], responses=REFUSALS)
    routes.get("", summary="All recipes")(recipes.rows)
    routes.get("/examples", summary="What a new recipe can begin from")(recipes.examples)
    routes.get("/choices", summary="Profiles, files, examples and stages to choose from")(
        recipes.choices
    )
    routes.get("/schema", summary="JSON Schema of a recipe, with units, tags and titles of a form")(
        recipe_schema
    )

    @routes.post("", summary="Begin a recipe from the starter or an example", status_code=201)
    def new(given: NewRecipe) -> RecipeText:
        return recipes.new(given.name, given.source)

    @routes.post("/validate", summary="Hold a text against the schema; nothing is kept")
    def validate(given: RecipeTextRequest) -> CheckedRecipe:
        return recipes.check(given.text)

    @routes.post("/import", summary="Take in a recipe's file", status_code=201)
    def take_in(file: UploadFile) -> RecipeText:
        return recipes.take_in(file.filename or "recipe.yaml", _read(file, MOST_BYTES))

    @routes.post("/files", summary="Take in a file that recipes name", status_code=201)
    def take_file(file: UploadFile) -> str:
        return recipes.take_file(file.filename or "", _read(file, MOST_FILE_BYTES))

    routes.get("/files/{name}/size", summary="How large a mesh is, in its own unit")(
        recipes.mesh_size
    )

    routes.get("/{name}", summary="A recipe: text, values, and what is wrong with them")(
        recipes.read
    )

    @routes.put("/{name}", summary="Write a recipe's text, right or wrong")
    def write(name: str, given: ChangedText) -> RecipeText:
        return recipes.write(name, given.text, given.version)

    @routes.patch("/{name}", summary="Change or remove one value; the text's comments stay")
    def change(name: str, given: ChangedValue) -> RecipeText:
        value = given.value if given.yaml is None else read_value(given.yaml)
        text = with_values(recipes.text(name), {tuple(given.path): value})
        return recipes.write(name, text, given.version)

    @routes.get(
        "/{name}/tissue",
        summary="The recipe's tissue in 3D, on which places are picked",
        response_class=HTMLResponse,
    )
    def tissue(name: str, theme: Theme = "system") -> HTMLResponse:
        return embedded(recipes.tissue_page(name), theme, bare=True)

    @routes.post("/{name}/duplicate", summary="Copy a recipe", status_code=201)
    def duplicate(name: str, given: RenameRequest) -> RecipeText:
        return recipes.duplicate(name, given.name)

    @routes.post("/{name}/rename", summary="Give a recipe another name")
    def rename(name: str, given: RenameRequest) -> RecipeText:
        return recipes.rename(name, given.name)

    routes.delete("/{name}", summary="Put a recipe into the bin", status_code=204)(recipes.delete)
    routes.post("/{name}/restore", summary="Take a recipe back from the bin")(recipes.restore)
    return routes


def _read(file: UploadFile, most: int) -> bytes:
    data = file.file.read(most + 1)
    if len(data) > most:
        raise BadRequestError(f"{(file.filename or 'file')[:80]}: more than {most / 1e6:g} MB")
    return data


def run_routes(runs: Runs) -> APIRouter:
    """Routes below ``/api/v1/runs``."""
    routes = APIRouter(prefix=f"{API}/runs", tags=["runs"], responses=REFUSALS)
    routes.get("", summary="All runs, the newest first")(runs.rows)

    @routes.get("/compare", summary="Two runs beside each other")
    def compare(one: str, other: str) -> Comparison:
        return compare_runs(runs.folder(one), runs.folder(other))

    @routes.post("/{name}/start", summary="Make the design of the recipe of that name")
    def start(name: str, given: MakeRequest) -> RunProgress:
        return runs.start(name, given.until, given.version)

    routes.post("/{name}/continue", summary="After the print: scan, registration, report")(
        runs.go_on
    )
    routes.post("/{name}/cancel", summary="Stop a run; finished stages are kept")(runs.cancel)

    @routes.get("/{name}/progress", summary="How far a run, or its print, is")
    def progress(name: str) -> RunProgress:
        run = runs.progress(name)
        return run if run.going_on else replace(run, print_state=runs.print_state(name))

    @routes.get("/{name}/figures", summary="Key figures of a run")
    def figures(name: str) -> list[Figure]:
        return key_figures(runs.folder(name))

    @routes.get("/{name}/files", summary="Files of a run that can be fetched")
    def files(name: str) -> list[str]:
        return artefacts(runs.folder(name))

    @routes.get("/{name}/files/{file}", summary="A file of a run", response_class=FileResponse)
    def file(name: str, file: str) -> FileResponse:
        return artefact(name, runs.folder(name), file)

    @routes.get(
        "/{name}/pages/{page}",
        summary="A page of a run: network, layers, dry_run or report",
        response_class=HTMLResponse,
    )
    def page(name: str, page: str, theme: Theme = "system") -> HTMLResponse:
        return embedded(runs.page(name, page), theme, bare=page != "report")

    return routes
