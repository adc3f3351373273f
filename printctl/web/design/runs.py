"""Runs of a recipe started from the page: their processes, progress, files and pages."""

from __future__ import annotations

import contextlib
import json
import mimetypes
import os
import shutil
import signal
import subprocess
import threading
import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final, Literal

from starlette.responses import FileResponse

from printctl.machine.link.client import attach
from printctl.machine.link.errors import LinkError
from printctl.machine.link.record import REHEARSAL
from printctl.machine.link.states import ENDED
from printctl.pipeline.lock import is_run_active
from printctl.pipeline.run_options import TOOLPATH_NAMES, names_until
from printctl.run_folder.artefacts import GCODE, HTML, JSON
from printctl.run_folder.manifest import MANIFEST
from printctl.sources import python_command
from printctl.web.design.recipes import Recipes
from printctl.web.design.run_views import run_page
from printctl.web.errors import BadRequestError, ConflictError, NotFoundError
from printctl.web.workspace import Workspace, is_name

StageState = Literal["waiting", "running", "done", "failed"]
RunState = Literal["never", "starting", "running", "done", "failed", "interrupted"]


@dataclass
class StageProgress:
    """Progress of one stage: a ``fraction`` from 0 to 1, and what the user should know.

    ``note`` is what is being done, how long it took, or why it failed.
    """

    name: str
    state: StageState = "waiting"
    fraction: float = 0.0
    note: str = ""
    remarks: list[str] = field(default_factory=list)


@dataclass
class RunProgress:
    """A run as far as it is; 0 and empty is what isn't known.

    Attributes
    ----------
    until : str
        Last stage that was asked for.
    message : str
        Why it failed.
    begun, told : float, s since 1970
        When it began, and when it last said something.
    fraction : float, 0 to 1
        Share of the stages that is done, the one at work included.
    """

    name: str
    state: RunState = "never"
    until: str = ""
    stages: list[StageProgress] = field(default_factory=list)
    message: str = ""
    pid: int = 0
    begun: float = 0.0
    told: float = 0.0
    print_state: str = ""
    fraction: float = 0.0

    @property
    def going_on(self) -> bool:
        """Whether its process lives."""
        return self.state in ("starting", "running")

    def _take(self, step: dict[str, Any]) -> None:
        """Change it by a line of the progress file."""
        event, note = step.get("event"), str(step.get("note", ""))
        self.told = float(step.get("time", self.told))
        if event == "begin":
            self.state, self.until = "running", str(step.get("until", ""))
            self.pid, self.begun = int(step.get("pid", 0)), self.told
            self.stages = [StageProgress(str(one)) for one in step.get("stages", ())]
        elif event == "end":
            result = step.get("result")
            ended: RunState = result if result in ("done", "interrupted") else "failed"
            self.break_off(ended, str(step.get("message", "")))
        elif event in ("stage", "done", "remark"):
            name = str(step.get("name", ""))
            stage = next((one for one in self.stages if one.name == name), StageProgress(name))
            if event == "remark":
                stage.remarks.append(note)
                return
            if stage not in self.stages:
                self.stages.append(stage)
            stage.state = "running" if event == "stage" else "done"
            stage.fraction = float(step.get("fraction", 0.0)) if event == "stage" else 1.0
            stage.note = note or stage.note

    def break_off(self, state: RunState, why: str) -> None:
        """End it; the stage at work has failed."""
        self.state, self.message = state, why
        for stage in self.stages:
            if stage.state == "running":
                stage.state, stage.note = "failed", why or stage.note


def read_progress(name: str, path: Path) -> RunProgress:
    """Read a run's file; a line that is half written, or none at all, is passed over."""
    run = RunProgress(name)
    for line in _text(path).splitlines():
        with contextlib.suppress(ValueError, AttributeError):
            run._take(json.loads(line))
    run.fraction = sum(one.fraction for one in run.stages) / max(len(run.stages), 1)
    return run


def _text(path: Path) -> str:
    with contextlib.suppress(OSError):
        return path.read_text(encoding="utf-8", errors="replace")
    return ""


PROGRESS, LOG = "progress.jsonl", "run.log"
_STARTS_S: Final = 60.0
"""A process that lives takes the folder's lock within this."""
_PATIENCE: Final = ((signal.SIGINT, 5.0), (signal.SIGTERM, 3.0), (signal.SIGKILL, 3.0))


