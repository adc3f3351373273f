"""REST routes for runs: start, continue, cancel, progress, figures, files, pages, comparison."""

from __future__ import annotations

from fastapi import APIRouter
from starlette.responses import FileResponse, HTMLResponse

from printctl.web.design import answers as a
from printctl.web.design.embedded import Theme, embedded
from printctl.web.design.run_views import Figure
from printctl.web.design.service import ARTEFACTS, DesignService


def run_routes(service: DesignService) -> APIRouter:
    """Routes below ``/api/v1/runs``."""
    runs = service.runs
    routes = APIRouter(prefix="/api/v1/runs", tags=["runs"], responses=a.REFUSALS)

    @routes.get("", summary="All runs, the newest first")
    def every() -> list[a.RunAnswer]:
        return [a.RunAnswer(**vars(row)) for row in runs.rows()]

    @routes.get("/compare", summary="Two runs beside each other")
    def compare(one: str, other: str) -> a.ComparisonAnswer:
        compared = service.compare(one, other)
        return a.ComparisonAnswer(
            recipe=list(compared.recipe),
            figures=list(compared.figures),
        )

    @routes.post("/{name}/start", summary="Make the design of the recipe of that name")
    def start(name: str, given: a.MakeRequest) -> a.ProgressAnswer:
        return a.ProgressAnswer.of(runs.start(name, given.until))

    @routes.post("/{name}/continue", summary="After the print: scan, registration, report")
    def go_on(name: str) -> a.ProgressAnswer:
        return a.ProgressAnswer.of(runs.go_on(name))

    @routes.post("/{name}/cancel", summary="Stop a run; finished stages are kept")
    def cancel(name: str) -> a.ProgressAnswer:
        return a.ProgressAnswer.of(runs.cancel(name))

    @routes.get("/{name}/progress", summary="How far a run is")
    def progress(name: str) -> a.ProgressAnswer:
        return a.ProgressAnswer.of(runs.progress(name))

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
