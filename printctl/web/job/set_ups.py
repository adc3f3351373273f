"""Store each job's print set-up as last filled in; else derive it from recipe and G-code."""

from __future__ import annotations

from pathlib import Path
from typing import Final

from design.files import write_text
from printctl.web.job.declared_start import declared_of
from printctl.web.job.jobs import recipe_of, set_up_of_recipe
from printctl.web.job.set_up import JobSetUp
from printctl.web.workspace import Workspace

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