class DetachedProcesses:
    """Commands of `printctl`, one a folder, each in a session of its own.

    A command writes its progress into its folder (`printctl.progress_file`) and holds the folder's
    lock: the server may die, and another finds it by these.
    """

    def __init__(self) -> None:
        self._children: dict[Path, subprocess.Popen[bytes]] = {}

    def spawn(self, folder: Path, command: Sequence[str], cwd: Path) -> None:
        """Start a command of ours (subcommand and arguments), told where to write its progress."""
        folder.mkdir(parents=True, exist_ok=True)
        (folder / PROGRESS).unlink(missing_ok=True)
        line = [*python_command("printctl"), *command]
        line += ["--progress-file", str((folder / PROGRESS).resolve())]
        with (folder / LOG).open("wb") as log:
            self._children[folder] = subprocess.Popen(
                line,
                cwd=cwd,
                stdin=subprocess.DEVNULL,
                stdout=log,
                stderr=subprocess.STDOUT,
                start_new_session=True,
            )

    def progress(self, name: str, folder: Path) -> RunProgress:
        """How far the command in a folder is; ``never`` when none was started."""
        run, child = read_progress(name, folder / PROGRESS), self._children.get(folder)
        unheard = run.state == "never" and child is not None
        if child is not None and child.poll() is None:
            if not run.going_on:  # not quite begun, or hasn't quite left yet
                run.state = "starting" if run.state == "never" else "running"
        elif unheard or (run.going_on and not _lives(run, folder)):
            lines = [] if run.stages else _text(folder / LOG).strip().splitlines()
            why = ": ".join(["the process is gone", *lines[-1:]])
            run.break_off("interrupted", f"{why}; start it again, finished stages are kept")
        return run

    def going_on(self, name: str, folder: Path) -> bool:
        """Whether a process, also one from a terminal, works in a folder."""
        return self.progress(name, folder).going_on or (folder.is_dir() and is_run_active(folder))

    def cancel(self, name: str, folder: Path) -> bool:
        """End the command in a folder and all that it started; False when none is going on."""
        run, child = self.progress(name, folder), self._children.get(folder)
        pid = child.pid if child is not None and child.poll() is None else run.pid
        if not run.going_on or not pid:
            return False
        for sign, wait_s in _PATIENCE:
            try:
                os.killpg(pid, sign)
            except (ProcessLookupError, PermissionError):
                break
            deadline = time.monotonic() + wait_s
            while time.monotonic() < deadline:
                if (child.poll() is not None) if child is not None else not _exists(pid):
                    return True
                time.sleep(0.05)
        return True


def _lives(run: RunProgress, folder: Path) -> bool:
    soon = time.time() - run.begun < _STARTS_S
    return bool(run.pid) and _exists(run.pid) and (soon or is_run_active(folder))


def _exists(pid: int) -> bool:
    """Whether a process lives; on Linux, one that waits for its parent to take note doesn't."""
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    except PermissionError:
        return True
    return not _text(Path(f"/proc/{pid}/stat")).rpartition(")")[2].startswith(" Z")


RECIPE = "recipe.yaml"
LAST_STAGE: Final = TOOLPATH_NAMES[-1]
"""As far as a design goes before it is printed."""
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
        self._lock = threading.Lock()

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

    def start(self, name: str, last: str = LAST_STAGE) -> RunProgress:
        """Make a recipe's design, as far as a stage before the print.

        Raises
        ------
        UsageError, BadRequestError
            For a stage that isn't known, one that prints, or a recipe that can't be used.
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
        """After its finished print: scan, registration and report of a run."""
        state = self.print_state(name)
        if state != "done":
            raise ConflictError(
                f"run {name!r} has no finished print ({state or 'none was started'}); print it "
                "first in the Job room"
            )
        return self._go(name, ["--printed"])

    def rehearse(self, name: str, speed: float) -> RunProgress:
        """Print a design on the simulated printer, scan and judge it; ``speed`` times real time."""
        made, folder = self.workspace.run(name), self.workspace.run(name + REHEARSAL)
        with self._lock:
            self._refuse(name, folder)
            for report in (JSON, HTML):  # of the rehearsal before
                (folder / report).unlink(missing_ok=True)
            if made.is_dir():  # what was designed isn't made again
                # Links stay links, which the page doesn't follow out of the workspace.
                shutil.copytree(made, folder, True, _of_prints, dirs_exist_ok=True)
        return self._go(name, ["--rehearse", f"{speed:g}"], folder)

    def cancel(self, name: str) -> RunProgress:
        """Stop a run; finished stages are kept."""
        if not self.processes.cancel(name, self.workspace.run(name)):
            raise ConflictError(f"run {name!r} isn't going on")
        return self.progress(name)

    def end_rehearsals(self) -> int:
        """End all that are on their way to a simulated print; how many."""
        folders = [one for one in self.workspace.found(f"runs/*{REHEARSAL}") if one.is_dir()]
        return sum(self.processes.cancel(one.name, one) for one in folders)

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

    def _go(self, name: str, more: list[str], where: Path | None = None) -> RunProgress:
        recipe = self.recipes.read(name)
        recipe.usable()
        folder = where or self.workspace.run(name)
        with self._lock:
            self._refuse(name, folder)
            folder.mkdir(parents=True, exist_ok=True)
            (folder / RECIPE).write_text(recipe.text, encoding="utf-8")
            path = str(self.workspace.recipe(name).resolve())
            command = ["run", path, "--out", str(folder.resolve()), *more]
            self.processes.spawn(folder, command, self.workspace.root)
        return self.progress(folder.name)

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
