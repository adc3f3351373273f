"""Start, follow, cancel and continue runs.

A run is a process of the command line in a session of its own: the server may die and another
finds it by its folder's lock and progress.
"""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
import time
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

from printctl.link.client import attach
from printctl.link.errors import LinkError
from printctl.link.states import ENDED
from printctl.pipeline.lock import run_is_going_on
from printctl.pipeline.manifest import MANIFEST
from printctl.pipeline.sequences import TOOLPATH, until
from printctl.web.design.making.progress import RunProgress, broken_off, read_progress
from printctl.web.design.recipes import Recipes
from printctl.web.errors import BadRequestError, ConflictError, NotFoundError
from printctl.web.workspace import Workspace

PROGRESS, LOG, RECIPE = "progress.jsonl", "run.log", "recipe.yaml"
LAST_STAGE: Final = TOOLPATH[-1].name
"""As far as a design goes before it is printed."""

_STARTS_S: Final = 60.0
"""A process that lives takes the folder's lock within this."""


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
        self._children: dict[str, subprocess.Popen[bytes]] = {}
        self._lock = threading.Lock()

    def rows(self) -> list[RunRow]:
        """All runs, the newest first."""
        folders = [path for path in (self._workspace.root / "runs").iterdir() if path.is_dir()]
        rows = [self._row(path) for path in folders if not path.name.startswith(".")]
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
        folder = self._workspace.run(name)
        run = read_progress(name, folder / PROGRESS)
        child = self._children.get(name)
        if child is not None and child.poll() is None:
            return replace(run, state="starting") if run.state == "never" else _leaving(run)
        if not run.going_on:
            return run if run.state != "never" or child is None else self._dead(run)
        return run if self._lives(run, folder) else self._dead(run)

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
        stages = until(last)
        if len(stages) > len(TOOLPATH):
            raise BadRequestError(
                f"the design goes as far as {LAST_STAGE}; {last} comes with the print, which is "
                "started in the Job room"
            )
        return self._go(name, ["--until", stages[-1].name])

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
        return self._go(name, ["--printed", "--pdf"] if _has_pdf() else ["--printed"])

    def cancel(self, name: str) -> RunProgress:
        """Stop a run; finished stages are kept.

        Raises
        ------
        ConflictError
            When it isn't going on.
        """
        run = self.progress(name)
        child = self._children.get(name)
        pid = child.pid if child is not None and child.poll() is None else run.pid
        if not run.going_on or not pid:
            raise ConflictError(f"run {name!r} isn't going on")
        self._end(pid, child)
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
            (folder / PROGRESS).unlink(missing_ok=True)
            self._children[name] = self._spawn(name, folder, more)
        return self.progress(name)

    def _refuse(self, name: str, folder: Path) -> None:
        if self.progress(name).going_on or (folder.is_dir() and run_is_going_on(folder)):
            raise ConflictError(f"run {name!r} is going on; wait, or cancel it")
        state = self.print_state(name) if folder.is_dir() else ""
        if state and state not in ENDED:
            raise ConflictError(
                f"a print of run {name!r} is going on ({state}); a new design would change its "
                "file: wait for its end, or duplicate the recipe"
            )

    def _spawn(self, name: str, folder: Path, more: list[str]) -> subprocess.Popen[bytes]:
        recipe = self._workspace.recipe(name).resolve()
        command = [sys.executable, "-m", "printctl", "run", str(recipe), "--out"]
        command += [str(folder.resolve()), "--progress-file", str((folder / PROGRESS).resolve())]
        with (folder / LOG).open("wb") as log:
            return subprocess.Popen(
                command + more,
                cwd=self._workspace.root,
                stdin=subprocess.DEVNULL,
                stdout=log,
                stderr=subprocess.STDOUT,
                start_new_session=True,
            )

    def _lives(self, run: RunProgress, folder: Path) -> bool:
        if not run.pid or not _exists(run.pid):
            return False
        return run_is_going_on(folder) or time.time() - run.begun < _STARTS_S

    def _dead(self, run: RunProgress) -> RunProgress:
        log = self._workspace.run(run.name) / LOG
        try:
            last = log.read_text(encoding="utf-8", errors="replace").strip().splitlines()[-1:]
        except OSError:
            last = []
        said = f": {last[0]}" if last and not run.stages else ""
        why = f"the run's process is gone{said}; start it again, finished stages are kept"
        return replace(broken_off(run, why), state="interrupted", message=why)

    def _end(self, pid: int, child: subprocess.Popen[bytes] | None) -> None:
        for sign, wait_s in ((signal.SIGINT, 5.0), (signal.SIGTERM, 3.0), (signal.SIGKILL, 3.0)):
            try:
                os.killpg(pid, sign)
            except (ProcessLookupError, PermissionError):
                return
            deadline = time.monotonic() + wait_s
            while time.monotonic() < deadline:
                if (child.poll() is not None) if child is not None else not _exists(pid):
                    return
                time.sleep(0.05)


def _leaving(run: RunProgress) -> RunProgress:
    """A run whose process hasn't quite left yet is going on."""
    return run if run.going_on else replace(run, state="running")


def _exists(pid: int) -> bool:
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    except PermissionError:
        return True
    return True


def _has_pdf() -> bool:
    from importlib.util import find_spec  # Asked for once a run.

    return find_spec("reportlab") is not None
