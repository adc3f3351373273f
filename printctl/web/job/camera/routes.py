"""The camera of a job: service and REST."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Annotated

from fastapi import APIRouter, Header, Response
from fastapi import Path as PathParam
from fastapi.responses import FileResponse

from printctl.machine.printing.films import film_file
from printctl.web.core import Core
from printctl.web.errors import ConflictError, NotFoundError
from printctl.web.job.camera.camera import CameraProcess, CameraState
from printctl.web.job.camera.timelapse import TimeLapse, TimeLapseState
from printctl.web.job.prints import PrintReport


class CameraService:
    """The camera that the settings name, if there is one, and the time-lapses."""

    def __init__(self, core: Core) -> None:
        self._core = core
        source = core.settings.camera
        self._camera = CameraProcess(source, self._tell) if source else None
        self._lapse = TimeLapse(self._camera)
        self._tell(self._camera.seen if self._camera else CameraState("none"))

    def close(self) -> None:
        """Let go of the camera."""
        self._lapse.close()
        if self._camera is not None:
            self._camera.close()

    def hear(self, heard: PrintReport) -> None:
        """Hear of a print; never waits."""
        self._lapse.hear(heard)

    def seen(self) -> CameraState:
        """What is known of the camera.

        Raises
        ------
        NotFoundError
            When there is none.
        """
        if self._camera is None:
            raise NotFoundError("there is no camera; start the server with --camera")
        return self._camera.seen

    def timelapse(self, job: str, heard: PrintReport | None) -> TimeLapseState:
        """The time-lapse of a job's last print.

        Raises
        ------
        NotFoundError
        """
        if heard is None:
            raise NotFoundError(f"no print of {job} was ever started")
        return self._lapse.told(heard)

    def film(self, job: str, heard: PrintReport | None) -> Path:
        """File of its film.

        Raises
        ------
        NotFoundError
        """
        if heard is not None:
            path = film_file(heard.folder, heard.journal.started)
            if path.is_file():
                return path
        raise NotFoundError(f"there is no film of a print of {job}")

    def _tell(self, seen: CameraState) -> None:
        self._core.events.publish("camera", state=seen.state, message=seen.message, at=seen.at)


Job = Annotated[str, PathParam(max_length=80, description="run~NAME or file~NAME.")]
_FRESH = {"Cache-Control": "no-store"}


def add_routes(
    routes: APIRouter, service: CameraService, heard: Callable[[str], PrintReport | None]
) -> None:
    """Add them to the job's room."""

    @routes.get("/camera", tags=["camera"], summary="The camera as it stands")
    def camera() -> CameraState:
        return service.seen()

    @routes.get(
        "/camera/still",
        tags=["camera"],
        summary="The picture of now, about once a second; 409 while the camera is lost",
        response_class=Response,
        responses={200: {"content": {"image/jpeg": {}}}, 304: {"description": "None newer."}},
    )
    def still(if_none_match: Annotated[str, Header()] = "") -> Response:
        seen = service.seen()
        if seen.state != "there":  # an old one is never shown as the present
            raise ConflictError(seen.message)
        headers = {**_FRESH, "ETag": f'"{seen.at:.3f}"'}
        if if_none_match == headers["ETag"]:
            return Response(status_code=304, headers=headers)
        return Response(seen.jpeg, media_type="image/jpeg", headers=headers)

    @routes.get("/prints/{job}/timelapse", tags=["camera"], summary="The last print's time-lapse")
    def timelapse(job: Job) -> TimeLapseState:
        return service.timelapse(job, heard(job))

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
