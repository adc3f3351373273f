"""Service behind the Job page's camera card: live camera picture, and a time-lapse per print."""

from __future__ import annotations

from pathlib import Path

from printctl.machine.printing.films import film_file
from printctl.web.core import Core
from printctl.web.errors import ConflictError, NotFoundError
from printctl.web.job.camera.camera import CameraProcess, CameraState, LatestPicture
from printctl.web.job.camera.timelapse import TimeLapse, TimeLapseState
from printctl.web.job.following import PrintReport


class CameraService:
    """The camera, if there is one, and the time-lapses.

    Parameters
    ----------
    core : Core
        Its settings name the camera.

    Attributes
    ----------
    camera : CameraProcess or None
    """

    def __init__(self, core: Core) -> None:
        self._core = core
        source = core.settings.camera
        self.camera = CameraProcess(source, self._tell) if source else None
        self._lapse = TimeLapse(self.camera)

    def close(self) -> None:
        """Let go of the camera."""
        self._lapse.close()
        if self.camera is not None:
            self.camera.close()

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
        if self.camera is None:
            raise NotFoundError("there is no camera; start the server with --camera")
        return self.camera.seen

    def still(self) -> LatestPicture:
        """The picture of now; an old one is never shown as the present.

        Raises
        ------
        NotFoundError, ConflictError
        """
        seen = self.seen()
        if seen.state != "there" or seen.still is None:
            raise ConflictError(seen.message)
        return seen.still

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
        at = None if seen.still is None else seen.still.at
        self._core.events.publish("camera", state=seen.state, message=seen.message, at=at)
