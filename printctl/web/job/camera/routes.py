"""REST routes for the camera: state, latest picture, a print's time-lapse and its film."""

from __future__ import annotations

from collections.abc import Callable
from typing import Annotated, Literal

from fastapi import APIRouter, Header, Path, Response
from fastapi.responses import FileResponse
from pydantic import BaseModel, Field

from printctl.web.job.camera.camera_service import CameraService
from printctl.web.job.following import PrintReport

Job = Annotated[str, Path(max_length=80, description="run~NAME or file~NAME.")]
_FRESH = {"Cache-Control": "no-store"}


class CameraResponse(BaseModel):
    """The camera as it stands."""

    state: Literal["starting", "there", "lost"]
    message: str = Field(description="Since when and why there is no picture; else empty.")
    number: int = Field(description="Pictures so far.")
    at: float | None = Field(description="Of the last picture, s since 1970.")


class TimeLapseResponse(BaseModel):
    """The time-lapse of a print."""

    frames: int = Field(description="Pictures kept.")
    bytes: int
    film: bool = Field(description="Whether the film is there.")
    making: bool = Field(description="Whether the film is being made.")
    message: str = Field(description="Why no more are kept, or why there is no film; else empty.")


def add_routes(
    routes: APIRouter, service: CameraService, heard: Callable[[str], PrintReport | None]
) -> None:
    """Add them to the job's room."""

    @routes.get("/camera", tags=["camera"], summary="The camera as it stands")
    def camera() -> CameraResponse:
        seen = service.seen()
        number, at = (seen.still.number, seen.still.at) if seen.still else (0, None)
        return CameraResponse(state=seen.state, message=seen.message, number=number, at=at)

    @routes.get(
        "/camera/still",
        tags=["camera"],
        summary="The picture of now, about once a second; 409 while the camera is lost",
        response_class=Response,
        responses={200: {"content": {"image/jpeg": {}}}, 304: {"description": "None newer."}},
    )
    def still(if_none_match: Annotated[str, Header()] = "") -> Response:
        still = service.still()
        headers = {**_FRESH, "ETag": f'"{still.at:.3f}"'}
        if if_none_match == headers["ETag"]:
            return Response(status_code=304, headers=headers)
        return Response(still.jpeg, media_type="image/jpeg", headers=headers)

    @routes.get("/prints/{job}/timelapse", tags=["camera"], summary="The last print's time-lapse")
    def timelapse(job: Job) -> TimeLapseResponse:
        return TimeLapseResponse.model_validate(service.timelapse(job, heard(job)).to_dict())

    @routes.get(
        "/prints/{job}/timelapse/film",
        tags=["camera"],
        summary="Its film, an animated WebP; there once the print has ended",
        response_class=FileResponse,
        responses={200: {"content": {"image/webp": {}}}},
    )
    def film(job: Job) -> FileResponse:
        path = service.film(job, heard(job))
        return FileResponse(path, media_type="image/webp", headers=_FRESH)
