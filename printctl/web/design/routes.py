"""REST of recipes and their runs."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Final, Literal

from fastapi import APIRouter, UploadFile
from pydantic import BaseModel, Field
from starlette.responses import FileResponse, HTMLResponse

from printctl.web.design.recipes import MOST_BYTES, CheckedRecipe, RecipeText
from printctl.web.design.run_views import Difference, Figure
from printctl.web.design.runs import RunProgress
from printctl.web.design.schema import recipe_form
from printctl.web.design.service import ARTEFACTS, DesignService
from printctl.web.errors import BadRequestError

# Request and response types of the Design page's REST routes.


class Refusal(BaseModel):
    """Why something isn't done."""

    error: str
    message: str


REFUSALS: dict[int | str, dict[str, Any]] = {
    404: {"model": Refusal, "description": "There is no such thing."},
    409: {"model": Refusal, "description": "Not while things stand as they do."},
    422: {"model": Refusal, "description": "What was sent can't be taken."},
}


class ProblemAnswer(BaseModel):
    """One thing that is wrong with a recipe."""

    path: list[str | int] = Field(description="Keys to the field; empty for the whole.")
    message: str


class RecipeRow(BaseModel):
    """A recipe of the workspace."""

    name: str
    modified: float = Field(description="Seconds since 1970.")
    problems: int


class RecipeAnswer(BaseModel):
    """A recipe's text and what is wrong with it."""

    name: str
    text: str
    version: str = Field(description="To be sent back with a changed text.")
    problems: list[ProblemAnswer]

    @classmethod
    def of(cls, text: RecipeText, checked: CheckedRecipe) -> RecipeAnswer:
        """Of a recipe."""
        return cls(name=text.name, text=text.text, version=text.version, problems=problems(checked))


def problems(checked: CheckedRecipe) -> list[ProblemAnswer]:
    """Serialise validation problems for the REST API."""
    return [ProblemAnswer(path=list(p.path), message=p.message) for p in checked.problems]


class NewRecipe(BaseModel):
    """What a new recipe begins from."""

    name: str = Field(max_length=64)
    source: str = Field(default="starter", max_length=64, description="starter, or an example.")


class RenameRequest(BaseModel):
    """Another name."""

    name: str = Field(max_length=64)


class RecipeTextRequest(BaseModel):
    """A recipe's text."""

    text: str = Field(max_length=256_000)


class ChangedText(RecipeTextRequest):
    """A changed text, and the version that was changed."""

    version: str | None = Field(default=None, description="Of the text before; none for a new one.")


class Validation(BaseModel):
    """What is wrong with a text."""

    valid: bool
    problems: list[ProblemAnswer]


class RunAnswer(BaseModel):
    """A run of the workspace."""

    name: str
    modified: float = Field(description="Seconds since 1970.")
    state: str
    until: str = Field(description="The last stage that was asked for.")
    has_job: bool
    has_report: bool


class StageAnswer(BaseModel):
    """A stage of a run."""

    name: str
    state: str
    fraction: float
    note: str
    remarks: list[str]


class ProgressAnswer(BaseModel):
    """How far a run is."""

    name: str
    state: str
    until: str
    fraction: float
    message: str
    begun: float = Field(description="Seconds since 1970; 0 when not known.")
    stages: list[StageAnswer]

    @classmethod
    def of(cls, run: RunProgress) -> ProgressAnswer:
        """Of a run."""
        return cls(
            name=run.name,
            state=run.state,
            until=run.until,
            fraction=run.fraction,
            message=run.message,
            begun=run.begun,
            stages=[StageAnswer(**{**vars(s), "remarks": list(s.remarks)}) for s in run.stages],
        )


class MakeRequest(BaseModel):
    """How far a design is to be made."""

    until: str = Field(default="lumens", max_length=40, description="Last stage; none that prints.")


class ComparisonAnswer(BaseModel):
    """Two runs beside each other."""

    recipe: list[Difference]
    figures: list[Difference]


# HTTP response with a generated HTML page (network, layers, report) for a sandboxed frame.
#
# It runs its own scripts in a sandbox: without our origin it has neither cookies nor the API.

Theme = Literal["system", "light", "dark"]
POLICY: Final = (
    "sandbox allow-scripts allow-downloads; default-src 'none'; script-src 'unsafe-inline' data:; "
    "style-src 'unsafe-inline'; img-src data: blob:; font-src data:; base-uri 'none'; "
    "form-action 'none'; frame-ancestors 'self'"
)
"""The page's own policy, which names its scripts by hash, holds as well."""
_BARE: Final = "body > header, body > footer { display: none } body { padding: 8px }"


