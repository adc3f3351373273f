"""Service of a job's camera; its methods are routes."""

from __future__ import annotations

from typing import Annotated

from fastapi import Header, Response
from fastapi.responses import FileResponse

from printctl.machine.records.folders import film_file
from printctl.web.core import Core
from printctl.web.errors import ConflictError, NotFoundError
from printctl.web.job.camera.camera import CameraProcess, CameraState
from printctl.web.job.camera.timelapse import TimeLapse, TimeLapseState
from printctl.web.job.jobs import JobId
from printctl.web.job.prints import Prints

_FRESH = {"Cache-Control": "no-store"}


class CameraService:
    """The camera that the settings name, if there is one, and the time-lapses of ``prints``."""

    def __init__(self, core: Core, prints: Prints) -> None:
        self._core, self._prints = core, prints
        source = core.settings.camera
        self._camera = CameraProcess(source, self._tell) if source else None
        self.lapse = TimeLapse(self._camera)
        self._tell(self._camera.seen if self._camera else CameraState("none"))

    def close(self) -> None:
        """Let go of the camera."""
        self.lapse.close()
        if self._camera is not None:
            self._camera.close()

    def seen(self) -> CameraState:
        """What is known of the camera; NotFoundError when there is none."""
        if self._camera is None:
            raise NotFoundError("there is no camera; start the server with --camera")
        return self._camera.seen

    def still(self, if_none_match: Annotated[str, Header()] = "") -> Response:
        """The picture of now; ConflictError while the camera is lost."""
        seen = self.seen()
        if seen.state != "there":  # an old one is never shown as the present
            raise ConflictError(seen.message)
        headers = {**_FRESH, "ETag": f'"{seen.at:.3f}"'}
        if if_none_match == headers["ETag"]:
            return Response(status_code=304, headers=headers)
        return Response(seen.jpeg, media_type="image/jpeg", headers=headers)

    def timelapse(self, job: JobId) -> TimeLapseState:
        """The time-lapse of a job's last print; NotFoundError for a job never printed."""
        return self.lapse.told(self._prints.last(job))

    def film(self, job: JobId) -> FileResponse:
        """Its film; NotFoundError for none."""
        heard = self._prints.last(job)
        path = film_file(heard.folder, heard.journal.started)
        if not path.is_file():
            raise NotFoundError(f"there is no film of a print of {job}")
        return FileResponse(path, media_type="image/webp", headers=_FRESH)

    def _tell(self, seen: CameraState) -> None:
        self._core.events.publish("camera", state=seen.state, message=seen.message, at=seen.at)
