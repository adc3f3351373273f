"""Runs of a recipe started from the page: what may be started when, their files and pages."""

from __future__ import annotations

import contextlib
import mimetypes
import shutil
import threading
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from starlette.responses import FileResponse

from design.files import write_text
from printctl.machine.errors import LinkError
from printctl.machine.process.clients.client import attach
from printctl.machine.records.record import REHEARSAL
from printctl.machine.records.states import ENDED
from printctl.pipeline.run_options import TOOLPATH_NAMES, names_until
from printctl.run_folder.artefacts import GCODE, HTML, JSON
from printctl.run_folder.manifest import MANIFEST
from printctl.web.design.recipe_text import read_text
from printctl.web.design.recipes import Recipes
from printctl.web.design.run_views import run_page
from printctl.web.detached_runs import DetachedProcesses, RunProgress
from printctl.web.errors import BadRequestError, ConflictError, NotFoundError
from printctl.web.workspace import Workspace, is_name

RECIPE = "recipe.yaml"
LAST_STAGE: Final = TOOLPATH_NAMES[-1]
"""As far as a design goes before it is printed."""
AFTER_PRINT: Final = frozenset({"scan", "registration"})
"""Sections of a recipe that say what happens to a print that is done."""
ARTEFACTS: Final = (
    "recipe.yaml", "run.log", "manifest.json", "network.csv", "network.vtp", "flow.csv",
    "oxygen.csv", "measures.json", "tissue.stl", "lumen.stl", "solid.stl", "solid.3mf",
    "part.gcode", "dry_run.json", "predicted_bead.csv", "predicted_layers.csv", "lumens.json",
    "time_line.png", "report.json", "report.pdf", "registration.json", "vessels.csv",
    "sections.csv", "defects.csv", "deviation.ply", "deviation.vtp", "sections.vtp",
    "scan_in_part.nrrd",
)  # fmt: skip
"""Files of a run that may be fetched."""
_MEDIA: Final = {
    ".yaml": "text/plain", ".log": "text/plain", ".gcode": "text/plain",
    ".vtp": "application/xml", ".ply": "model/ply", ".3mf": "model/3mf", ".stl": "model/stl",
}  # fmt: skip
"""Types of files that not every system knows."""


def artefacts(folder: Path) -> list[str]:
    """Files of a run's or registration's folder that may be fetched; links aren't followed."""
    paths = {name: folder / name for name in ARTEFACTS}
    return [name for name, path in paths.items() if path.is_file() and not path.is_symlink()]


def artefact(name: str, folder: Path, file: str) -> FileResponse:
    """Return one of the `artefacts` of a run's folder, as a download that has the run's name.

    Raises
    ------
    NotFoundError
        When it isn't there, or isn't one that may be fetched.
    """
    if file not in artefacts(folder):
        raise NotFoundError(f"run {name!r} has no file {file[:80]!r} that can be fetched")
    media = (
        _MEDIA.get(Path(file).suffix) or mimetypes.guess_type(file)[0] or "application/octet-stream"
    )
    return FileResponse(folder / file, media_type=media, filename=f"{name}_{file}")