def embedded(path: Path, theme: Theme = "system", bare: bool = False) -> HTMLResponse:
    """The page as an answer that may be framed by our pages alone.

    Parameters
    ----------
    path : Path
        An HTML file that the product wrote.
    theme : Theme
    bare : bool
        Without its own head and foot: what stands there stands around it.
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


# REST routes for recipes: list, create, import, check, write, copy, rename, delete, restore.

MOST_FILE_BYTES = 200_000_000


def recipe_routes(service: DesignService) -> APIRouter:
    """Routes below ``/api/v1/recipes``."""
    recipes = service.recipes
    routes = APIRouter(prefix="/api/v1/recipes", tags=["recipes"], responses=REFUSALS)

    def answer(text: RecipeText) -> RecipeAnswer:
        return RecipeAnswer.of(text, recipes.check(text.text))

    @routes.get("", summary="All recipes")
    def every() -> list[RecipeRow]:
        return [RecipeRow(**vars(row)) for row in recipes.rows()]

    @routes.post("", summary="Begin a recipe from the starter or an example", status_code=201)
    def new(given: NewRecipe) -> RecipeAnswer:
        return answer(recipes.new(given.name, given.source))

    @routes.get("/examples", summary="What a new recipe can begin from")
    def examples() -> list[str]:
        return recipes.examples()

    @routes.get("/schema", summary="The recipe's fields, as the form shows them")
    def schema() -> dict[str, Any]:
        return recipe_form().as_json()

    @routes.post("/validate", summary="Hold a text against the schema; nothing is kept")
    def validate(given: RecipeTextRequest) -> Validation:
        checked = recipes.check(given.text)
        return Validation(valid=not checked.problems, problems=problems(checked))

    @routes.post("/import", summary="Take in a recipe's file", status_code=201)
    def take_in(file: UploadFile) -> RecipeAnswer:
        return answer(recipes.take_in(file.filename or "recipe.yaml", _read(file, MOST_BYTES)))

    @routes.post("/files", summary="Take in a file that recipes name", status_code=201)
    def take_file(file: UploadFile) -> str:
        return recipes.take_file(file.filename or "", _read(file, MOST_FILE_BYTES))

    @routes.get("/{name}", summary="A recipe")
    def read(name: str) -> RecipeAnswer:
        return answer(recipes.read(name))

    @routes.put("/{name}", summary="Write a recipe's text, right or wrong")
    def write(name: str, given: ChangedText) -> RecipeAnswer:
        return answer(recipes.write(name, given.text, given.version))

    @routes.get(
        "/{name}/tissue",
        summary="The recipe's tissue in 3D, on which places are picked",
        response_class=HTMLResponse,
    )
    def tissue(name: str, theme: Theme = "system") -> HTMLResponse:
        return embedded(service.tissue(name), theme, bare=True)

    @routes.post("/{name}/duplicate", summary="Copy a recipe", status_code=201)
    def duplicate(name: str, given: RenameRequest) -> RecipeAnswer:
        return answer(recipes.duplicate(name, given.name))

    @routes.post("/{name}/rename", summary="Give a recipe another name")
    def rename(name: str, given: RenameRequest) -> RecipeAnswer:
        return answer(recipes.rename(name, given.name))

    @routes.delete("/{name}", summary="Put a recipe into the bin", status_code=204)
    def delete(name: str) -> None:
        recipes.delete(name)

    @routes.post("/{name}/restore", summary="Take a recipe back from the bin")
    def restore(name: str) -> RecipeAnswer:
        return answer(recipes.restore(name))

    return routes


def _read(file: UploadFile, most: int) -> bytes:
    data = file.file.read(most + 1)
    if len(data) > most:
        raise BadRequestError(f"{(file.filename or 'file')[:80]}: more than {most / 1e6:g} MB")
    return data


# REST routes for runs: start, continue, cancel, progress, figures, files, pages, comparison.


def run_routes(service: DesignService) -> APIRouter:
    """Routes below ``/api/v1/runs``."""
    runs = service.runs
    routes = APIRouter(prefix="/api/v1/runs", tags=["runs"], responses=REFUSALS)

    @routes.get("", summary="All runs, the newest first")
    def every() -> list[RunAnswer]:
        return [RunAnswer(**vars(row)) for row in runs.rows()]

    @routes.get("/compare", summary="Two runs beside each other")
    def compare(one: str, other: str) -> ComparisonAnswer:
        compared = service.compare(one, other)
        return ComparisonAnswer(
            recipe=list(compared.recipe),
            figures=list(compared.figures),
        )

    @routes.post("/{name}/start", summary="Make the design of the recipe of that name")
    def start(name: str, given: MakeRequest) -> ProgressAnswer:
        return ProgressAnswer.of(runs.start(name, given.until))

    @routes.post("/{name}/continue", summary="After the print: scan, registration, report")
    def go_on(name: str) -> ProgressAnswer:
        return ProgressAnswer.of(runs.go_on(name))

    @routes.post("/{name}/cancel", summary="Stop a run; finished stages are kept")
    def cancel(name: str) -> ProgressAnswer:
        return ProgressAnswer.of(runs.cancel(name))

    @routes.get("/{name}/progress", summary="How far a run is")
    def progress(name: str) -> ProgressAnswer:
        return ProgressAnswer.of(runs.progress(name))

    @routes.get("/{name}/figures", summary="Key figures of a run")
    def figures(name: str) -> list[Figure]:
        return list(service.figures(name))

    @routes.get("/{name}/files", summary="Files of a run that can be fetched")
    def files(name: str) -> list[str]:
        return service.artefacts(name)

    @routes.get("/{name}/files/{file}", summary="A file of a run", response_class=FileResponse)
    def file(name: str, file: str) -> FileResponse:
        path = service.artefact(name, file)
        return FileResponse(path, media_type=ARTEFACTS[file], filename=f"{name}_{file}")

    @routes.get(
        "/{name}/pages/{page}",
        summary="A page of a run: network, layers, dry_run or report",
        response_class=HTMLResponse,
    )
    def page(name: str, page: str, theme: Theme = "system") -> HTMLResponse:
        return embedded(service.page(name, page), theme, bare=page != "report")

    return routes


def routers(service: DesignService) -> tuple[APIRouter, ...]:
    """Routes below ``/api/v1/recipes`` and ``/api/v1/runs``; nested, each would be made twice."""
    return recipe_routes(service), run_routes(service)
