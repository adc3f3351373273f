"""REST of projects: gallery, how far each has come, sketch and rehearsal."""

from __future__ import annotations

from typing import Annotated, Any

from fastapi import APIRouter, Request
from fastapi.responses import JSONResponse
from pydantic import Field

from design.units import LengthUnit
from printctl.web.design.runs import RunProgress
from printctl.web.project.service import (
    MAX_SPEED,
    Project,
    ProjectService,
    gallery,
)
from printctl.web.rest import API, REFUSALS, Body

Value = Annotated[float, Field(allow_inf_nan=False, ge=-1e6, le=1e6)]
Path = Annotated[str, Field(max_length=100)]


class Changes(Body):
    """Values of a recipe, by their path."""

    values: dict[Path, Value] = Field(default={}, max_length=50)


class SketchRequest(Changes):
    """What is to be sketched."""

    known: str = Field(
        default="", max_length=32, description="Tag of the tissue whose outline is there already."
    )


class NewProject(Body):
    """A file to begin with."""

    name: str = Field(max_length=64)
    file: str = Field(max_length=200, description="Taken in by POST /recipes/files.")
    unit: LengthUnit = Field(default="mm", description="Of the file; its format may say it, too.")


class Rehearsal(Body):
    """How a print is rehearsed."""

    speed: float = Field(ge=0, le=MAX_SPEED, description="Times real time; 0: no clock.")


def router(service: ProjectService) -> APIRouter:
    """Routes of the guided way."""
    routes = APIRouter(prefix=API, tags=["projects"], responses=REFUSALS)
    routes.get("/gallery", summary="What a new project can begin from")(gallery)
    routes.get("/projects", summary="Recipes with what they have reached, the newest first")(
        service.projects
    )

    @routes.post("/projects", summary="Begin with a mesh or a network")
    def begin(request: NewProject) -> Project:
        return service.begin(request.name, request.file, request.unit)

    @routes.get("/projects/{name}", summary="How far a project has come")
    def project(name: str) -> Project:
        return service.project(name)

    @routes.patch("/projects/{name}", summary="Write values into its recipe")
    def change(name: str, request: Changes) -> Project:
        return service.change(name, request.values)

    @routes.post(
        "/projects/{name}/sketch",
        summary="The vessels with other values; keeps nothing",
        response_model=dict[str, Any],
    )
    async def sketch(name: str, asked: SketchRequest, request: Request) -> JSONResponse:
        """Straight pieces of vessels: x, y, z of both ends and both radii, mm, eight a piece."""
        found = await service.sketch(name, asked.values, asked.known, request.is_disconnected)
        return JSONResponse(found)  # as it is: FastAPI would look at each of its numbers

    @routes.post("/projects/{name}/rehearse", summary="Print, scan and judge it, all simulated")
    def rehearse(name: str, request: Rehearsal) -> RunProgress:
        return service.rehearse(name, request.speed)

    return routes
