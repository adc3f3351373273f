"""Set-ups remembered for jobs, and where their print begins."""

from __future__ import annotations

import math
from functools import lru_cache
from pathlib import Path
from typing import Final

from design.files import write_text
from firmware_profiles import Dish, Printer, ProfileError, load
from printctl.checks.gate import RIM_MARGIN_MM, STEP_DOWN_MM
from printctl.errors import SafetyError
from printctl.machine.link.errors import LinkError
from printctl.machine.link.job import load_job
from printctl.machine.link.job_start import declared_start
from printctl.machine.station import Station, StationStatus
from printctl.machine.station.orders import homing_line
from printctl.web.job.jobs import recipe_of, set_up_of_recipe
from printctl.web.job.set_up import JobSetUp
from printctl.web.profile_store import ProfileStore
from printctl.web.workspace import Workspace

# Move the tip to a job's start: straight up, across, straight down.

Place = tuple[float, float, float]


def places_to(tip: Place, start: Place, over_mm: float | None) -> list[Place]:
    """The places that a tip goes to, one after the other, the last being the start.

    Parameters
    ----------
    tip, start : (3,), mm
    over_mm : float or None, mm
        Height at which the tip clears the dish's rim; None where no dish is known.
    """
    high = max(tip[2], start[2], *(() if over_mm is None else (over_mm,)))
    return [(tip[0], tip[1], high), (start[0], start[1], high), start]


def go_to(station: Station, start: Place) -> StationStatus:
    """Bring the tip to a place; the station refuses what its soft limits forbid.

    Raises
    ------
    SafetyError
        When nobody knows where the tip stands, or how high the dish's floor is.
    LinkError
        What the station refuses; the tip then stands where the way so far has led.
    """
    status = station.status
    tip = status.position_mm
    if tip is None or not status.position_trusted:
        raise SafetyError(
            "nobody knows where the tip stands; home it without the needle, or say where it is "
            "(page Printer), then it can be moved to the start"
        )
    mounted = status.mounted
    if mounted.touch_off_due and math.dist(tip, start) > STEP_DOWN_MM:
        raise SafetyError(
            f"the floor of {ProfileStore.name(mounted.dish)} isn't touched off with the needle "
            "mounted, so nobody knows how high the tip clears the rim; nothing was moved. Touch "
            "off the floor (page Printer, Touch off), then move the tip to the start"
        )
    for x, y, z in places_to(tip, start, _over(status)):
        status = station.move_to(x, y, z)
    return status


def _over(status: StationStatus) -> float | None:
    mounted = status.mounted
    if not mounted.dish or mounted.floor_mm is None:
        return None
    return mounted.floor_mm + load(Dish, mounted.dish).wall_mm + RIM_MARGIN_MM


def declared_of(path: Path, printer: str) -> Place | None:
    """Tip position that the job declares to the firmware; None where it doesn't, or can't.

    The file is read once for each printer profile; again when its size or time of change is
    another.
    """
    return _first_lines(path, printer)[0]


def homes_at(path: Path, printer: str) -> int:
    """Line at which the job homes the machine; 0 where it doesn't, or can't be read."""
    return _first_lines(path, printer)[1]


def _first_lines(path: Path, printer: str) -> tuple[Place | None, int]:
    stat = path.stat()
    return _read_lines(path, printer, stat.st_size, stat.st_mtime_ns)


@lru_cache(maxsize=256)
def _read_lines(path: Path, printer: str, size: int, changed_ns: int) -> tuple[Place | None, int]:
    try:
        job = load_job(path, load(Printer, printer))
    except (LinkError, ProfileError):
        return None, 0
    try:
        return declared_start(job), homing_line(job)
    except LinkError:
        return None, homing_line(job)


PRINTED: Final = "set_up.json"
"""In a print's folder: what it was started with."""


class SetUps:
    """Set-ups of a workspace's jobs.

    Parameters
    ----------
    workspace : Workspace
    """

    def __init__(self, workspace: Workspace) -> None:
        self._workspace = workspace

    def of(self, job: str) -> JobSetUp:
        """As it was said for this job last, else by its recipe and its first lines.

        Raises
        ------
        WebError
            When there is no such job.
        """
        set_up = self.mounted(job)
        if self._kept(job).is_file():
            return set_up
        declared = declared_of(self._workspace.job_file(job), set_up.printer)
        return set_up if declared is None else set_up.model_copy(update={"start_mm": declared})

    def mounted(self, job: str) -> JobSetUp:
        """As `of`, for whom the start doesn't matter: the file isn't read.

        Raises
        ------
        WebError
            When there is no such job.
        """
        path, kept = self._workspace.job_file(job), self._kept(job)
        if kept.is_file():
            return JobSetUp.model_validate_json(kept.read_text(encoding="utf-8"))
        recipe = recipe_of(path.parent) if job.startswith("run~") else None
        return JobSetUp() if recipe is None else set_up_of_recipe(recipe, JobSetUp())

    def keep(self, job: str, set_up: JobSetUp) -> None:
        """Remember it for the next visit."""
        write_text(self._kept(job), set_up.model_dump_json() + "\n")

    def printed(self, folder: Path) -> JobSetUp | None:
        """What the print in a folder was started with; None where the page didn't start it."""
        path = folder / PRINTED
        if not path.is_file():
            return None
        return JobSetUp.model_validate_json(path.read_text(encoding="utf-8"))

    def keep_printed(self, folder: Path, set_up: JobSetUp) -> None:
        """Write down what a print is started with."""
        folder.mkdir(parents=True, exist_ok=True)
        write_text(folder / PRINTED, set_up.model_dump_json(indent=1) + "\n")

    def _kept(self, job: str) -> Path:
        self._workspace.job_file(job)  # refuses names that would lead elsewhere
        return self._workspace.private / "set_ups" / f"{job}.json"