@dataclass(frozen=True)
class RunRow:
    """A run of the workspace: ``modified`` s since 1970, ``has_job`` with G-code to be printed.

    ``until`` is the last stage that was asked for.
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
        self.workspace, self.recipes = workspace, recipes
        self.processes = DetachedProcesses()
        self._lock = threading.RLock()

    def rows(self) -> list[RunRow]:
        """All runs, the newest first."""
        folders = [path for path in self.workspace.found("runs/*") if path.is_dir()]
        rows = [self._row(path) for path in folders if is_name(path.name)]
        return sorted(rows, key=lambda row: -row.modified)

    def _row(self, folder: Path) -> RunRow:
        run = self.progress(folder.name)
        job, report, made = ((folder / one).is_file() for one in (GCODE, HTML, MANIFEST))
        state = "done" if made and run.state == "never" else run.state
        return RunRow(folder.name, folder.stat().st_mtime, state, run.until, job, report)

    def folder(self, name: str) -> Path:
        """A run's folder.

        Raises
        ------
        NotFoundError
        """
        folder = self.workspace.run(name)
        if not folder.is_dir():
            raise NotFoundError(f"there is no run {name!r}")
        return folder

    def page(self, name: str, page: str) -> Path:
        """A page of a run, as `run_page` makes it."""
        folder = self.folder(name)
        for one in folder.iterdir():  # a page is made of several
            self.workspace.inside(one)
        return run_page(folder, page, self.workspace.private / "pages")

    def progress(self, name: str) -> RunProgress:
        """How far a run is; ``never`` when it was never started."""
        return self.processes.progress(name, self.workspace.run(name))

    def start(self, name: str, last: str = LAST_STAGE, version: str | None = None) -> RunProgress:
        """Make a recipe's design, as far as a stage before the print.

        ``version`` is of the recipe that is meant; None for whatever it is by now.

        Raises
        ------
        UsageError, BadRequestError
            For a stage that isn't known, one that prints, or a recipe that can't be used.
        ConflictError
            While the run, or a print of it, is going on; where the recipe was changed since.
        """
        stages = names_until(last)
        if len(stages) > len(TOOLPATH_NAMES):
            raise BadRequestError(
                f"the design goes as far as {LAST_STAGE}; {last} comes with the print, which is "
                "started on the Job page"
            )
        return self._go(name, ["--until", stages[-1]], version=version)

    def go_on(self, name: str) -> RunProgress:
        """After its finished print: scan, registration and report of a run."""
        state = self.print_state(name)
        if state != "done":
            raise ConflictError(
                f"run {name!r} has no finished print ({state or 'none was started'}); print it "
                "first on the Job page"
            )
        with self._lock:
            self._refuse_redesigned(name)
            return self._go(name, ["--printed"])

    def _refuse_redesigned(self, name: str) -> None:
        """Raise where what was printed isn't what the recipe says by now; its scan may be."""
        data = read_text(self.recipes.text(name))
        with contextlib.suppress(OSError):
            printed = read_text((self.folder(name) / RECIPE).read_text(encoding="utf-8"))
            keys = {key for key in {**data, **printed} if data.get(key) != printed.get(key)}
            if keys := keys - AFTER_PRINT:
                raise ConflictError(
                    f"recipe {name!r} was changed after its print ({', '.join(sorted(keys))}), and "
                    "its scan would be held against another design; take the change back, or "
                    "duplicate the recipe for it"
                )

    def rehearse(self, name: str, speed: float, version: str | None = None) -> RunProgress:
        """Print a design on the simulated printer, scan and judge it; ``speed`` times real time."""
        made, folder = self.workspace.run(name), self.workspace.run(name + REHEARSAL)
        with self._lock:
            if version is not None:
                self.recipes.refuse_changed(name, version)
            self._refuse(name, folder)
            for report in (JSON, HTML):  # of the rehearsal before
                (folder / report).unlink(missing_ok=True)
            if made.is_dir():  # what was designed isn't made again
                # Links stay links, which the page doesn't follow out of the workspace.
                shutil.copytree(made, folder, True, _of_prints, dirs_exist_ok=True)
            return self._go(name, ["--rehearse", f"{speed:g}"], folder, version)

    def cancel(self, name: str) -> RunProgress:
        """Stop a run; finished stages are kept."""
        if not self.processes.cancel(name, self.workspace.run(name)):
            raise ConflictError(f"run {name!r} isn't going on")
        return self.progress(name)

    def print_state(self, name: str) -> str:
        """State of the run's print; empty when none was ever started."""
        try:
            client = attach(self.workspace.run(name) / "print")
        except LinkError:
            return ""
        try:
            return str(client.status.state.value)
        finally:
            client.detach()

    def _go(
        self,
        name: str,
        more: list[str],
        where: Path | None = None,
        version: str | None = None,
    ) -> RunProgress:
        folder = where or self.workspace.run(name)
        with self._lock:
            if version is not None:
                self.recipes.refuse_changed(name, version)
            recipe = self.recipes.read(name)
            recipe.usable()
            self._refuse(name, folder)
            folder.mkdir(0o700, parents=True, exist_ok=True)
            write_text(folder / RECIPE, recipe.text)
            # The recipe itself may be saved before the process has read it.
            started = self.recipes.folder / f".{folder.name}.started.yaml"
            write_text(started, recipe.text)
            command = ["run", str(started.resolve()), "--out", str(folder.resolve()), *more]
            self.processes.spawn(folder, command, self.workspace.root)
        return self.progress(folder.name)

    def refuse_going_on(self, name: str) -> None:
        """Raise `ConflictError` while a run, a rehearsal or a print of a recipe goes on."""
        for one in (name, name + REHEARSAL):
            self._refuse(one, self.workspace.run(one))

    def _refuse(self, name: str, folder: Path) -> None:
        if self.processes.going_on(name, folder):
            raise ConflictError(f"run {name!r} is going on; wait, or cancel it")
        state = self.print_state(folder.name) if folder.is_dir() else ""
        if state and state not in ENDED:
            raise ConflictError(
                f"a print of run {name!r} is going on ({state}); a new design would change its "
                "file: wait for its end, or duplicate the recipe"
            )


def _of_prints(folder: str, names: list[str]) -> set[str]:
    """Return what a rehearsal doesn't take over of a run: prints, scans, progress, locks."""
    left = ("print", "executed", "scan", "registration", "report", "progress", "run.log", ".lock")
    return {name for name in names if name.startswith(left)}
