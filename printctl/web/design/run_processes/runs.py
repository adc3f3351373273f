"""Start, follow, cancel and continue pipeline runs from the Design page.

A run is a process of the command line in a session of its own: the server may die and another
finds it by its folder's lock and progress.
"""

from __future__ import annotations

import threading
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from printctl.machine.link.client import attach
from printctl.machine.link.errors import LinkError
from printctl.machine.link.states import ENDED
from printctl.pipeline.run_options import TOOLPATH_NAMES, names_until
from printctl.run_folder.manifest import MANIFEST
from printctl.web.design.recipes import Recipes
from printctl.web.design.run_processes.detached import DetachedProcesses
from printctl.web.design.run_processes.progress import RunProgress
from printctl.web.errors import BadRequestError, ConflictError, NotFoundError
from printctl.web.workspace import Workspace, is_name

RECIPE = "recipe.yaml"
LAST_STAGE: Final = TOOLPATH_NAMES[-1]
"""As far as a design goes before it is printed."""


@dataclass(frozen=True)
class RunRow:
    """A run of the workspace.

    Attributes
    ----------
    name : str
    modified : float, s since 1970
    state : str
    until : str
        Last stage that was asked for.
    has_job : bool
        Whether it has G-code that can be printed.
    has_report : bool
    """

    name: str
    modified: float
    state: str
    until: str
    has_job: bool
    has_report: bool


class Runs:
    """The folder ``runs`` of a workspace."""

    def __init__(self, workspace: Workspace, recipes: Recipes) -> None:
        self._workspace, self._recipes = workspace, recipes
        self.processes = DetachedProcesses()
        self._lock = threading.Lock()

    def rows(self) -> list[RunRow]:
        """All runs, the newest first."""
        folders = [path for path in self._workspace.found("runs/*") if path.is_dir()]
        rows = [self._row(path) for path in folders if is_name(path.name)]
        return sorted(rows, key=lambda row: -row.modified)

    def _row(self, folder: Path) -> RunRow:
        run = self.progress(folder.name)
        has_job, has_report = (folder / "part.gcode").is_file(), (folder / "report.html").is_file()
        state = run.state if run.state != "never" or not (folder / MANIFEST).is_file() else "done"
        return RunRow(folder.name, folder.stat().st_mtime, state, run.until, has_job, has_report)

    def folder(self, name: str) -> Path:
        """A run's folder.

        Raises
        ------
        NotFoundError, BadRequestError
        """
        folder = self._workspace.run(name)
        if not folder.is_dir():
            raise NotFoundError(f"there is no run {name!r}")
        return folder

    def progress(self, name: str) -> RunProgress:
        """How far a run is; ``never`` when it was never started."""
        return self.processes.progress(name, self._workspace.run(name))

    def start(self, name: str, last: str = LAST_STAGE) -> RunProgress:
        """Make a recipe's design, as far as a stage before the print.

        Raises
        ------
        UsageError
            For a stage that isn't known.
        BadRequestError
            For one that prints, or a recipe that can't be used.
        ConflictError
            While the run, or a print of it, is going on.
        """
        stages = names_until(last)
        if len(stages) > len(TOOLPATH_NAMES):
            raise BadRequestError(
                f"the design goes as far as {LAST_STAGE}; {last} comes with the print, which is "
                "started in the Job room"
            )
        return self._go(name, ["--until", stages[-1]])

    def go_on(self, name: str) -> RunProgress:
        """After its print: scan, registration and report of a run.

        Raises
        ------
        ConflictError
            When no print of it is done, or the run is going on.
        """
        state = self.print_state(name)
        if state != "done":
            raise ConflictError(
                f"run {name!r} has no finished print ({state or 'none was started'}); print it "
                "first in the Job room"
            )
        return self._go(name, ["--printed"])

    def cancel(self, name: str) -> RunProgress:
        """Stop a run; finished stages are kept.

        Raises
        ------
        ConflictError
            When it isn't going on.
        """
        if not self.processes.cancel(name, self._workspace.run(name)):
            raise ConflictError(f"run {name!r} isn't going on")
        return self.progress(name)

    def print_state(self, name: str) -> str:
        """State of the run's print; empty when none was ever started."""
        try:
            client = attach(self._workspace.run(name) / "print")
        except LinkError:
            return ""
        try:
            return str(client.status.state.value)
        finally:
            client.detach()

    def _go(self, name: str, more: list[str]) -> RunProgress:
        text = self._recipes.read(name).text
        checked = self._recipes.check(text)
        if checked.recipe is None:
            raise BadRequestError("\n".join(p.message for p in checked.problems))
        folder = self._workspace.run(name)
        with self._lock:
            self._refuse(name, folder)
            folder.mkdir(parents=True, exist_ok=True)
            (folder / RECIPE).write_text(text, encoding="utf-8")
            recipe = str(self._workspace.recipe(name).resolve())
            command = ["run", recipe, "--out", str(folder.resolve()), *more]
            self.processes.spawn(folder, command, self._workspace.root)
        return self.progress(name)

    def _refuse(self, name: str, folder: Path) -> None:
        if self.processes.going_on(name, folder):
            raise ConflictError(f"run {name!r} is going on; wait, or cancel it")
        state = self.print_state(name) if folder.is_dir() else ""
        if state and state not in ENDED:
            raise ConflictError(
                f"a print of run {name!r} is going on ({state}); a new design would change its "
                "file: wait for its end, or duplicate the recipe"
            )
