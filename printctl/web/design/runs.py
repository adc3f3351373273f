"""Runs of a recipe started from the page: their processes, progress and ends."""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import threading
import time
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Final, Literal

from printctl.machine.link.client import attach
from printctl.machine.link.errors import LinkError
from printctl.machine.link.states import ENDED
from printctl.pipeline.lock import is_run_active
from printctl.pipeline.run_options import REHEARSAL, TOOLPATH_NAMES, names_until
from printctl.run_folder.manifest import MANIFEST
from printctl.sources import python_command
from printctl.web.design.recipes import Recipes
from printctl.web.errors import BadRequestError, ConflictError, NotFoundError
from printctl.web.workspace import Workspace, is_name

# Read a running pipeline's progress from the file that it writes (`printctl.progress_file`).

StageState = Literal["waiting", "running", "done", "failed"]
RunState = Literal["never", "starting", "running", "done", "failed", "interrupted"]


@dataclass(frozen=True)
class StageProgress:
    """Progress of one stage.

    Attributes
    ----------
    name : str
    state : StageState
    fraction : float, 0 to 1
    note : str
        What is being done, how long it took, or why it failed.
    remarks : tuple of str
        What the user should know.
    """

    name: str
    state: StageState = "waiting"
    fraction: float = 0.0
    note: str = ""
    remarks: tuple[str, ...] = ()


@dataclass(frozen=True)
class RunProgress:
    """A run as far as it is.

    Attributes
    ----------
    name : str
    state : RunState
    until : str
        Last stage that was asked for; empty when nothing is known.
    stages : tuple of StageProgress
    message : str
        Why it failed.
    pid : int
        0 when not known.
    begun, told : float, s since 1970
        When it began, and when it last said something; 0 when not known.
    print_state : str
        Of its print, where that was asked for; empty when there is none.
    fraction : float, 0 to 1
        Share of the stages that is done, the one at work included.
    """

    name: str
    state: RunState = "never"
    until: str = ""
    stages: tuple[StageProgress, ...] = ()
    message: str = ""
    pid: int = 0
    begun: float = 0.0
    told: float = 0.0
    print_state: str = ""
    fraction: float = field(init=False, default=0.0)

    def __post_init__(self) -> None:
        share = sum(one.fraction for one in self.stages) / max(len(self.stages), 1)
        object.__setattr__(self, "fraction", share)

    @property
    def going_on(self) -> bool:
        """Whether its process lives."""
        return self.state in ("starting", "running")


def read_progress(name: str, path: Path) -> RunProgress:
    """Read a run's file; a line that is half written, or none at all, is passed over."""
    progress = RunProgress(name)
    try:
        text = path.read_text(encoding="utf-8", errors="replace")
    except OSError:
        return progress
    for line in text.splitlines():
        try:
            step = json.loads(line)
        except ValueError:
            continue
        if isinstance(step, dict):
            progress = _after(progress, step)
    return progress


def _after(run: RunProgress, step: dict[str, Any]) -> RunProgress:
    run = replace(run, told=float(step.get("time", run.told)))
    event, note = step.get("event"), str(step.get("note", ""))
    if event == "begin":
        stages = tuple(StageProgress(str(one)) for one in step.get("stages", ()))
        return RunProgress(
            run.name, "running", str(step.get("until", "")), stages,
            pid=int(step.get("pid", 0)), begun=run.told, told=run.told,
        )  # fmt: skip
    if event == "end":
        return _ended(run, str(step.get("result", "failed")), str(step.get("message", "")))
    name = str(step.get("name", ""))
    if event == "stage":
        return _with(run, name, "running", float(step.get("fraction", 0.0)), note)
    if event == "done":
        return _with(run, name, "done", 1.0, note)
    if event == "remark":
        stages = tuple(
            replace(one, remarks=(*one.remarks, note)) if one.name == name else one
            for one in run.stages
        )
        return replace(run, stages=stages)
    return run


def _with(run: RunProgress, name: str, state: StageState, done: float, note: str) -> RunProgress:
    known = any(one.name == name for one in run.stages)
    before = run.stages if known else (*run.stages, StageProgress(name))
    stages = tuple(
        replace(one, state=state, fraction=done, note=note or one.note) if one.name == name else one
        for one in before
    )
    return replace(run, stages=stages)


def _ended(run: RunProgress, result: str, message: str) -> RunProgress:
    state: RunState = (
        "done" if result == "done" else "interrupted" if result == "interrupted" else "failed"
    )
    return replace(broken_off(run, message), state=state, message=message)


def broken_off(run: RunProgress, why: str) -> RunProgress:
    """The run with the stage at work marked as failed."""
    stages = tuple(
        replace(one, state="failed", note=why or one.note) if one.state == "running" else one
        for one in run.stages
    )
    return replace(run, stages=stages)


# Start `printctl` commands as detached processes, one per folder; follow and cancel them.
#
# It writes its progress into its folder (`printctl.progress_file`) and holds the folder's lock.

PROGRESS, LOG = "progress.jsonl", "run.log"
_STARTS_S: Final = 60.0
"""A process that lives takes the folder's lock within this."""
_PATIENCE: Final = ((signal.SIGINT, 5.0), (signal.SIGTERM, 3.0), (signal.SIGKILL, 3.0))


@dataclass
class DetachedProcesses:
    """Processes by the folders that they work in."""

    _children: dict[Path, subprocess.Popen[bytes]] = field(default_factory=dict)

    def spawn(self, folder: Path, command: Sequence[str], cwd: Path) -> None:
        """Start a command of ours that is told where to write its progress.

        Parameters
        ----------
        folder : Path
            Which it works in.
        command : sequence of str
            Subcommand and arguments.
        cwd : Path
        """
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
        run = read_progress(name, folder / PROGRESS)
        child = self._children.get(folder)
        if child is not None and child.poll() is None:
            return replace(run, state="starting") if run.state == "never" else _leaving(run)
        if not run.going_on:
            return run if run.state != "never" or child is None else _dead(run, folder)
        return run if _lives(run, folder) else _dead(run, folder)

    def going_on(self, name: str, folder: Path) -> bool:
        """Whether a process, also one from a terminal, works in a folder."""
        return self.progress(name, folder).going_on or (folder.is_dir() and is_run_active(folder))

    def cancel(self, name: str, folder: Path) -> bool:
        """End the command in a folder and all that it started; False when none is going on."""
        run, child = self.progress(name, folder), self._children.get(folder)
        alive = child is not None and child.poll() is None
        pid = child.pid if child is not None and alive else run.pid
        if not run.going_on or not pid:
            return False
        _end(pid, child)
        return True


def _leaving(run: RunProgress) -> RunProgress:
    """A run whose process hasn't quite left yet is going on."""
    return run if run.going_on else replace(run, state="running")


def _lives(run: RunProgress, folder: Path) -> bool:
    if not run.pid or not _exists(run.pid):
        return False
    return is_run_active(folder) or time.time() - run.begun < _STARTS_S


def _dead(run: RunProgress, folder: Path) -> RunProgress:
    try:
        text = (folder / LOG).read_text(encoding="utf-8", errors="replace")
    except OSError:
        text = ""
    last = text.strip().splitlines()[-1:] if not run.stages else []
    last_words = f": {last[0]}" if last else ""
    why = f"the process is gone{last_words}; start it again, finished stages are kept"
    return replace(broken_off(run, why), state="interrupted", message=why)


def _end(pid: int, child: subprocess.Popen[bytes] | None) -> None:
    for sign, wait_s in _PATIENCE:
        try:
            os.killpg(pid, sign)
        except (ProcessLookupError, PermissionError):
            return
        deadline = time.monotonic() + wait_s
        while time.monotonic() < deadline:
            if (child.poll() is not None) if child is not None else not _exists(pid):
                return
            time.sleep(0.05)


def _exists(pid: int) -> bool:
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    except PermissionError:
        return True
    return not _is_dead(Path(f"/proc/{pid}/stat"))


def _is_dead(stat: Path) -> bool:
    """Whether a process has ended and only waits for its parent to take note (Linux)."""
    try:
        status = stat.read_text(encoding="utf-8", errors="replace")
        return status.rpartition(")")[2].split()[0] == "Z"
    except (OSError, IndexError):
        return False


# Start, follow, cancel and continue pipeline runs from the Design page.
#
# A run is a process of the command line in a session of its own: the server may die and another
# finds it by its folder's lock and progress.

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

    def rehearse(self, name: str, speed: float) -> RunProgress:
        """Print a design on the simulated printer, scan and judge it; ``speed`` times real time.

        Raises
        ------
        ConflictError
            While the run, or a print of it, is going on.
        """
        made, folder = self._workspace.run(name), self.rehearsal(name)
        with self._lock:
            self._refuse(name, folder)
            if made.is_dir():  # what was designed isn't made again
                # Links stay links, which the page doesn't follow out of the workspace.
                shutil.copytree(made, folder, True, _of_prints, dirs_exist_ok=True)
        return self._go(name, ["--rehearse", f"{speed:g}"], folder)

    def rehearsal(self, name: str) -> Path:
        """Run folder of a run's rehearsal: apart from what is printed for real.

        Raises
        ------
        BadRequestError
            When the name is too long for it.
        """
        return self._workspace.run(name + REHEARSAL)

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

    def _go(self, name: str, more: list[str], where: Path | None = None) -> RunProgress:
        recipe = self._recipes.read(name)
        if recipe.problems:
            raise BadRequestError("\n".join(p.message for p in recipe.problems))
        folder = where or self._workspace.run(name)
        with self._lock:
            self._refuse(name, folder)
            folder.mkdir(parents=True, exist_ok=True)
            (folder / RECIPE).write_text(recipe.text, encoding="utf-8")
            path = str(self._workspace.recipe(name).resolve())
            command = ["run", path, "--out", str(folder.resolve()), *more]
            self.processes.spawn(folder, command, self._workspace.root)
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
